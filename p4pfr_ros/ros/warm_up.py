# SPDX-License-Identifier: Apache-2.0
"""Compiles the kernels before there is anything to answer."""

from __future__ import annotations

import numpy as np
from p4pfr_ros import DivisionCamera, estimate_pose, Pose, RansacOptions
from p4pfr_ros.core.geometry import Array

_CAMERA = DivisionCamera(520.0, (319.5, 239.5), -0.2)
_SIZE = (640, 480)


def warm_up() -> None:
    """Solve a view of a board and one of a marker: the first time takes seconds, and says so."""
    side = np.linspace(-0.1, 0.1, 4)
    board = np.stack(np.meshgrid(side, side), axis=-1).reshape(-1, 2)
    for points in (board, board[[0, 3, 15, 12]]):
        estimate_pose(_seen(points), points, image_size=_SIZE, options=RansacOptions())


def _seen(board_points: Array) -> Array:
    facing = Pose(np.diag([1.0, -1.0, -1.0]), np.array([0.05, -0.03, 0.5]))
    tilted = facing @ Pose.from_rotation_vector([0.5, 0.3, 0.1], np.zeros(3))
    return _CAMERA.project(tilted.transform(np.pad(board_points, ((0, 0), (0, 1)))))
