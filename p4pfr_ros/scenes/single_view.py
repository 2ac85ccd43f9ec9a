# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""
One synthetic view of a random camera, with noise, outliers and ground truth.

This module stands alone: a single view needs no calibration code, which ``camera_views`` imports.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from p4pfr_ros.core.cameras.division import DivisionCamera
from p4pfr_ros.core.geometry import Array, Mask, Pose
from p4pfr_ros.scenes.instances import (
    draw_batch,
    IMAGE_SIZE,
    InstanceKind,
    Instances,
    place_anywhere,
    select_visible,
    unit_squares,
)

# A board with a smaller extent in the image is rejected.
_MIN_EXTENT_PX = 0.55 * IMAGE_SIZE[1]


@dataclass(frozen=True, slots=True, eq=False)
class SyntheticView:
    """
    One view of a board with its ground truth.

    image_points (N, 2) px, board_points (N, 2), outlier (N,) bool.
    """

    image_points: Array
    board_points: Array
    outlier: Mask
    camera: DivisionCamera
    camera_from_board: Pose


def draw_view(
    rng: np.random.Generator,
    n_points: int,
    *,
    noise_px: float = 0.5,
    outlier_share: float = 0.0,
    tilt_deg: tuple[float, float] = (15.0, 65.0),
) -> SyntheticView:
    """Draw a view of n board points, uniform in a unit square whose front is in the image."""
    kind = InstanceKind(unit_squares, place_anywhere, tilt_deg)
    while True:
        corners = select_visible(draw_batch(rng, 64, kind))
        extent_px = np.ptp(corners.image_points, axis=1).max(axis=1)
        # At the rim of the image even a board that is tilted by 65° may show its back.
        front = np.einsum('nj,nj->n', corners.rotation[:, :, 2], corners.translation) < 0.0
        large = np.flatnonzero(front & (extent_px > _MIN_EXTENT_PX))
        if large.size:
            return _noisy_view(rng, corners, int(large[0]), n_points, noise_px, outlier_share)


def _noisy_view(
    rng: np.random.Generator,
    squares: Instances,
    index: int,
    n_points: int,
    noise_px: float,
    outlier_share: float,
) -> SyntheticView:
    center_px = ((IMAGE_SIZE[0] - 1) / 2.0, (IMAGE_SIZE[1] - 1) / 2.0)
    camera = DivisionCamera(float(squares.focal_px[index]), center_px, float(squares.k[index]))
    pose = Pose(squares.rotation[index], squares.translation[index])
    board = rng.uniform(-0.5, 0.5, (n_points, 2))
    image = camera.project(pose.transform(np.column_stack([board, np.zeros(n_points)])))
    image, outlier = add_noise_and_outliers(rng, image, noise_px, outlier_share)
    return SyntheticView(image, board, outlier, camera, pose)


def add_noise_and_outliers(
    rng: np.random.Generator,
    image: Array,
    noise_px: float,
    outlier_share: float,
    image_size: tuple[int, int] = IMAGE_SIZE,
) -> tuple[Array, Mask]:
    """Return noisy image points (N, 2), some of them uniform in the image, and which (N,)."""
    n = len(image)
    image = image + rng.normal(0.0, noise_px, image.shape)
    outlier = np.zeros(n, dtype=bool)
    outlier[rng.permutation(n)[: round(outlier_share * n)]] = True
    image[outlier] = rng.uniform((0, 0), image_size, (int(outlier.sum()), 2))
    return image, outlier
