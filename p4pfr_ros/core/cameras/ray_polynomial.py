# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""
The division model's polynomial: the depth of a pixel's ray, and where the rays fold.

The pixel at the distance r from the centre (in focal lengths) sees the ray (r, w) in the plane of
the optical axis, with  w(r²) = 1 + k r² + k2 r⁴ + k3 r⁶.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.polynomial import polynomial as poly

from ..geometry import Array

# A pair of roots this close to the real axis means a slope that all but vanishes.
_NEARLY_REAL = 1e-7
_NEGLIGIBLE = 1e-60

# k, k2, k3.
Terms = tuple[float, float, float]


def ray_depth(r2: Array, terms: Terms) -> Array:
    """Return w at squared radii, any shape."""
    k, k2, k3 = terms
    depth: Array = 1.0 + r2 * (k + r2 * (k2 + r2 * k3))
    return depth


def fold_radius(terms: Terms) -> float:
    """Return the radius up to which the rays turn outwards; infinite if they do everywhere."""
    k, k2, k3 = terms
    # The angle atan2(r, w) grows with r while  w - r w' = 1 - k r² - 3 k2 r⁴ - 5 k3 r⁶ > 0.
    return math.sqrt(smallest_positive_root(np.array([1.0, -k, -3.0 * k2, -5.0 * k3])))


def smallest_positive_root(polynomial: Array) -> float:
    """Return it, of ascending coefficients; infinite if there is none, 0 if one is not finite."""
    if not np.isfinite(polynomial).all():
        return 0.0
    size = np.abs(polynomial)
    roots = poly.polyroots(poly.polytrim(np.where(size > _NEGLIGIBLE * size.max(), polynomial, 0)))
    real = roots.real[(np.abs(roots.imag) <= _NEARLY_REAL * np.abs(roots)) & (roots.real > 0.0)]
    return float(real.min()) if real.size else math.inf
