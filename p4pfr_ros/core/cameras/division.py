# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""``DivisionCamera``: the division model of a lens with radial distortion, one to three terms."""

from __future__ import annotations

from dataclasses import dataclass
import math

import numpy as np
from numpy.typing import ArrayLike

from .camera_info import CameraInfoModel
from .convert import fit_camera_info_model
from .ray_polynomial import fold_radius, ray_depth, Terms
from ..geometry import Array, as_points

# The projection by two or three terms has no closed form: a table, then Newton's steps.
_TABLE_SIZE = 1024
_NEWTON_STEPS = 4


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
        A number is not finite, or focal_px is not positive.

    """

    focal_px: float
    center_px: tuple[float, float]
    k: float = 0.0
    k2: float = 0.0
    k3: float = 0.0

    def __post_init__(self) -> None:
        x, y = as_points(self.center_px, 'center_px', (2,)).tolist()
        object.__setattr__(self, 'center_px', (x, y))
        for name in ('focal_px', 'k', 'k2', 'k3'):
            value = float(getattr(self, name))
            if not math.isfinite(value):
                raise ValueError(f'{name} must be finite, got {value}')
            object.__setattr__(self, name, value)
        if not self.focal_px > 0.0:
            raise ValueError(f'focal_px must be > 0, got {self.focal_px}')

    @classmethod
    def unchecked(
        cls, focal_px: float, center_px: tuple[float, float], k: float
    ) -> DivisionCamera:
        """Make a camera of numbers that a kernel has checked; ten times faster."""
        camera = object.__new__(cls)
        for name, value in (('focal_px', focal_px), ('center_px', center_px), ('k', k)):
            object.__setattr__(camera, name, value)
        object.__setattr__(camera, 'k2', 0.0)
        object.__setattr__(camera, 'k3', 0.0)
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
        depth = ray_depth(np.sum(d**2, axis=-1, keepdims=True), self.terms)
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
        return fit_camera_info_model(self.focal_px, self.center_px, self.terms, image_size)

    def _wide_scale(self, rho: Array, z: Array) -> Array:
        """Return |d| / ρ of points at the distance ρ from the axis and the depth z."""
        radii, angles = self._angle_table()
        angle = np.arctan2(rho, z)
        r = np.interp(angle, angles, radii, right=np.nan)
        # Newton on  r z - ρ w(r) = 0,  w = 1 + k r² + k2 r⁴ + k3 r⁶, from the table's start.
        for _ in range(_NEWTON_STEPS):
            r2 = r**2
            w = ray_depth(r2, self.terms)
            slope = 2.0 * self.k + r2 * (4.0 * self.k2 + r2 * 6.0 * self.k3)
            r = r - (r * z - rho * w) / (z - rho * r * slope)
        with np.errstate(divide='ignore', invalid='ignore'):
            scale: Array = np.where(rho > 0.0, r / rho, np.where(z > 0.0, 1.0 / z, np.nan))
        return scale

    def _angle_table(self) -> tuple[Array, Array]:
        """Sample the angle to the axis over |d|, out to the fold."""
        edge = fold_radius(self.terms)
        # r = s / (1 - s) reaches from the axis to infinity.
        last = edge / (1.0 + edge) if math.isfinite(edge) else 1.0 - 1e-6
        s = np.linspace(0.0, last, _TABLE_SIZE)
        radii = s / (1.0 - s)
        return radii, np.arctan2(radii, ray_depth(radii**2, self.terms))


def _closed_form_scale(k: float, rho2: Array, z: Array) -> Array:
    """Return |d| / ρ by the one-parameter model; NaN if no pixel sees the point."""
    # d = s xy on the ray (d, 1 + k |d|²) gives  k ρ² s² - z s + 1 = 0. Of its two roots this one
    # is the continuous one through k = 0. Each form keeps its digits on its own side of z = 0.
    with np.errstate(divide='ignore', invalid='ignore'):
        root = np.sqrt(z**2 - 4.0 * k * rho2)  # NaN outside the domain
        s = np.where(z < 0.0, (z - root) / (2.0 * k * rho2), 2.0 / (z + root))
        scale: Array = np.where(np.isfinite(s) & (s > 0.0), s, np.nan)
    return scale
