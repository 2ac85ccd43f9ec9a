# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""
Division model to CameraInfo: the closest rational_polynomial or equidistant model.

With the optical axis in the centre, a lens is one function of one number: the radius r of a pixel
over the undistorted radius ρ, or over the angle θ, of its ray. Both fits minimise pixels over the
rays out to the image's corners. docs/derivation.md has the closed form.

This module stands alone because the way back, ``closest_division``, needs DivisionCamera, which
needs this one.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
import math

import numpy as np

from .camera_info import CameraInfoModel, corner_radius_px
from .ray_polynomial import fold_radius, ray_depth, Terms
from ..geometry import Array

# With a larger residual, px, the equidistant model is tried too.
_GOOD_ENOUGH_PX = 0.1
_SAMPLES = 300
_MEASURED = 4000  # radii at which the residual is measured
# Least Z over the distance to the axis: rays closer to 90 degrees reach no plane in front.
_SIDEWAYS = 0.01

_MAX_STEPS = 60
_EXACT_PX = 1e-6  # far below any image's noise: the fit stops
_STILL_FALLING = 1e-3  # of the cost, for another step to be worth it
_START_DAMPING, _MAX_DAMPING = 1e-3, 1e6


def fit_camera_info_model(
    focal_px: float,
    center_px: tuple[float, float],
    terms: Terms,
    image_size: tuple[int, int],
) -> CameraInfoModel:
    """
    Return the CameraInfo model closest to a division camera with the terms k, k2, k3.

    rational_polynomial if it is within 0.1 px over the image, else rational_polynomial or
    equidistant, whichever is closer. Focal length and centre are the division camera's.
    """
    seen = _VisibleRays(focal_px, center_px, terms, image_size)
    # Dense at the rim like Chebyshev nodes, which nearly minimises the largest residual.
    r = seen.end * np.sin(0.5 * np.pi * (np.arange(_SAMPLES) + 0.5) / _SAMPLES)
    depth = seen.depth(r)
    models = []
    if (depth > _SIDEWAYS * r).all():
        rational = _fit_rational(terms[0], r, r / depth, focal_px)
        models.append(seen.measured('rational_polynomial', rational))
    if not models or not models[0].residual_px <= _GOOD_ENOUGH_PX:
        models.append(_fit_equidistant(seen, r, np.arctan2(r, depth)))
    return min(models, key=lambda model: model.residual_px)


def closed_form(k: float) -> tuple[float, ...]:
    """Return D of the rational_polynomial that agrees with r(ρ) up to the order ρ¹³."""
    return (-5.0 * k, 6.0 * k**2, 0.0, 0.0, -(k**3), -6.0 * k, 10.0 * k**2, -4.0 * k**3)


@dataclass(frozen=True, slots=True)
class _VisibleRays:
    """The rays (r, depth(r)) of a division camera in the plane of the axis, for r ≤ end."""

    focal_px: float
    center_px: tuple[float, float]
    terms: Terms
    image_size: tuple[int, int]

    @property
    def end(self) -> float:
        """The radius of the farthest corner, or of the fold if that is smaller."""
        corner = corner_radius_px(self.image_size, self.center_px) / self.focal_px
        return min(corner, fold_radius(self.terms))

    def depth(self, r: Array) -> Array:
        return ray_depth(r**2, self.terms)

    def measured(self, distortion_model: str, coefficients: tuple[float, ...]) -> CameraInfoModel:
        """Make a model with its residual, which is infinite if the model folds in the image."""
        f, c = self.focal_px, self.center_px
        model = CameraInfoModel(distortion_model, coefficients, (f, f), c, 0.0, self.image_size)
        r = np.linspace(0.0, self.end, _MEASURED)
        pixels = model.project(np.stack([r, np.zeros_like(r), self.depth(r)], axis=1))
        away_px = np.abs(pixels[:, 0] - c[0] - f * r)
        away_px[np.isnan(away_px)] = np.inf
        return replace(model, residual_px=float(away_px.max()))


def _fit_equidistant(seen: _VisibleRays, r: Array, angle_rad: Array) -> CameraInfoModel:
    """Fit θ (1 + k1 θ² + ...), which is linear, with as many terms as stay monotonic."""
    powers = angle_rad[:, None] ** [3, 5, 7, 9]
    for terms in (4, 3, 2, 1, 0):
        found = np.linalg.lstsq(powers[:, :terms], r - angle_rad, rcond=None)[0]
        model = seen.measured('equidistant', (*found.tolist(), *[0.0] * (4 - terms)))
        if model.residual_px < math.inf:
            break
    return model


def _fit_rational(k: float, r: Array, rho: Array, focal_px: float) -> tuple[float, ...]:
    """Refine the closed form over the image by Levenberg-Marquardt, in pixels."""
    # In q = ρ² over its largest value, each coefficient is its effect at the image's corner.
    farthest2 = float(rho[-1]) ** 2
    powers = (rho[:, None] ** 2 / farthest2) ** [1, 2, 3]
    units = farthest2 ** np.array([1.0, 2.0, 3.0, 1.0, 2.0, 3.0])
    k1, k2, _, _, k3, k4, k5, k6 = closed_form(k)
    at = np.array([k1, k2, k3, k4, k5, k6]) * units
    error, jacobian = _linearised(at, powers, r, rho, focal_px)
    damping = _START_DAMPING
    for _ in range(_MAX_STEPS):
        cost = error @ error
        if cost < len(r) * _EXACT_PX**2 or not damping < _MAX_DAMPING:
            break
        tried = at - _damped_step(jacobian, error, damping)
        error_there, jacobian_there = _linearised(tried, powers, r, rho, focal_px)
        if not error_there @ error_there < cost:
            damping *= 10.0
            continue
        at, error, jacobian = tried, error_there, jacobian_there
        damping /= 10.0
        if cost - error @ error < _STILL_FALLING * cost:
            break
    k1, k2, k3, k4, k5, k6 = (at / units).tolist()
    return k1, k2, 0.0, 0.0, k3, k4, k5, k6


def _linearised(
    at: Array, powers: Array, r: Array, rho: Array, focal_px: float
) -> tuple[Array, Array]:
    """Return the errors ρ N/D - r in px (n,) and their derivatives (n, 6)."""
    with np.errstate(all='ignore'):
        top, bottom = 1.0 + powers @ at[:3], 1.0 + powers @ at[3:]
        by_top = focal_px * rho / bottom
        error = by_top * top - focal_px * r
        jacobian = np.hstack(
            [by_top[:, None] * powers, (-by_top * top / bottom)[:, None] * powers]
        )
    return error, jacobian


def _damped_step(jacobian: Array, error: Array, damping: float) -> Array:
    # By orthogonalisation: the six columns are nearly dependent, and JᵀJ would lose the digits.
    scale = np.linalg.norm(jacobian, axis=0)
    scaled = np.vstack([jacobian / scale, math.sqrt(damping) * np.eye(6)])
    step: Array = np.linalg.lstsq(scaled, np.append(error, np.zeros(6)), rcond=None)[0] / scale
    return step
