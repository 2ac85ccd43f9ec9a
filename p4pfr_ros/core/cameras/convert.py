# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""
Conversion from a division camera to the closest CameraInfo model.

Both fits minimise errors in pixels over the rays that the camera was seen to have: beyond the
outermost point a lens polynomial is an extrapolation, and would spoil the fit inside. There the
model must only stay monotonic.

This module stands alone because it is least squares; ``division`` is the camera.
"""

from __future__ import annotations

from dataclasses import dataclass
import math
from typing import Protocol

import numpy as np

from .camera_info import CameraInfoModel, corner_radius_px, lens_map
from ..geometry import Array

# With a larger residual, px, the equidistant model is fitted too.
_GOOD_ENOUGH_PX = 0.1
_SAMPLES = 300
_MEASURED = 4000  # radii at which the residual is measured
# Of a decentred lens: directions, and fewer radii.
_AZIMUTHS = 8
_FEWER = 10
# Smallest Z / ρ of a ray: closer to 90 degrees it hardly reaches the plane in front.
_SIDEWAYS = 0.01

# The fit reaches beyond the outermost point by this share of its radius.
_MARGIN = 0.03
# Beyond, the equidistant model follows a straight line with the smallest of these weights that
# makes it monotonic.
_BEYOND_WEIGHTS = (0.0, 1e-4, 1e-3, 1e-2, 1e-1, 1.0)
_BEYOND_SAMPLES = 60
_NEARLY = 0.999

_SMALLEST_Q = 1e-90  # its third power is a number

_MAX_STEPS = 60
_EXACT_PX = 1e-6  # far below the noise of any image: the fit ends
_STILL_FALLING = 1e-3  # smallest relative decrease of the cost for another step
_START_DAMPING, _MAX_DAMPING = 1e-3, 1e6


class RadialCamera(Protocol):
    """What the conversion needs of a ``DivisionCamera``, which imports this module."""

    @property
    def focal_px(self) -> float:
        """Focal length fx, px."""
        ...

    @property
    def focal_xy_px(self) -> tuple[float, float]:
        """(fx, fy), px."""
        ...

    @property
    def center_px(self) -> tuple[float, float]:
        """The principal point, px."""
        ...

    @property
    def k(self) -> float:
        """The first term."""
        ...

    @property
    def p1(self) -> float:
        """Decentring."""
        ...

    @property
    def p2(self) -> float:
        """Decentring."""
        ...

    @property
    def is_decentred(self) -> bool:
        """Whether p1 or p2 is not zero."""
        ...

    @property
    def fold_radius(self) -> float:
        """The |e| up to which rays turn away from the axis."""
        ...

    def unproject(self, points_px: Array) -> Array:
        """Return the rays (..., 3) that pixels (..., 2) see."""
        ...


def camera_info_from_division(
    camera: RadialCamera, image_size: tuple[int, int], seen_radius_px: float | None
) -> CameraInfoModel:
    """Return the CameraInfo model closest to a division camera; see its method."""
    rays = _VisibleRays.of(camera, image_size, seen_radius_px)
    models = []
    rational = _fit_rational(rays)
    if rational is not None:
        models.append(rays.measured('rational_polynomial', rational))
    if not models or not models[0].residual_px <= _GOOD_ENOUGH_PX:
        models.append(_fit_equidistant(rays))
    return min(models, key=lambda model: model.residual_px)


def closed_form(k: float) -> tuple[float, ...]:
    """Return D of the rational_polynomial that agrees with r(ρ) up to ρ¹³, for one term k."""
    return (-5.0 * k, 6.0 * k**2, 0.0, 0.0, -(k**3), -6.0 * k, 10.0 * k**2, -4.0 * k**3)


@dataclass(frozen=True, slots=True)
class _VisibleRays:
    """
    The rays of a division camera, by the radius r = |d| of their pixels.

    seen: radius up to which the model is to be close; end: that of the image's farthest corner,
    or of the fold if that is smaller; corner: of the corner.
    """

    camera: RadialCamera
    image_size: tuple[int, int]
    seen: float
    end: float
    corner: float

    @classmethod
    def of(
        cls, camera: RadialCamera, image_size: tuple[int, int], seen_radius_px: float | None
    ) -> _VisibleRays:
        corner = corner_radius_px(image_size, camera.center_px) / min(camera.focal_xy_px)
        end = min(corner, camera.fold_radius)
        seen = end
        if seen_radius_px is not None:
            seen = min(end, (1.0 + _MARGIN) * seen_radius_px / camera.focal_px)
        return cls(camera, image_size, seen, end, corner)

    def samples(self) -> Array:
        """Return radii (n,) that are dense at the rim."""
        # Like Chebyshev nodes, which nearly minimises the largest residual.
        n = self._number(_SAMPLES)
        return self.seen * np.sin(0.5 * np.pi * (np.arange(n) + 0.5) / n)

    def _number(self, radii: int) -> int:
        """Return the number of radii: all around fewer are enough."""
        return radii // _FEWER if self.camera.is_decentred else radii

    def pixels_and_rays(self, radii: Array) -> tuple[Array, Array]:
        """Return points d (n, 2) with these radii, all around if that matters, and their rays."""
        azimuths = 2.0 * np.pi * np.arange(_AZIMUTHS) / _AZIMUTHS
        if not self.camera.is_decentred:
            azimuths = azimuths[:1]
        around = np.stack([np.cos(azimuths), np.sin(azimuths)], axis=-1)
        d = (radii[:, None, None] * around).reshape(-1, 2)
        rays = self.camera.unproject(d * self.camera.focal_xy_px + self.camera.center_px)
        return d, rays

    def measured(self, distortion_model: str, coefficients: tuple[float, ...]) -> CameraInfoModel:
        """Make a model with its residuals, infinite if the model folds in the image."""
        residual_px, outside_px = (
            self._residual_px(distortion_model, coefficients, low, high)
            for low, high in ((0.0, self.seen), (self.seen, self.end))
        )
        if not outside_px < math.inf:
            residual_px = math.inf
        camera = self.camera
        return CameraInfoModel(
            distortion_model,
            coefficients,
            camera.focal_xy_px,
            camera.center_px,
            residual_px,
            self.image_size,
            outside_px,
        )

    def _residual_px(
        self, distortion_model: str, coefficients: tuple[float, ...], low: float, high: float
    ) -> float:
        if not high > low:
            return 0.0
        d, rays = self.pixels_and_rays(np.linspace(low, high, self._number(_MEASURED)))
        error = lens_map(distortion_model, coefficients).distort(rays) - d
        error_px = np.linalg.norm(error * self.camera.focal_xy_px, axis=1)
        return float(np.nan_to_num(error_px, nan=np.inf).max())


def _fit_equidistant(rays: _VisibleRays) -> CameraInfoModel:
    """Fit θ (1 + k1 θ² + ...), a linear problem, with the most terms that stay monotonic."""
    d, directions = rays.pixels_and_rays(rays.samples())
    r = np.linalg.norm(d, axis=1)
    angle_rad = np.arctan2(np.linalg.norm(directions[:, :2], axis=1), directions[:, 2])
    beyond_rad, beyond = _straight_beyond(r, angle_rad, rays.corner)
    angles, radii = np.append(angle_rad, beyond_rad), np.append(r, beyond)
    powers = angles[:, None] ** [3, 5, 7, 9]
    for terms in (4, 3, 2, 1, 0):
        for weight in _BEYOND_WEIGHTS if terms == 4 else (_BEYOND_WEIGHTS[-1],):
            weights = np.append(np.ones(len(r)), np.full(len(beyond), weight))
            fitted = np.linalg.lstsq(
                weights[:, None] * powers[:, :terms], weights * (radii - angles), rcond=None
            )[0]
            coefficients = (*fitted.tolist(), *[0.0] * (4 - terms))
            model = rays.measured('equidistant', coefficients)
            if model.residual_px < math.inf and _reaches(coefficients, beyond[-1]):
                return model
    return model


def _straight_beyond(r: Array, angle_rad: Array, corner: float) -> tuple[Array, Array]:
    """Return angles and radii of a straight line from the last sample to the corner."""
    slope = (r[-1] - r[-_AZIMUTHS - 1]) / max(angle_rad[-1] - angle_rad[-_AZIMUTHS - 1], 1e-12)
    slope = max(slope, 0.1 * r[-1] / max(angle_rad[-1], 1e-12))
    last_rad = min(angle_rad[-1] + max(corner - r[-1], 0.0) / slope, math.pi)
    beyond_rad = np.linspace(angle_rad[-1], last_rad, _BEYOND_SAMPLES + 1)[1:]
    return beyond_rad, r[-1] + slope * (beyond_rad - angle_rad[-1])


def _reaches(coefficients: tuple[float, ...], radius: float) -> bool:
    """Return whether the equidistant model grows up to nearly a radius, or farther."""
    radii = lens_map('equidistant', coefficients).radii(np.linspace(0.0, math.pi, 1000))
    grows = np.logical_and.accumulate(np.diff(radii, prepend=-1.0) > 0.0)
    return bool(radii[grows][-1] >= _NEARLY * radius)


def _fit_rational(rays: _VisibleRays) -> tuple[float, ...] | None:
    """
    Refine the closed form by Levenberg-Marquardt, in pixels.

    None if the rays do not all reach the plane in front of the camera.
    """
    d, directions = rays.pixels_and_rays(np.append(rays.samples(), rays.end))
    rho = np.linalg.norm(directions[:, :2], axis=1)
    if not (directions[:, 2] > _SIDEWAYS * rho).all():
        return None
    around = _AZIMUTHS if rays.camera.is_decentred else 1
    flat, d = (directions[:, :2] / directions[:, 2:])[:-around], d[:-around]
    fit = _RationalFit(flat, d, np.array(rays.camera.focal_xy_px), rays.camera.is_decentred)
    # With q = ρ² over its largest value, each coefficient is its effect at the rim.
    k1, k2, _, _, k3, k4, k5, k6 = closed_form(rays.camera.k)
    p1, p2 = -rays.camera.p1, -rays.camera.p2
    at = fit.refined(np.array([k1, k2, k3, k4, k5, k6, p1, p2]) * fit.units)
    k1, k2, k3, k4, k5, k6, p1, p2 = (at / fit.units).tolist()
    return k1, k2, p1, p2, k3, k4, k5, k6


class _RationalFit:
    """Least squares of a rational_polynomial: points flat (n, 2) of rays to points d (n, 2)."""

    def __init__(self, flat: Array, d: Array, focal_px: Array, decentred: bool) -> None:
        self._flat, self._d, self._focal_px = flat, d, focal_px
        q = np.sum(flat**2, axis=1)
        farthest2 = max(float(q.max()), _SMALLEST_Q)
        self._powers = (q[:, None] / farthest2) ** [1, 2, 3]
        self.units = np.append(farthest2 ** np.array([1.0, 2.0, 3.0, 1.0, 2.0, 3.0]), [1.0, 1.0])
        x, y = flat.T
        self._tangential = np.stack(
            [np.stack([2.0 * x * y, q + 2.0 * x * x]), np.stack([q + 2.0 * y * y, 2.0 * x * y])]
        )
        self._free = 8 if decentred else 6

    def refined(self, at: Array) -> Array:
        """Return the optimum, from a start (8,) in the units."""
        error, jacobian = self._linearised(at)
        damping = _START_DAMPING
        for _ in range(_MAX_STEPS):
            cost = error @ error
            if cost < len(error) * _EXACT_PX**2 or not damping < _MAX_DAMPING:
                break
            trial = at.copy()
            trial[: self._free] -= _damped_step(jacobian, error, damping)
            trial_error, trial_jacobian = self._linearised(trial)
            if not trial_error @ trial_error < cost:
                damping *= 10.0
                continue
            at, error, jacobian = trial, trial_error, trial_jacobian
            damping /= 10.0
            if cost - error @ error < _STILL_FALLING * cost:
                break
        return at

    def _linearised(self, at: Array) -> tuple[Array, Array]:
        """Return the errors in px (2 n,) and their derivatives (2 n, free)."""
        with np.errstate(all='ignore'):
            top, bottom = 1.0 + self._powers @ at[:3], 1.0 + self._powers @ at[3:6]
            errors, jacobians = [], []
            for j in range(2):
                by_top = self._focal_px[j] * self._flat[:, j] / bottom
                tangential = self._focal_px[j] * self._tangential[j].T
                errors.append(
                    by_top * top + tangential @ at[6:] - self._focal_px[j] * self._d[:, j]
                )
                columns = (
                    by_top[:, None] * self._powers,
                    (-by_top * top / bottom)[:, None] * self._powers,
                    tangential,
                )
                jacobians.append(np.hstack(columns)[:, : self._free])
        return np.concatenate(errors), np.vstack(jacobians)


def _damped_step(jacobian: Array, error: Array, damping: float) -> Array:
    # By lstsq on J itself: its columns are nearly dependent, which JᵀJ would not resolve.
    length = np.linalg.norm(jacobian, axis=0)
    scale = np.where(length > 0.0, length, 1.0)
    n = len(scale)
    scaled = np.vstack([jacobian / scale, math.sqrt(damping) * np.eye(n)])
    step: Array = np.linalg.lstsq(scaled, np.append(error, np.zeros(n)), rcond=None)[0] / scale
    return step
