# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""
``DivisionCamera``: the division model of a lens with radial distortion, one to three terms.

The pixel at the distance r from the centre (in focal lengths) sees the ray (r, w) in the plane of
the optical axis, with  w(r²) = 1 + k r² + k2 r⁴ + k3 r⁶.  The functions below the class are that
polynomial, the projection, and the conversion to the closest CameraInfo model.
"""

from __future__ import annotations

from dataclasses import dataclass
import math

import numpy as np
from numpy.typing import ArrayLike

from .camera_info import CameraInfoModel, check_magnitudes, corner_radius_px, lens_map
from ..geometry import Array, as_points, finite_numbers
from ..linalg import smallest_positive_root

# k, k2, k3.
Terms = tuple[float, float, float]

# With two or three terms the projection has no closed form: a table, then Newton's method.
_TABLE_SIZE = 1024
_NEWTON_STEPS = 4
_LAST = 1.0 - 1e-6  # of r / (1 + r) in the table

# With a larger residual, px, the equidistant model is fitted too.
_GOOD_ENOUGH_PX = 0.1
_SAMPLES = 300
_MEASURED = 4000  # radii at which the residual is measured
# Smallest Z / ρ of a ray: closer to 90 degrees it hardly reaches the plane in front.
_SIDEWAYS = 0.01

_MAX_STEPS = 60
_EXACT_PX = 1e-6  # far below the noise of any image: the fit ends
_STILL_FALLING = 1e-3  # smallest relative decrease of the cost for another step
_START_DAMPING, _MAX_DAMPING = 1e-3, 1e6


_NUMBERS = ('focal_px', 'k', 'k2', 'k3')


@dataclass(frozen=True, slots=True, repr=False)
class DivisionCamera:
    """
    Division model (Fitzgibbon, CVPR 2001), with two more terms for wide lenses.

    Pixel u sees the ray (d, 1 + k |d|² + k2 |d|⁴ + k3 |d|⁶) of the optical frame (x right,
    y down, z forward), where d = (u - center_px) / focal_px. Pixel centres are integers, as in
    ROS and OpenCV.

    Parameters
    ----------
    focal_px
        Focal length at the centre of the image, pixels, > 0.
    center_px
        (x, y) of principal point and distortion centre, pixels.
    k, k2, k3
        Distortion, dimensionless (of d, as in COLMAP and PoseLib); negative k is barrel. The
        k of Oskarsson's paper, in px⁻², is k / focal_px².

    Raises
    ------
    ValueError
        A number is not finite, focal_px is not positive, or a number is extreme: its powers would
        not be finite.

    """

    focal_px: float
    center_px: tuple[float, float]
    k: float = 0.0
    k2: float = 0.0
    k3: float = 0.0

    def __post_init__(self) -> None:
        x, y = as_points(self.center_px, 'center_px', (2,)).tolist()
        object.__setattr__(self, 'center_px', (x, y))
        given = (self.focal_px, self.k, self.k2, self.k3)
        for name, number in zip(_NUMBERS, finite_numbers(given, ' '.join(_NUMBERS)), strict=True):
            object.__setattr__(self, name, number)
        if not self.focal_px > 0.0:
            raise ValueError(f'focal_px must be > 0, got {self.focal_px}')
        check_magnitudes((self.focal_px,), self.center_px, self.terms)

    @classmethod
    def unchecked(
        cls,
        focal_px: float,
        center_px: tuple[float, float],
        k: float,
        k2: float = 0.0,
        k3: float = 0.0,
    ) -> DivisionCamera:
        """Make a camera from numbers that a kernel has checked; ten times faster."""
        camera = object.__new__(cls)
        object.__setattr__(camera, 'center_px', center_px)
        for name, number in zip(_NUMBERS, (focal_px, k, k2, k3), strict=True):
            object.__setattr__(camera, name, number)
        return camera

    def __repr__(self) -> str:
        x, y = self.center_px
        names = ('k', 'k2', 'k3')[: self.order]
        terms = ', '.join(f'{name}={getattr(self, name):.5g}' for name in names)
        return (
            f'DivisionCamera(focal_px={self.focal_px:.6g}, center_px=({x:.6g}, {y:.6g}), {terms})'
        )

    @property
    def terms(self) -> Terms:
        """The coefficients k, k2, k3."""
        return self.k, self.k2, self.k3

    @property
    def order(self) -> int:
        """The number of terms of the division polynomial: 1 to 3."""
        return 3 if self.k3 != 0.0 else 2 if self.k2 != 0.0 else 1

    @property
    def matrix(self) -> Array:
        """The (3, 3) camera matrix K, without the distortion."""
        (x, y), f = self.center_px, self.focal_px
        return np.array([[f, 0.0, x], [0.0, f, y], [0.0, 0.0, 1.0]])

    def unproject(self, points_px: ArrayLike) -> Array:
        """Return the rays (..., 3) that pixels (..., 2) see: not unit, in the optical frame."""
        d = (np.asarray(points_px, dtype=np.float64) - self.center_px) / self.focal_px
        depth = _ray_depth(np.sum(d**2, axis=-1, keepdims=True), self.terms)
        return np.concatenate([d, depth], axis=-1)

    def project(self, points_in_camera: ArrayLike) -> Array:
        """
        Project points (..., 3) of the optical frame to pixels (..., 2).

        NaN if no pixel sees the point: on the backward axis, and beyond the outermost ray of a
        lens with k > 0. A camera with k < 0 sees points behind its image plane (Z ≤ 0) too.
        """
        points = np.asarray(points_in_camera, dtype=np.float64)
        xy, z = points[..., :2], points[..., 2:]
        if self.order == 1:
            scale = _closed_form_scale(self.k, np.sum(xy**2, axis=-1, keepdims=True), z)
        else:
            scale = self._wide_scale(np.linalg.norm(xy, axis=-1, keepdims=True), z)
        pixels: Array = self.focal_px * scale * xy + self.center_px
        return pixels

    def to_camera_info_model(self, image_size: tuple[int, int]) -> CameraInfoModel:
        """
        Return the closest camera in a model of CameraInfo, for image_proc.

        rational_polynomial if it is within 0.1 px over an image of image_size (width, height);
        otherwise rational_polynomial or equidistant, whichever is closer. residual_px of the
        result is its largest error. Pixels beyond the fold of a lens with k > 0 are excluded.
        """
        return _fit_camera_info_model(self, image_size)

    def _wide_scale(self, rho: Array, z: Array) -> Array:
        """Return |d| / ρ of points at the distance ρ from the axis and the depth z."""
        radii, angles = self._angle_table()
        angle = np.arctan2(rho, z)
        r = np.interp(angle, angles, radii, right=np.nan)
        # Newton on  r z - ρ w(r) = 0,  w = 1 + k r² + k2 r⁴ + k3 r⁶, from the table's start.
        for _ in range(_NEWTON_STEPS):
            r2 = r**2
            w = _ray_depth(r2, self.terms)
            slope = 2.0 * self.k + r2 * (4.0 * self.k2 + r2 * 6.0 * self.k3)
            r = r - (r * z - rho * w) / (z - rho * r * slope)
        with np.errstate(divide='ignore', invalid='ignore'):
            scale: Array = np.where(rho > 0.0, r / rho, np.where(z > 0.0, 1.0 / z, np.nan))
        return scale

    def _angle_table(self) -> tuple[Array, Array]:
        """Sample the angle to the axis over |d|, out to the fold."""
        edge = _fold_radius(self.terms)
        # r = s / (1 - s) reaches from the axis to infinity.
        last = min(edge / (1.0 + edge), _LAST) if math.isfinite(edge) else _LAST
        s = np.linspace(0.0, last, _TABLE_SIZE)
        radii = s / (1.0 - s)
        return radii, np.arctan2(radii, _ray_depth(radii**2, self.terms))


def _closed_form_scale(k: float, rho2: Array, z: Array) -> Array:
    """Return |d| / ρ by the one-parameter model; NaN if no pixel sees the point."""
    # d = s xy on the ray (d, 1 + k |d|²) gives  k ρ² s² - z s + 1 = 0. Of its two roots this one
    # is continuous at k = 0. Each of its two forms avoids cancellation on one side of z = 0.
    with np.errstate(all='ignore'):
        root = np.sqrt(z**2 - 4.0 * k * rho2)  # NaN outside the domain
        s = np.where(z < 0.0, (z - root) / (2.0 * k * rho2), 2.0 / (z + root))
        scale: Array = np.where(np.isfinite(s) & (s > 0.0), s, np.nan)
    return scale


def _ray_depth(r2: Array, terms: Terms) -> Array:
    """Return w at squared radii, any shape."""
    k, k2, k3 = terms
    depth: Array = 1.0 + r2 * (k + r2 * (k2 + r2 * k3))
    return depth


def _fold_radius(terms: Terms) -> float:
    """Return the radius up to which the angle to the axis grows; infinite if it always does."""
    k, k2, k3 = terms
    # The angle atan2(r, w) grows with r while  w - r w' = 1 - k r² - 3 k2 r⁴ - 5 k3 r⁶ > 0.
    return math.sqrt(smallest_positive_root(np.array([1.0, -k, -3.0 * k2, -5.0 * k3])))


def _fit_camera_info_model(camera: DivisionCamera, image_size: tuple[int, int]) -> CameraInfoModel:
    """
    Return the CameraInfo model closest to a division camera.

    A lens about its axis is a function of one variable: the radius r of a pixel as a function of
    the undistorted radius ρ, or of the angle θ, of its ray. Both fits minimise errors in pixels
    over the rays of the image. docs/derivation.md has the closed form.
    """
    rays = _VisibleRays.of(camera, image_size)
    # Dense at the rim like Chebyshev nodes, which nearly minimises the largest residual.
    r = rays.end * np.sin(0.5 * np.pi * (np.arange(_SAMPLES) + 0.5) / _SAMPLES)
    depth = rays.depth(r)
    models = []
    if (depth > _SIDEWAYS * r).all():
        rational = _fit_rational(camera.k, r, r / depth, camera.focal_px)
        models.append(rays.measured('rational_polynomial', rational))
    if not models or not models[0].residual_px <= _GOOD_ENOUGH_PX:
        models.append(_fit_equidistant(rays, r, np.arctan2(r, depth)))
    return min(models, key=lambda model: model.residual_px)


def closed_form(k: float) -> tuple[float, ...]:
    """Return D of the rational_polynomial that agrees with r(ρ) up to ρ¹³, for one term k."""
    return (-5.0 * k, 6.0 * k**2, 0.0, 0.0, -(k**3), -6.0 * k, 10.0 * k**2, -4.0 * k**3)


@dataclass(frozen=True, slots=True)
class _VisibleRays:
    """
    The rays (r, depth(r)) of a division camera in the plane of the axis, for r ≤ end.

    end is the radius of the image's farthest corner, or of the fold if that is smaller.
    """

    camera: DivisionCamera
    image_size: tuple[int, int]
    end: float

    @classmethod
    def of(cls, camera: DivisionCamera, image_size: tuple[int, int]) -> _VisibleRays:
        corner = corner_radius_px(image_size, camera.center_px) / camera.focal_px
        return cls(camera, image_size, min(corner, _fold_radius(camera.terms)))

    def depth(self, r: Array) -> Array:
        return _ray_depth(r**2, self.camera.terms)

    def measured(self, distortion_model: str, coefficients: tuple[float, ...]) -> CameraInfoModel:
        """Make a model with its residual, which is infinite if the model folds in the image."""
        f, c = self.camera.focal_px, self.camera.center_px
        r = np.linspace(0.0, self.end, _MEASURED)
        rays = np.stack([r, np.zeros_like(r), self.depth(r)], axis=1)
        x_px = lens_map(distortion_model, coefficients).distort(rays)[:, 0] * f + c[0]
        error_px = np.abs(x_px - c[0] - f * r)
        error_px[np.isnan(error_px)] = np.inf
        residual_px = float(error_px.max())
        return CameraInfoModel(
            distortion_model, coefficients, (f, f), c, residual_px, self.image_size
        )


def _fit_equidistant(rays: _VisibleRays, r: Array, angle_rad: Array) -> CameraInfoModel:
    """Fit θ (1 + k1 θ² + ...), a linear problem, with the most terms that stay monotonic."""
    powers = angle_rad[:, None] ** [3, 5, 7, 9]
    for terms in (4, 3, 2, 1, 0):
        fitted = np.linalg.lstsq(powers[:, :terms], r - angle_rad, rcond=None)[0]
        model = rays.measured('equidistant', (*fitted.tolist(), *[0.0] * (4 - terms)))
        if model.residual_px < math.inf:
            break
    return model


def _fit_rational(k: float, r: Array, rho: Array, focal_px: float) -> tuple[float, ...]:
    """Refine the closed form over the image by Levenberg-Marquardt, in pixels."""
    # With q = ρ² over its largest value, each coefficient is its effect at the image's corner.
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
        trial = at - _damped_step(jacobian, error, damping)
        trial_error, trial_jacobian = _linearised(trial, powers, r, rho, focal_px)
        if not trial_error @ trial_error < cost:
            damping *= 10.0
            continue
        at, error, jacobian = trial, trial_error, trial_jacobian
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
    # By lstsq on J itself: its six columns are nearly dependent, which JᵀJ would not resolve.
    scale = np.linalg.norm(jacobian, axis=0)
    scaled = np.vstack([jacobian / scale, math.sqrt(damping) * np.eye(6)])
    step: Array = np.linalg.lstsq(scaled, np.append(error, np.zeros(6)), rcond=None)[0] / scale
    return step
