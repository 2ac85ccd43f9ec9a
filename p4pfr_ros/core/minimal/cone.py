# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""
The possible depths of the four points: the cone of λ > 0.

The projection λᵢ (xᵢ, yᵢ, 1 + k rᵢ²) = P (Xᵢ, Yᵢ, 1) is linear in P, and four points of a plane
obey Σ mᵢ (Xᵢ, Yᵢ, 1) = 0 with weights m that depend on the board alone. This eliminates the pose:

    Σ mᵢ λᵢ (xᵢ, yᵢ, 1 + k rᵢ²) = 0.

Its first two rows do not contain k: with vᵢ = mᵢ (xᵢ, yᵢ) they are Σ λᵢ vᵢ = 0, two equations in
four depths. Their non-negative solutions are a cone with two extreme rays a and b, and every
physical solution is λ = (1 - τ) a + τ b with 0 < τ < 1. Without a cone there is no solution.
"""

from __future__ import annotations

from typing import NamedTuple

from .four import choose, Four, largest, Points, scaled
from ..jit import inlined

# The rounding error of a product whose true value is zero, relative to the sizes of its factors.
# The image points are differences (pixel minus centre): each has an error of ε times the image's
# size, not its own, and 1e-14 is some fifty times that.
_ROUNDING = 1e-14

# Rays closer than this (sum of absolute differences; each ray sums to 1) enclose no cone.
_MIN_OPENING = 1e-12


class Cone(NamedTuple):
    """The extreme rays a and b, each summing to 1; opens: whether there is a cone."""

    opens: bool
    a: Four
    b: Four


@inlined
def depth_cone(image: Points, radius: Four, m: Four) -> Cone:
    """
    Find the extreme rays of {λ ≥ 0, Σ λᵢ mᵢ (xᵢ, yᵢ) = 0}.

    The image is scaled so that the farthest point has radius 1.
    """
    # All λ with Σ λᵢ vᵢ = 0 lie in a plane of R⁴. Its Plücker coordinates are the six cross
    # products vᵢ × vⱼ. Row l of the antisymmetric matrix of their duals,
    #     plane[l, k] = ± vᵢ × vⱼ,   {i, j, k, l} = {0, 1, 2, 3},
    # is the vector of that plane whose entry l is zero: Cramer's rule on the other three. A ray
    # of the cone is a row whose entries have one sign.
    x, y = image
    p0, p1 = (x[0], y[0], radius[0]), (x[1], y[1], radius[1])
    p2, p3 = (x[2], y[2], radius[2]), (x[3], y[3], radius[3])
    v01 = m[0] * m[1] * _cross(p0, p1)
    v02 = m[0] * m[2] * _cross(p0, p2)
    v03 = m[0] * m[3] * _cross(p0, p3)
    v12 = m[1] * m[2] * _cross(p1, p2)
    v13 = m[1] * m[3] * _cross(p1, p3)
    v23 = m[2] * m[3] * _cross(p2, p3)
    is_ray0, ray0 = _ray((0.0, v23, -v13, v12))
    is_ray1, ray1 = _ray((-v23, 0.0, v03, -v02))
    is_ray2, ray2 = _ray((v13, -v03, 0.0, v01))
    is_ray3, ray3 = _ray((-v12, v02, -v01, 0.0))
    # With a point at the centre, or three collinear board points, three of the rows are the same
    # ray. So the second ray is the one farthest from the first.
    a = choose(is_ray0, ray0, choose(is_ray1, ray1, ray2))
    b = a
    opening = _MIN_OPENING
    farther = is_ray1 and _distance(ray1, a) > opening
    b, opening = choose(farther, ray1, b), _distance(ray1, a) if farther else opening
    farther = is_ray2 and _distance(ray2, a) > opening
    b, opening = choose(farther, ray2, b), _distance(ray2, a) if farther else opening
    farther = is_ray3 and _distance(ray3, a) > opening
    b, opening = choose(farther, ray3, b), _distance(ray3, a) if farther else opening
    return Cone((is_ray0 or is_ray1 or is_ray2) and opening > _MIN_OPENING, a, b)


@inlined
def _ray(row: Four) -> tuple[bool, Four]:
    """Return whether the entries have one sign, and the row with the sum 1."""
    low = min(min(row[0], row[1]), min(row[2], row[3]))
    high = max(max(row[0], row[1]), max(row[2], row[3]))
    total = row[0] + row[1] + row[2] + row[3]
    inverse = 1.0 / total if total != 0.0 else 0.0
    return low * high >= 0.0 and total != 0.0, scaled(row, inverse)


@inlined
def _distance(a: Four, b: Four) -> float:
    return abs(a[0] - b[0]) + abs(a[1] - b[1]) + abs(a[2] - b[2]) + abs(a[3] - b[3])


@inlined
def board_weights(board: Points) -> tuple[bool, Four]:
    """
    Return m with Σ mᵢ = 0, Σ mᵢ (Xᵢ, Yᵢ) = 0, the largest ±1; False for collinear points.

    mᵢ is, with alternating sign, the area of the triangle of the other three points.
    """
    x, y = board
    x1, y1 = x[1] - x[0], y[1] - y[0]
    x2, y2 = x[2] - x[0], y[2] - y[0]
    x3, y3 = x[3] - x[0], y[3] - y[0]
    m = (
        (x2 - x1) * (y3 - y1) - (y2 - y1) * (x3 - x1),
        y2 * x3 - x2 * y3,
        x1 * y3 - y1 * x3,
        y1 * x2 - x1 * y2,
    )
    # With three collinear points the fourth has zero weight, and rounding must not give it a sign:
    # the computed area is the rounding error of the coordinates times a length.
    length = max(largest((x1, x2, x3, 0.0)), largest((y1, y2, y3, 0.0)))
    rounding = _ROUNDING * length * (length + max(abs(x[0]), abs(y[0])))
    size = largest(m)
    inverse = 1.0 / size if size > rounding else 0.0
    return size > rounding, (
        m[0] * inverse if abs(m[0]) > rounding else 0.0,
        m[1] * inverse if abs(m[1]) > rounding else 0.0,
        m[2] * inverse if abs(m[2]) > rounding else 0.0,
        m[3] * inverse if abs(m[3]) > rounding else 0.0,
    )


@inlined
def _cross(a: tuple[float, float, float], b: tuple[float, float, float]) -> float:
    """
    Return the cross product of two points (x, y, radius).

    It is exactly zero if it is rounding: for points on one ray, or at the centre.
    """
    value = a[0] * b[1] - a[1] * b[0]
    return value if abs(value) > _ROUNDING * (a[2] + b[2]) else 0.0
