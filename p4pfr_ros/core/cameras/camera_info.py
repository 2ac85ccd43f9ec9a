# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""``CameraInfoModel``: a camera as sensor_msgs/CameraInfo has it, and as OpenCV computes it."""

from __future__ import annotations

from dataclasses import dataclass
import math

import numpy as np
from numpy.typing import ArrayLike

from .lens_maps import lens_map
from ..geometry import Array, as_points

# How many coefficients each model has. A plumb_bob of four is one of five with k3 = 0.
COEFFICIENTS = {'plumb_bob': 5, 'rational_polynomial': 8, 'equidistant': 4}


@dataclass(frozen=True, slots=True)
class CameraInfoModel:
    """
    A calibrated camera in one of the models that image_proc knows.

    Parameters
    ----------
    distortion_model
        plumb_bob, rational_polynomial or equidistant (OpenCV's fisheye).
    coefficients
        D of CameraInfo, 5, 8 or 4 of them, in its order; plumb_bob may leave out its last.
    focal_px, center_px
        (fx, fy) and (cx, cy) of K: in the full raw picture, pixel centres are integers.
    residual_px
        Where the model stands in for another: the largest distance in the picture between where
        the two see a ray. 0 where it does not.
    image_size
        Width and height of the full raw picture, pixels.

    Raises
    ------
    ValueError
        Another model, another number of coefficients, or a number out of its range.

    """

    distortion_model: str
    coefficients: tuple[float, ...]
    focal_px: tuple[float, float]
    center_px: tuple[float, float]
    residual_px: float
    image_size: tuple[int, int]

    def __post_init__(self) -> None:
        object.__setattr__(self, 'coefficients', self._checked_coefficients())
        for name in ('focal_px', 'center_px'):
            x, y = as_points(getattr(self, name), name, (2,)).tolist()
            object.__setattr__(self, name, (x, y))
        if not min(self.focal_px) > 0.0:
            raise ValueError(f'focal_px must be > 0, got {self.focal_px}')
        if not self.residual_px >= 0.0:
            raise ValueError(f'residual_px must be ≥ 0, got {self.residual_px}')
        width, height = (int(n) for n in self.image_size)
        if width < 1 or height < 1:
            raise ValueError(f'image_size must be positive, got {self.image_size}')
        object.__setattr__(self, 'image_size', (width, height))

    def project(self, points_in_camera: ArrayLike) -> Array:
        """
        Project points (..., 3) of the optical frame to raw pixels (..., 2).

        NaN where the lens sees no such point: beyond the model's first fold, and for Z ≤ 0
        (equidistant: on the backward axis only).
        """
        points = np.asarray(points_in_camera, dtype=np.float64)
        lens = lens_map(self.distortion_model, self.coefficients)
        flat = lens.distort(points.reshape(-1, 3)).reshape(*points.shape[:-1], 2)
        pixels: Array = flat * self.focal_px + self.center_px
        return pixels

    def unproject(self, points_px: ArrayLike) -> Array:
        """
        Return the unit rays (..., 3) that raw pixels (..., 2) see, NaN where there is none.

        Exact: iterated until they project back to their pixel within rounding.
        """
        pixels = np.asarray(points_px, dtype=np.float64)
        flat = (pixels - self.center_px) / self.focal_px
        lens = lens_map(self.distortion_model, self.coefficients)
        return lens.undistort(flat.reshape(-1, 2)).reshape(*pixels.shape[:-1], 3)

    def _checked_coefficients(self) -> tuple[float, ...]:
        if self.distortion_model not in COEFFICIENTS:
            raise ValueError(
                f'distortion_model must be one of {", ".join(COEFFICIENTS)}, '
                f'got {self.distortion_model!r}'
            )
        wanted = COEFFICIENTS[self.distortion_model]
        given = tuple(float(c) for c in self.coefficients)
        if self.distortion_model == 'plumb_bob' and len(given) == wanted - 1:
            given = (*given, 0.0)
        if len(given) != wanted:
            counts = f'4 or {wanted}' if self.distortion_model == 'plumb_bob' else f'{wanted}'
            raise ValueError(
                f'coefficients must be {counts} of {self.distortion_model}, got {len(given)}'
            )
        if not all(math.isfinite(c) for c in given):
            raise ValueError(f'coefficients must be finite, got {given}')
        return given


def corner_radius_px(image_size: tuple[int, int], center_px: tuple[float, float]) -> float:
    """Return how far the outer corner of the picture's farthest pixel is from the centre."""
    return math.hypot(
        *(max(c + 0.5, size - 0.5 - c) for c, size in zip(center_px, image_size, strict=True))
    )
