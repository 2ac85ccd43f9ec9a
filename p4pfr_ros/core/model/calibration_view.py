# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""A view as self-calibration keeps it: well scaled, its image about the middle of the picture."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from .lens import CX, CY, FOCAL, K, K2, K3, LENS_SIZE
from .observation import prepare, PreparedView
from ..cameras.division import DivisionCamera
from ..geometry import Array, Pose
from ..many_views.bundle import Bundle
from ..many_views.bundle_adjustment import POSE_SIZE
from ..minimal.solution import TRANSLATION


@dataclass(frozen=True, slots=True, eq=False)
class CalibrationView:
    """
    One view: the caller's points, the scaled ones, and whatever the caller calls its time.

    image_points (N, 2) raw px, board_points (N, 2) board units.
    """

    image_points: Array
    board_points: Array
    scaled: PreparedView
    stamp: Any

    def __len__(self) -> int:
        return len(self.image_points)

    def row_from_pose(self, camera_from_board: Pose) -> Array:
        """Return the numbers (12,) of a pose of the scaled board."""
        rotation, scaled = camera_from_board.rotation, self.scaled
        moved = camera_from_board.translation + rotation[:, :2] @ scaled.board_mean
        return np.concatenate([rotation.ravel(), moved / scaled.board_size])

    def pose_from_row(self, row: Array) -> Pose:
        """Return ``camera_from_board`` in the caller's frame and units."""
        rotation = row[:TRANSLATION].reshape(3, 3).copy()
        moved = self.scaled.board_size * row[TRANSLATION:POSE_SIZE]
        return Pose.unchecked(rotation, moved - rotation[:, :2] @ self.scaled.board_mean)


def calibration_view(
    image_points: ArrayLike, board_points: ArrayLike, image_size: tuple[int, int], stamp: Any
) -> CalibrationView:
    """
    Check, copy and scale a view: image points (N, 2) raw px, board points (N, 2).

    Raises
    ------
    ValueError
        A wrong shape, or a number that is not finite.

    """
    scaled = prepare(image_points, board_points, image_size, None, None)
    image, board = np.array(image_points, np.float64), np.array(board_points, np.float64)
    return CalibrationView(image, board, scaled, stamp)


def bundle_of(views: Sequence[CalibrationView]) -> Bundle:
    """Put the views' points one after the other."""
    if len(views) == 1:
        [view] = views
        return Bundle(view.scaled.image, view.scaled.board, np.array([0, len(view)]))
    starts = np.zeros(len(views) + 1, dtype=np.int64)
    np.cumsum([len(view) for view in views], out=starts[1:])
    return Bundle(
        np.concatenate([view.scaled.image for view in views]),
        np.concatenate([view.scaled.board for view in views]),
        starts,
    )


def lens_of(camera: DivisionCamera, middle_px: tuple[float, float]) -> Array:
    """Return the camera's numbers (6,), its centre from the middle of the picture."""
    lens = np.empty(LENS_SIZE)
    lens[FOCAL], lens[K], lens[K2], lens[K3] = camera.focal_px, camera.k, camera.k2, camera.k3
    lens[CX], lens[CY] = np.subtract(camera.center_px, middle_px)
    return lens


def camera_of(lens: Array, middle_px: tuple[float, float]) -> DivisionCamera:
    """Return the camera with these numbers."""
    focal_px, x, y, k, k2, k3 = lens.tolist()
    return DivisionCamera(focal_px, (x + middle_px[0], y + middle_px[1]), k, k2, k3)
