# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""
``CameraInfoModel``: a camera in a model of sensor_msgs/CameraInfo, computed as in OpenCV.

Each lens maps rays to the plane of unit focal length. The map is one to one up to its first fold,
and NaN beyond it: where the polynomial decreases, two rays would have the same pixel.
"""

from __future__ import annotations

from dataclasses import dataclass
import math
from typing import Protocol

import numpy as np
from numpy.polynomial import polynomial as poly
from numpy.typing import ArrayLike

from ..geometry import Array, as_points, finite_numbers
from ..linalg import smallest_positive_root

# Beyond these limits no calibration of a camera is believed: the doors of the package (files and
# messages) reject it. Focal length and centre, px; coefficients.
MIN_FOCAL_PX, MAX_NUMBER = 1e-3, 1e7

# Beyond these, powers of the numbers may not be finite: in any unit they are no camera.
_SMALLEST_FOCAL, _LARGEST_NUMBER = 1e-30, 1e30

# Number of coefficients of each model. A plumb_bob with four has k3 = 0.
COEFFICIENTS = {'plumb_bob': 5, 'rational_polynomial': 8, 'equidistant': 4}

# Far beyond any sensor.
_LARGEST_SIDE_PX = 10_000_000

_TABLE_SIZE = 1024
_MAX_STEPS = 20
# In the plane of unit focal length: 1e-10 px at a focal length of 1000 px.
_CONVERGED = 1e-13
# A ray closer to 90 degrees than this does not reach the plane in front of the camera.
_NEARLY_SIDEWAYS_RAD = 1e-6
# A rational polynomial is used up to this share of its pole.
_BEFORE_POLE = 1.0 - 1e-9


@dataclass(frozen=True, slots=True)
class CameraInfoModel:
    """
    A calibrated camera in one of the models that image_proc supports.

    Parameters
    ----------
    distortion_model
        plumb_bob, rational_polynomial or equidistant (OpenCV's fisheye).
    coefficients
        D of CameraInfo: 5, 8 or 4 numbers in its order; plumb_bob may omit the last.
    focal_px, center_px
        (fx, fy) and (cx, cy) of K, in the full raw image; pixel centres are integers.
    residual_px
        If the model approximates another camera: the largest distance in the image between the
        pixels of one ray in the two. Otherwise 0.
    image_size
        Width and height of the full raw image, pixels.
    residual_outside_px
        The same distance where the other camera was not seen, and is an extrapolation itself.
    skew_px
        The entry of K between fx and cx: the shift of u for each unit of y in the plane. OpenCV's
        fisheye calibration writes alpha fx there. image_proc ignores it.

    Raises
    ------
    ValueError
        An unknown model, a wrong number of coefficients, or a number out of its range.

    """

    distortion_model: str
    coefficients: tuple[float, ...]
    focal_px: tuple[float, float]
    center_px: tuple[float, float]
    residual_px: float
    image_size: tuple[int, int]
    residual_outside_px: float = 0.0
    skew_px: float = 0.0

    def __post_init__(self) -> None:
        object.__setattr__(self, 'coefficients', self._checked_coefficients())
        (skew_px,) = finite_numbers((self.skew_px,), 'skew_px')
        object.__setattr__(self, 'skew_px', skew_px)
        for name in ('focal_px', 'center_px'):
            x, y = as_points(getattr(self, name), name, (2,)).tolist()
            object.__setattr__(self, name, (x, y))
        if not min(self.focal_px) > 0.0:
            raise ValueError(f'focal_px must be > 0, got {self.focal_px}')
        check_magnitudes(self.focal_px, self.center_px)
        if not abs(skew_px) <= self.focal_px[0]:
            raise ValueError(f'skew_px must be at most fx = {self.focal_px[0]}, got {skew_px}')
        for name in ('residual_px', 'residual_outside_px'):
            if not getattr(self, name) >= 0.0:
                raise ValueError(f'{name} must be ≥ 0, got {getattr(self, name)}')
        width, height = checked_image_size(self.image_size)
        object.__setattr__(self, 'image_size', (int(width), int(height)))

    def project(self, points_in_camera: ArrayLike) -> Array:
        """
        Project points (..., 3) of the optical frame to raw pixels (..., 2).

        NaN for points that the lens does not see: beyond the model's first fold, and for Z ≤ 0
        (equidistant: on the backward axis only).
        """
        points = np.asarray(points_in_camera, dtype=np.float64)
        lens = lens_map(self.distortion_model, self.coefficients)
        flat = lens.distort(points.reshape(-1, 3)).reshape(*points.shape[:-1], 2)
        pixels: Array = flat * self.focal_px + self.center_px
        pixels[..., 0] += self.skew_px * flat[..., 1]
        return pixels

    def unproject(self, points_px: ArrayLike) -> Array:
        """
        Return the unit rays (..., 3) that raw pixels (..., 2) see; NaN if there is none.

        Exact: iterated until they project back to their pixel within rounding.
        """
        pixels = np.asarray(points_px, dtype=np.float64)
        flat = (pixels - self.center_px) / self.focal_px
        flat[..., 0] -= self.skew_px / self.focal_px[0] * flat[..., 1]
        lens = lens_map(self.distortion_model, self.coefficients)
        return lens.undistort(flat.reshape(-1, 2)).reshape(*pixels.shape[:-1], 3)

    def _checked_coefficients(self) -> tuple[float, ...]:
        if self.distortion_model not in COEFFICIENTS:
            raise ValueError(
                f'distortion_model must be one of {", ".join(COEFFICIENTS)}, '
                f'got {self.distortion_model!r}'
            )
        expected = COEFFICIENTS[self.distortion_model]
        given = finite_numbers(self.coefficients, 'coefficients')
        if self.distortion_model == 'plumb_bob' and len(given) == expected - 1:
            given = (*given, 0.0)
        if len(given) != expected:
            counts = f'4 or {expected}' if self.distortion_model == 'plumb_bob' else f'{expected}'
            raise ValueError(
                f'coefficients must be {counts} of {self.distortion_model}, got {len(given)}'
            )
        return given


def check_magnitudes(
    focal_px: tuple[float, ...], center_px: tuple[float, float], terms: tuple[float, ...] = ()
) -> None:
    """
    Check that powers of a camera's numbers, which are finite, are finite too.

    Raises
    ------
    ValueError
        They are not: names the number and its limit.

    """
    if not min(focal_px) >= _SMALLEST_FOCAL:
        raise ValueError(f'focal_px must be at least {_SMALLEST_FOCAL:g}, got {min(focal_px)}')
    given = {'focal_px': focal_px, 'center_px': center_px, 'terms of the distortion': terms}
    for name, numbers in given.items():
        largest = max(numbers, key=abs, default=0.0)
        if not abs(largest) <= _LARGEST_NUMBER:
            raise ValueError(f'{name} must be at most {_LARGEST_NUMBER:g}, got {largest}')


def checked_image_size(image_size: tuple[float, float]) -> tuple[float, float]:
    """
    Return an image size (width, height) as numbers.

    Raises
    ------
    ValueError
        It is not positive, or beyond every sensor.

    """
    width, height = as_points(image_size, 'image_size', (2,)).tolist()
    if not (width >= 1.0 and height >= 1.0):
        raise ValueError(f'image_size must be positive, got {image_size}')
    if not max(width, height) <= _LARGEST_SIDE_PX:
        raise ValueError(f'image_size must be at most {_LARGEST_SIDE_PX}, got {image_size}')
    return width, height


def corner_radius_px(image_size: tuple[float, float], center_px: tuple[float, float]) -> float:
    """Return the distance from the centre to the farthest outer corner of the image, px."""
    return math.hypot(
        *(max(c + 0.5, size - 0.5 - c) for c, size in zip(center_px, image_size, strict=True))
    )


class LensMap(Protocol):
    """A lens, without focal length and centre."""

    def distort(self, rays: Array) -> Array:
        """Map rays (N, 3) to the plane (N, 2); NaN beyond the fold."""
        ...

    def undistort(self, points: Array) -> Array:
        """Map points of the plane (N, 2) to unit rays (N, 3); NaN if there is none."""
        ...

    def radii(self, angles_rad: Array) -> Array:
        """Return the radii (N,) in the plane at angles to the axis, without tangential terms."""
        ...


class _PolynomialLens:
    """
    OpenCV's lens: plumb_bob (k1 k2 p1 p2 k3) and rational_polynomial (with k4 k5 k6 in addition).

    With (x, y) = (X, Y) / Z and q = x² + y², a ray (X, Y, Z) meets the plane in

        (x, y) N(q) / D(q) + (2 p1 x y + p2 (q + 2 x²), p1 (q + 2 y²) + 2 p2 x y),
        N = 1 + k1 q + k2 q² + k3 q³,    D = 1 + k4 q + k5 q² + k6 q³.
    """

    def __init__(self, coefficients: tuple[float, ...]) -> None:
        k1, k2, p1, p2, k3, k4, k5, k6 = (*coefficients, *[0.0] * (8 - len(coefficients)))
        self._tangential = p1, p2
        self._n, self._d = np.array([1.0, k1, k2, k3]), np.array([1.0, k4, k5, k6])
        # √q N / D has the slope (N D + 2 q (N' D - N D')) / D².
        with np.errstate(all='ignore'):
            self._turn = poly.polysub(
                poly.polymul(poly.polyder(self._n), self._d),
                poly.polymul(self._n, poly.polyder(self._d)),
            )
            slope = poly.polyadd(poly.polymul(self._n, self._d), 2.0 * poly.polymulx(self._turn))
        fold, pole = smallest_positive_root(slope), smallest_positive_root(self._d)
        self._q_end = min(fold, pole * _BEFORE_POLE)

    def distort(self, rays: Array) -> Array:
        """Map rays (N, 3) to the plane (N, 2); NaN beyond the fold and for Z ≤ 0."""
        with np.errstate(all='ignore'):
            flat = rays[:, :2] / np.where(rays[:, 2:] > 0.0, rays[:, 2:], np.nan)
            return self._within(flat, self._forward(flat)[0])

    def undistort(self, points: Array) -> Array:
        """Map points of the plane (N, 2) to unit rays (N, 3); NaN if there is none."""
        radius = np.linalg.norm(points, axis=1, keepdims=True)
        with np.errstate(all='ignore'):
            scale = np.tan(_angle_table(self, self._end_rad, radius)) / radius
            flat = points * np.where(radius > 0.0, scale, 1.0)
            for _ in range(_MAX_STEPS):
                reached, ((a, b), (_, d)) = self._forward(flat)
                ex, ey = (points - reached).T
                if not (np.hypot(ex, ey) > _CONVERGED).any():
                    break
                step = np.stack([d * ex - b * ey, a * ey - b * ex], axis=1)
                flat = flat + step / (a * d - b * b)[:, None]
            error = np.abs(self._forward(flat)[0] - points).max(axis=1, keepdims=True)
            close = error <= 10.0 * _CONVERGED * np.maximum(1.0, radius)
            flat = self._within(flat, np.where(close, flat, np.nan))
        rays = np.column_stack([flat, np.ones(len(flat))])
        unit: Array = rays / np.linalg.norm(rays, axis=1, keepdims=True)
        return unit

    def radii(self, angles_rad: Array) -> Array:
        """Return the radii (N,) in the plane at angles to the axis, below 90 degrees."""
        rho = np.tan(angles_rad)
        radii: Array = rho * poly.polyval(rho**2, self._n) / poly.polyval(rho**2, self._d)
        return radii

    @property
    def _end_rad(self) -> float:
        return min(math.atan(math.sqrt(self._q_end)), 0.5 * math.pi - _NEARLY_SIDEWAYS_RAD)

    def _within(self, flat: Array, values: Array) -> Array:
        q = np.sum(flat**2, axis=1, keepdims=True)
        return np.where(q <= self._q_end, values, np.nan)

    def _forward(self, flat: Array) -> tuple[Array, tuple[tuple[Array, Array], ...]]:
        """Return the points of the plane (N, 2) and their derivatives, each (N,)."""
        (x, y), (p1, p2) = flat.T, self._tangential
        q = x * x + y * y
        n, d = poly.polyval(q, self._n), poly.polyval(q, self._d)
        g, slope = n / d, 2.0 * poly.polyval(q, self._turn) / (d * d)
        points = np.stack(
            [
                x * g + 2.0 * p1 * x * y + p2 * (q + 2.0 * x * x),
                y * g + p1 * (q + 2.0 * y * y) + 2.0 * p2 * x * y,
            ],
            axis=1,
        )
        across = x * y * slope + 2.0 * (p1 * x + p2 * y)
        by_x = g + x * x * slope + 2.0 * p1 * y + 6.0 * p2 * x
        by_y = g + y * y * slope + 6.0 * p1 * y + 2.0 * p2 * x
        return points, ((by_x, across), (across, by_y))


class _EquidistantLens:
    """
    OpenCV's fisheye lens, equidistant in ROS.

    A ray at the angle θ to the axis has the radius θ (1 + k1 θ² + k2 θ⁴ + k3 θ⁶ + k4 θ⁸) in the
    plane, rays from behind the image plane (θ above 90°) included.
    """

    def __init__(self, coefficients: tuple[float, ...]) -> None:
        self._n = np.array([1.0, *coefficients])
        with np.errstate(all='ignore'):
            self._slope = self._n * np.arange(1.0, 2 * len(self._n), 2.0)
        self._end_rad = min(math.sqrt(smallest_positive_root(self._slope)), math.pi)

    def distort(self, rays: Array) -> Array:
        """Map rays (N, 3) to the plane (N, 2); NaN beyond the fold and on the backward axis."""
        rho = np.linalg.norm(rays[:, :2], axis=1, keepdims=True)
        angle = np.arctan2(rho, rays[:, 2:])
        with np.errstate(all='ignore'):
            visible = (angle <= self._end_rad) & (angle < math.pi) & ((rho > 0.0) | (angle == 0.0))
            scale = np.where(rho > 0.0, self.radii(angle) / rho, 0.0)
        points: Array = rays[:, :2] * np.where(visible, scale, np.nan)
        return points

    def undistort(self, points: Array) -> Array:
        """Map points of the plane (N, 2) to unit rays (N, 3); NaN if there is none."""
        radius = np.linalg.norm(points, axis=1, keepdims=True)
        with np.errstate(all='ignore'):
            angle = _angle_table(self, self._end_rad, radius)
            for _ in range(_MAX_STEPS):
                error = radius - self.radii(angle)
                if not (np.abs(error) > _CONVERGED).any():
                    break
                angle = angle + error / poly.polyval(angle**2, self._slope)
            close = np.abs(radius - self.radii(angle)) <= 10.0 * _CONVERGED
            angle = np.where(close & (angle <= self._end_rad), angle, np.nan)
            scale = np.where(radius > 0.0, np.sin(angle) / radius, 1.0)
        return np.concatenate([points * scale, np.cos(angle)], axis=1)

    def radii(self, angles_rad: Array) -> Array:
        """Return the radii in the plane at angles to the axis."""
        radii: Array = angles_rad * poly.polyval(angles_rad**2, self._n)
        return radii


def lens_map(distortion_model: str, coefficients: tuple[float, ...]) -> LensMap:
    """Return the lens of a model by its name in ROS."""
    kind = _EquidistantLens if distortion_model == 'equidistant' else _PolynomialLens
    return kind(coefficients)


def _angle_table(lens: LensMap, end_rad: float, radius: Array) -> Array:
    """Interpolate the angles of radii, the start of Newton's method."""
    angles = np.linspace(0.0, end_rad, _TABLE_SIZE)
    table: Array = np.interp(radius, lens.radii(angles), angles)
    return table
