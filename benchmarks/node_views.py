# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""Messages for the pose_node benchmark, generated before the measurement."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from geometry_msgs.msg import Point32, PolygonStamped
import numpy as np
from p4pfr_ros import DivisionCamera
from p4pfr_ros.boards import Board, Chessboard, Marker
from p4pfr_ros.core.geometry import Array
from p4pfr_ros.ros.conversions import cloud_msg
from p4pfr_ros.scenes.board_path import SimulatedPath
from sensor_msgs.msg import PointCloud2
from std_msgs.msg import Header

MARKER_M = 0.15
IMAGE_SIZE = (640, 480)

_CAMERA = DivisionCamera(520.0, (328.0, 232.0), -0.25)
_NOISE_PX = 0.2
_VIEWS = 200
# Time on the simulated path between views: far apart, and as at 200 messages per second.
_FAR_S, _NEAR_S = 0.4, 0.005
_ONE_WAY = 400  # views in one direction

_BOARDS: dict[int, Board] = {
    4: Marker(id=0, size_m=MARKER_M, dictionary='DICT_APRILTAG_36h11'),
    24: Chessboard(columns=6, rows=4, square_m=0.03),
    100: Chessboard(columns=10, rows=10, square_m=0.02),
}
POINTS = tuple(_BOARDS)


@dataclass(frozen=True, slots=True)
class Views:
    """
    Messages with noisy views of a board with the given number of points.

    jumping: each view from another place; moving: back and forth, in real time at 200 per
    second; static: from one place.
    """

    points: int
    jumping: Sequence[Any]
    moving: Sequence[Any]
    static: Sequence[Any]

    @property
    def topic(self) -> str:
        """Return the topic of pose_node for these messages."""
        return 'corners' if self.points == 4 else 'correspondences'

    @property
    def message_type(self) -> type[Any]:
        """Return PolygonStamped or PointCloud2."""
        return type(self.moving[0])


def views_of(points: int) -> Views:
    """Make the views of the board with the given number of points, one of ``POINTS``."""
    board = _BOARDS[points]
    path, rng = SimulatedPath(board, IMAGE_SIZE, 0), np.random.default_rng(points)
    jumping = [_message(path, i * _FAR_S, board, rng) for i in range(_VIEWS)]
    there_and_back = [*range(_ONE_WAY), *reversed(range(_ONE_WAY))]
    moving = [_message(path, i * _NEAR_S, board, rng) for i in there_and_back]
    static = [_message(path, 0.0, board, rng) for _ in range(_VIEWS)]
    return Views(points, jumping, moving, static)


def _message(
    path: SimulatedPath, time_s: float, board: Board, rng: np.random.Generator
) -> PolygonStamped | PointCloud2:
    pose = path.at(time_s, _CAMERA)
    image_px = _CAMERA.project(pose.transform(np.pad(board.points, ((0, 0), (0, 1)))))
    image_px += rng.normal(0.0, _NOISE_PX, image_px.shape)
    header = Header(frame_id='camera_optical_frame')
    if len(image_px) == 4:
        return _polygon(header, image_px)
    return cloud_msg(header, image_px, board.points, np.arange(len(image_px)))


def _polygon(header: Header, corners_px: Array) -> PolygonStamped:
    msg = PolygonStamped(header=header)
    msg.polygon.points = [Point32(x=x, y=y) for x, y in corners_px.tolist()]
    return msg
