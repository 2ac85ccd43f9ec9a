# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""
The division model in the words of image_proc: rational_polynomial, or equidistant.

With the lens' axis in the centre the whole picture is one function of one number: the radius r of
a pixel over the undistorted radius ρ, or over the angle θ, of its ray. Both fits are over the
pixels' rays out to the picture's corners, in pixels. docs/derivation.md has the closed form.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
import math

import numpy as np

from .camera_info import CameraInfoModel, corner_radius_px
from .lens_maps import smallest_positive_root
from ..geometry import Array

# Beyond this, px, the fisheye model is tried too.
_GOOD_ENOUGH_PX = 0.1
_SAMPLES = 300
_MEASURED = 4000  # radii at which the residual is
# Z over the distance to the axis: no plane before the camera reaches rays that point so far aside.
_SIDEWAYS = 0.01

_MAX_STEPS = 60
_EXACT_PX = 1e-6  # no picture shows that: the fit stops
_STILL_FALLING = 1e-3  # of the cost, for another step to be worth it
_START_DAMPING, _MAX_DAMPING = 1e-3, 1e6


def fit_camera_info_model(
    focal_px: float,
    center_px: tuple[float, float],
    k: tuple[float, float, float],
    image_size: tuple[int, int],
) -> CameraInfoModel:
    """
    Return the model that image_proc knows and that is closest to a division camera's k, k2, k3.

    rational_polynomial where it is within 0.1 px all over the picture, else it or equidistant,
    whichever is closer. Focal length and centre are the division camera's.
    """
    seen = _Seen(focal_px, center_px, k, image_size)
    # Dense at the rim, as Chebyshev's nodes are: the largest residual is about the smallest.
    r = seen.end * np.sin(0.5 * np.pi * (np.arange(_SAMPLES) + 0.5) / _SAMPLES)
    depth = seen.depth(r)
    models = []
    if (depth > _SIDEWAYS * r).all():
        rational = _fit_rational(k[0], r, r / depth, focal_px)
        models.append(seen.measured('rational_polynomial', rational))
    if not models or not models[0].residual_px <= _GOOD_ENOUGH_PX:
        models.append(_fit_equidistant(seen, r, np.arctan2(r, depth)))
    return min(models, key=lambda model: model.residual_px)


def closed_form(k: float) -> tuple[float, ...]:
    """Return D of the rational_polynomial that agrees with r(ρ) up to the order ρ¹³."""
    return (-5.0 * k, 6.0 * k**2, 0.0, 0.0, -(k**3), -6.0 * k, 10.0 * k**2, -4.0 * k**3)


@dataclass(frozen=True, slots=True)
class _Seen:
    """What a division camera sees: the ray (r, depth(r)), in the plane of the axis, at r ≤ end."""

    focal_px: float
    center_px: tuple[float, float]
    k: tuple[float, float, float]
    image_size: tuple[int, int]

    @property
    def end(self) -> float:
        """The farthest corner, or where the rays turn back if that comes first."""
        corner = corner_radius_px(self.image_size, self.center_px) / self.focal_px
        k, k2, k3 = self.k
        # The angle atan2(r, w) grows with r while  w - r w' = 1 - k r² - 3 k2 r⁴ - 5 k3 r⁶ > 0.
        fold = smallest_positive_root(np.array([1.0, -k, -3.0 * k2, -5.0 * k3]))
        return min(corner, math.sqrt(fold))

    def depth(self, r: Array) -> Array:
        k, k2, k3 = self.k
        r2 = r**2
        depth: Array = 1.0 + r2 * (k + r2 * (k2 + r2 * k3))
        return depth

    def measured(self, distortion_model: str, coefficients: tuple[float, ...]) -> CameraInfoModel:
        """Make a model with its residual: infinite where it folds inside of the picture."""
        f, c = self.focal_px, self.center_px
        model = CameraInfoModel(distortion_model, coefficients, (f, f), c, 0.0, self.image_size)
        r = np.linspace(0.0, self.end, _MEASURED)
        pixels = model.project(np.stack([r, np.zeros_like(r), self.depth(r)], axis=1))
        away_px = np.abs(pixels[:, 0] - c[0] - f * r)
        away_px[np.isnan(away_px)] = np.inf
        return replace(model, residual_px=float(away_px.max()))


def _fit_equidistant(seen: _Seen, r: Array, angle_rad: Array) -> CameraInfoModel:
    """Fit θ (1 + k1 θ² + ...), which is linear, with as many terms as stay monotonic."""
    powers = angle_rad[:, None] ** [3, 5, 7, 9]
    for terms in (4, 3, 2, 1, 0):
        found = np.linalg.lstsq(powers[:, :terms], r - angle_rad, rcond=None)[0]
        model = seen.measured('equidistant', (*found.tolist(), *[0.0] * (4 - terms)))
        if model.residual_px < math.inf:
            break
    return model


def _fit_rational(k: float, r: Array, rho: Array, focal_px: float) -> tuple[float, ...]:
    """Refine the closed form over the picture: Levenberg and Marquardt's method, in pixels."""
    # In q = ρ² over its largest, each coefficient says what it does at the picture's corner.
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
    # As a least-squares problem: the six columns are nearly dependent, their squares would be so.
    scale = np.linalg.norm(jacobian, axis=0)
    scaled = np.vstack([jacobian / scale, math.sqrt(damping) * np.eye(6)])
    step: Array = np.linalg.lstsq(scaled, np.append(error, np.zeros(6)), rcond=None)[0] / scale
    return step
