# SPDX-License-Identifier: Apache-2.0
"""Compiles the kernels before there is anything to answer."""

from __future__ import annotations

import numpy as np
from p4pfr_ros import DivisionCamera, estimate_pose, Pose

_CAMERA = DivisionCamera(520.0, (319.5, 239.5), -0.2)
_SIZE = (640, 480)
_FACING = Pose(np.diag([1.0, -1.0, -1.0]), np.array([0.05, -0.03, 0.5]))


def warm_up() -> None:
    """
    Solve a view of a board, one of a marker, and one that tells little.

    The first time that takes some tens of seconds, and says so.
    """
    side = np.linspace(-0.1, 0.1, 4)
    board = np.stack(np.meshgrid(side, side), axis=-1).reshape(-1, 2)
    tilted = _FACING @ Pose.from_rotation_vector([0.5, 0.3, 0.1], np.zeros(3))
    for points, pose in ((board, tilted), (board[[0, 3, 15, 12]], tilted), (board, _FACING)):
        image = _CAMERA.project(pose.transform(np.pad(points, ((0, 0), (0, 1)))))
        estimate_pose(image, points, image_size=_SIZE)
