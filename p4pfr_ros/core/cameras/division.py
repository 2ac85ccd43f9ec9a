# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""
``DivisionCamera``: the division model of a lens, one to four radial terms, and decentring.

The pixel at e from the centre (in focal lengths, without decentring) sees the ray (e, w(|e|²))
with  w(q) = 1 + k q + k2 q² + k3 q³ + k4 q⁴.  The functions below the class are that polynomial
and the projection.
"""

from __future__ import annotations

from dataclasses import dataclass, fields
import math

import numpy as np
from numpy.typing import ArrayLike

from .camera_info import CameraInfoModel, check_magnitudes
from .convert import camera_info_from_division
from ..geometry import Array, as_points, finite_numbers
from ..linalg import smallest_positive_root

# k, k2, k3, k4.
Terms = tuple[float, float, float, float]

# With more than one term the projection has no closed form: a table, then Newton's method.
_TABLE_SIZE = 1024
_NEWTON_STEPS = 4
_LAST = 1.0 - 1e-6  # of r / (1 + r) in the table

# Decentring of real lenses is small: Newton's method for d from e converges in as many steps.
_DECENTRING_STEPS = 4

_NUMBERS = ('focal_px', 'k', 'k2', 'k3', 'k4', 'aspect', 'p1', 'p2')
_TERM_NAMES = ('k', 'k2', 'k3', 'k4')


@dataclass(frozen=True, slots=True, repr=False)
class DivisionCamera:
    """
    Division model (Fitzgibbon, CVPR 2001), with more terms for wide lenses and for real ones.

    Pixel u has d = ((u - cx) / f, (v - cy) / (f aspect)) and, with Brown's decentring, the point
    e = d + (2 p1 x y + p2 (q + 2 x²), p1 (q + 2 y²) + 2 p2 x y), where d = (x, y) and q = |d|². It
    sees the ray (e, 1 + k |e|² + k2 |e|⁴ + k3 |e|⁶ + k4 |e|⁸) of the optical frame (x right,
    y down, z forward). Pixel centres are integers, as in ROS and OpenCV.

    Parameters
    ----------
    focal_px
        Focal length along the rows at the centre of the image (fx), pixels, > 0.
    center_px
        (x, y) of principal point and distortion centre, pixels.
    k, k2, k3, k4
        Distortion, dimensionless (of e, as in COLMAP and PoseLib); negative k is barrel. The
        k of Oskarsson's paper, in px⁻², is k / focal_px².
    aspect
        fy / fx, > 0; 1: square pixels.
    p1, p2
        Decentring, dimensionless.

    Raises
    ------
    ValueError
        A number is not finite, focal_px or aspect is not positive, or a number is extreme: its
        powers would not be finite.

    """

    focal_px: float
    center_px: tuple[float, float]
    k: float = 0.0
    k2: float = 0.0
    k3: float = 0.0
    k4: float = 0.0
    aspect: float = 1.0
    p1: float = 0.0
    p2: float = 0.0

    def __post_init__(self) -> None:
        x, y = as_points(self.center_px, 'center_px', (2,)).tolist()
        object.__setattr__(self, 'center_px', (x, y))
        given = [getattr(self, name) for name in _NUMBERS]
        for name, number in zip(_NUMBERS, finite_numbers(given, ' '.join(_NUMBERS)), strict=True):
            object.__setattr__(self, name, number)
        for name in ('focal_px', 'aspect'):
            if not getattr(self, name) > 0.0:
                raise ValueError(f'{name} must be > 0, got {getattr(self, name)}')
        terms = (*self.terms, self.aspect, self.p1, self.p2)
        check_magnitudes(self.focal_xy_px, self.center_px, terms)

    @classmethod
    def unchecked(
        cls,
        focal_px: float,
        center_px: tuple[float, float],
        k: float,
        k2: float = 0.0,
        k3: float = 0.0,
        k4: float = 0.0,
        aspect: float = 1.0,
        p1: float = 0.0,
        p2: float = 0.0,
    ) -> DivisionCamera:
        """Make a camera from numbers that a kernel has checked; ten times faster."""
        camera = object.__new__(cls)
        _set_focal(camera, focal_px)
        _set_center(camera, center_px)
        _set_k(camera, k)
        _set_k2(camera, k2)
        _set_k3(camera, k3)
        _set_k4(camera, k4)
        _set_aspect(camera, aspect)
        _set_p1(camera, p1)
        _set_p2(camera, p2)
        return camera

    def __repr__(self) -> str:
        x, y = self.center_px
        names = list(_TERM_NAMES[: self.order])
        if self.aspect != 1.0:
            names.append('aspect')
        if self.is_decentred:
            names += ['p1', 'p2']
        terms = ', '.join(f'{name}={getattr(self, name):.5g}' for name in names)
        return (
            f'DivisionCamera(focal_px={self.focal_px:.6g}, center_px=({x:.6g}, {y:.6g}), {terms})'
        )

    @property
    def terms(self) -> Terms:
        """The coefficients k, k2, k3, k4."""
        return self.k, self.k2, self.k3, self.k4

    @property
    def order(self) -> int:
        """The number of terms of the division polynomial: 1 to 4."""
        return max((i for i, term in enumerate(self.terms, 1) if term != 0.0), default=1)

    @property
    def is_decentred(self) -> bool:
        """Whether p1 or p2 is not zero."""
        return self.p1 != 0.0 or self.p2 != 0.0

    @property
    def fold_radius(self) -> float:
        """The |e| up to which rays turn away from the axis; infinite if they always do."""
        return _fold_radius(self.terms)

    @property
    def focal_xy_px(self) -> tuple[float, float]:
        """(fx, fy), pixels."""
        return self.focal_px, self.focal_px * self.aspect

    @property
    def matrix(self) -> Array:
        """The (3, 3) camera matrix K, without the distortion."""
        (x, y), (fx, fy) = self.center_px, self.focal_xy_px
        return np.array([[fx, 0.0, x], [0.0, fy, y], [0.0, 0.0, 1.0]])

    def unproject(self, points_px: ArrayLike) -> Array:
        """Return the rays (..., 3) that pixels (..., 2) see: not unit, in the optical frame."""
        d = (np.asarray(points_px, dtype=np.float64) - self.center_px) / self.focal_xy_px
        # Not finite if the numbers are extreme.
        with np.errstate(all='ignore'):
            e = d + self._decentring(d) if self.is_decentred else d
            depth = _ray_depth(np.sum(e**2, axis=-1, keepdims=True), self.terms)
        return np.concatenate([e, depth], axis=-1)

    def project(self, points_in_camera: ArrayLike) -> Array:
        """
        Project points (..., 3) of the optical frame to pixels (..., 2).

        NaN if no pixel sees the point: on the backward axis, and beyond the outermost ray of a
        lens with k > 0. A camera with k < 0 sees points behind its image plane (Z ≤ 0) too.
        """
        points = np.asarray(points_in_camera, dtype=np.float64)
        xy, z = points[..., :2], points[..., 2:]
        # Not finite if the numbers are extreme.
        with np.errstate(all='ignore'):
            if self.order == 1:
                scale = _closed_form_scale(self.k, np.sum(xy**2, axis=-1, keepdims=True), z)
            else:
                scale = self._wide_scale(np.linalg.norm(xy, axis=-1, keepdims=True), z)
            d = scale * xy
            if self.is_decentred:
                d = self._without_decentring(d)
        pixels: Array = d * self.focal_xy_px + self.center_px
        return pixels

    def to_camera_info_model(
        self, image_size: tuple[int, int], seen_radius_px: float | None = None
    ) -> CameraInfoModel:
        """
        Return the closest camera in a model of CameraInfo, for image_proc.

        It is fitted where the lens was seen: up to seen_radius_px from the centre, by default
        over the whole image of image_size (width, height). Beyond, it stays monotonic over the
        image. rational_polynomial if it is within 0.1 px; otherwise rational_polynomial or
        equidistant, whichever is closer. residual_px of the result is the largest error up to
        seen_radius_px, and residual_outside_px beyond. Pixels beyond the fold of the lens are
        excluded.
        """
        return camera_info_from_division(self, image_size, seen_radius_px)

    def _decentring(self, d: Array) -> Array:
        """Return e - d."""
        x, y = d[..., 0], d[..., 1]
        q = x * x + y * y
        moved = (
            2.0 * self.p1 * x * y + self.p2 * (q + 2.0 * x * x),
            self.p1 * (q + 2.0 * y * y) + 2.0 * self.p2 * x * y,
        )
        return np.stack(moved, axis=-1)

    def _without_decentring(self, e: Array) -> Array:
        """Return d, by Newton's method."""
        d, p1, p2 = e - self._decentring(e), self.p1, self.p2
        for _ in range(_DECENTRING_STEPS):
            x, y = d[..., 0], d[..., 1]
            miss_x, miss_y = np.moveaxis(e - d - self._decentring(d), -1, 0)
            by_xx, by_yy = 1.0 + 2.0 * p1 * y + 6.0 * p2 * x, 1.0 + 6.0 * p1 * y + 2.0 * p2 * x
            by_xy = 2.0 * (p1 * x + p2 * y)
            step = (by_yy * miss_x - by_xy * miss_y, by_xx * miss_y - by_xy * miss_x)
            d = d + np.stack(step, axis=-1) / (by_xx * by_yy - by_xy**2)[..., None]
        return d

    def _wide_scale(self, rho: Array, z: Array) -> Array:
        """Return |d| / ρ of points at the distance ρ from the axis and the depth z."""
        radii, angles = self._angle_table()
        angle = np.arctan2(rho, z)
        r = np.interp(angle, angles, radii, right=np.nan)
        # Newton on  r z - ρ w(r) = 0,  w(r²), from the table's start.
        for _ in range(_NEWTON_STEPS):
            r2 = r**2
            w = _ray_depth(r2, self.terms)
            slope = 2.0 * _slope(r2, self.terms)
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


# A frozen object's slots, set without its check: half the time of object.__setattr__.
_set_focal, _set_center, _set_k, _set_k2, _set_k3, _set_k4, _set_aspect, _set_p1, _set_p2 = (
    vars(DivisionCamera)[field.name].__set__ for field in fields(DivisionCamera)
)


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
    k, k2, k3, k4 = terms
    depth: Array = 1.0 + r2 * (k + r2 * (k2 + r2 * (k3 + r2 * k4)))
    return depth


def _slope(r2: Array, terms: Terms) -> Array:
    """Return dw/dq at squared radii, any shape."""
    k, k2, k3, k4 = terms
    slope: Array = k + r2 * (2.0 * k2 + r2 * (3.0 * k3 + r2 * 4.0 * k4))
    return slope


def _fold_radius(terms: Terms) -> float:
    """Return the radius up to which the angle to the axis grows; infinite if it always does."""
    k, k2, k3, k4 = terms
    # The angle atan2(r, w) grows with r while
    # w - r dw/dr = 1 - k r² - 3 k2 r⁴ - 5 k3 r⁶ - 7 k4 r⁸ > 0.
    slope = np.array([1.0, -k, -3.0 * k2, -5.0 * k3, -7.0 * k4])
    return math.sqrt(smallest_positive_root(slope))
