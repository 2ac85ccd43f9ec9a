# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""Views of a board on the simulator's path, with noisy corners."""

from dataclasses import dataclass

import numpy as np
from p4pfr_ros import DivisionCamera, Pose
from p4pfr_ros.boards import Chessboard
from p4pfr_ros.ros.conversions import cloud_msg, Correspondences, ImageFrame
from p4pfr_ros.ros.pose.inputs import BoardObservation, MARKER
from p4pfr_ros.scenes.board_path import SimulatedPath
import scenes

SIZE = (640, 480)
# The principal point is off the middle of the image, as in any real camera.
CAMERA = DivisionCamera(520.0, (328.0, 232.0), -0.25)
ZOOMED = DivisionCamera(650.0, (328.0, 232.0), -0.25)
BOARD = Chessboard(columns=9, rows=6, square_m=0.025)
NOISE_PX = 0.2

_PATH = SimulatedPath(BOARD, SIZE, 0)
_STEP_S = 0.4


@dataclass(frozen=True)
class MovingView:
    """A view of the moving board: its true pose, and its corners (54, 2) in px."""

    index: int
    camera: DivisionCamera
    camera_from_board: Pose
    image_points: np.ndarray

    @property
    def observation(self):
        """The view as an observation of pose_node."""
        return observation(self.image_points, SIZE, self.index)

    @property
    def cloud(self):
        """The view as a message; the seconds of its stamp are the index."""
        ids = np.arange(len(BOARD.points))
        return cloud_msg(scenes.header(self.index), self.image_points, BOARD.points, ids)

    def error_m(self, camera_from_board):
        """Return the position error of a pose."""
        error = camera_from_board.translation - self.camera_from_board.translation
        return float(np.linalg.norm(error))


def observation(image_points, image_size, second, target=MARKER):
    """Make an observation of the board in an image of any size."""
    points = Correspondences(image_points, BOARD.points, np.arange(len(BOARD.points)))
    header = scenes.header(second)
    return BoardObservation(header, ImageFrame(image_size), target, points, image_points)


def views(first, last, camera=CAMERA):
    """Return the views from first to last (excluded); the same indices give the same views."""
    return [_view(index, camera) for index in range(first, last)]


def _view(index, camera):
    pose = _PATH.at(index * _STEP_S, camera)
    noise_px = np.random.default_rng(index).normal(0.0, NOISE_PX, (len(BOARD.points), 2))
    return MovingView(index, camera, pose, scenes.project(BOARD.points, pose, camera) + noise_px)
