# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""Synthetic views of boards, with noise and outliers, and the truth behind them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from p4pfr_ros.core.cameras.division import DivisionCamera
from p4pfr_ros.core.geometry import Array, Mask, Pose
from p4pfr_ros.scenes.instances import (
    anywhere,
    draw,
    IMAGE_SIZE,
    Instances,
    square,
    tilted,
    visible,
)

# A board smaller than this in the picture is drawn again.
_SMALLEST_EXTENT_PX = 0.55 * IMAGE_SIZE[1]


@dataclass(frozen=True, slots=True, eq=False)
class View:
    """
    One noisy look at a board, and the truth behind it.

    image_points (N, 2) px, board_points (N, 2), outlier (N,) bool.
    """

    image_points: Array
    board_points: Array
    outlier: Mask
    camera: DivisionCamera
    camera_from_board: Pose


def view(
    rng: np.random.Generator,
    n_points: int,
    *,
    noise_px: float = 0.5,
    outlier_share: float = 0.0,
    tilt_deg: tuple[float, float] = (15.0, 65.0),
) -> View:
    """Draw a board of n points, uniform in a square, with noise and outliers, in the picture."""
    while True:
        corners = visible(draw(rng, 64, square, tilted(*tilt_deg), anywhere))
        extent_px = np.ptp(corners.image_points, axis=1).max(axis=1)
        large = np.flatnonzero(extent_px > _SMALLEST_EXTENT_PX)
        if large.size:
            return _noisy_view(rng, corners, int(large[0]), n_points, noise_px, outlier_share)


def _noisy_view(
    rng: np.random.Generator,
    drawn: Instances,
    index: int,
    n_points: int,
    noise_px: float,
    outlier_share: float,
) -> View:
    center_px = ((IMAGE_SIZE[0] - 1) / 2.0, (IMAGE_SIZE[1] - 1) / 2.0)
    camera = DivisionCamera(float(drawn.focal_px[index]), center_px, float(drawn.k[index]))
    pose = Pose(drawn.rotation[index], drawn.translation[index])
    board = rng.uniform(-0.5, 0.5, (n_points, 2))
    image = camera.project(pose.transform(np.column_stack([board, np.zeros(n_points)])))
    image += rng.normal(0.0, noise_px, image.shape)
    outlier = np.zeros(n_points, dtype=bool)
    outlier[rng.permutation(n_points)[: round(outlier_share * n_points)]] = True
    image[outlier] = rng.uniform(0.0, IMAGE_SIZE, (int(outlier.sum()), 2))
    return View(image, board, outlier, camera, pose)
