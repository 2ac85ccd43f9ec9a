# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""Views of a board that moves before a camera as the simulator moves it, with noisy corners."""

from dataclasses import dataclass

import numpy as np
from p4pfr_ros import DivisionCamera, Pose
from p4pfr_ros.boards import Chessboard
from p4pfr_ros.ros.conversions import cloud_msg
from p4pfr_ros.ros.pose.camera_source import View
from p4pfr_ros.scenes.board_path import SimulatedPath
import scenes

SIZE = (640, 480)
# Not in the middle of the picture, as no lens is.
CAMERA = DivisionCamera(520.0, (328.0, 232.0), -0.25)
ZOOMED = DivisionCamera(650.0, (328.0, 232.0), -0.25)
BOARD = Chessboard(columns=9, rows=6, square_m=0.025)
NOISE_PX = 0.2

_PATH = SimulatedPath(BOARD, SIZE, 0)
_STEP_S = 0.4


@dataclass(frozen=True)
class Moment:
    """A moment of the board's way: where it is, and where its corners (54, 2) are seen, px."""

    index: int
    camera: DivisionCamera
    camera_from_board: Pose
    image_points: np.ndarray

    @property
    def view(self):
        """The moment as the node's modes take it."""
        return View(self.image_points, BOARD.points, SIZE, self.index)

    @property
    def cloud(self):
        """The moment as a message; its stamp's seconds are the index."""
        ids = np.arange(len(BOARD.points))
        return cloud_msg(scenes.header(self.index), self.image_points, BOARD.points, ids)

    def error_m(self, camera_from_board):
        """Return how far a position is from the truth."""
        away = camera_from_board.translation - self.camera_from_board.translation
        return float(np.linalg.norm(away))


def moments(first, last, camera=CAMERA):
    """Return the moments from first to last (not included), the same for the same numbers."""
    return [_moment(index, camera) for index in range(first, last)]


def _moment(index, camera):
    pose = _PATH.at(index * _STEP_S, camera)
    noise_px = np.random.default_rng(index).normal(0.0, NOISE_PX, (len(BOARD.points), 2))
    return Moment(index, camera, pose, scenes.seen(BOARD.points, pose, camera) + noise_px)
