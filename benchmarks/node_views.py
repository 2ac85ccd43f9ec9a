# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""Messages for the benchmark of pose_node, made before anything is measured."""

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
# Of the simulated path, from one view to the next: far apart, and as at 200 messages a second.
_FAR_S, _NEAR_S = 0.4, 0.005
_THERE = 400  # views on the way there, and as many back

_BOARDS: dict[int, Board] = {
    4: Marker(id=0, size_m=MARKER_M, dictionary='DICT_APRILTAG_36h11'),
    24: Chessboard(columns=6, rows=4, square_m=0.03),
    100: Chessboard(columns=10, rows=10, square_m=0.02),
}
POINTS = tuple(_BOARDS)


@dataclass(frozen=True, slots=True)
class Views:
    """
    What a camera sees of a board of so many points, as messages that differ in their noise.

    everywhere: each from another place; moving: there and back, in real time at 200 a second;
    still: from one place.
    """

    points: int
    everywhere: Sequence[Any]
    moving: Sequence[Any]
    still: Sequence[Any]

    @property
    def topic(self) -> str:
        """Return where pose_node hears them."""
        return 'corners' if self.points == 4 else 'correspondences'

    @property
    def message_type(self) -> type[Any]:
        """Return PolygonStamped or PointCloud2."""
        return type(self.moving[0])


def views_of(points: int) -> Views:
    """Make the views of the board with so many points, one of ``POINTS``."""
    board = _BOARDS[points]
    path, rng = SimulatedPath(board, IMAGE_SIZE, 0), np.random.default_rng(points)
    everywhere = [_message(path, i * _FAR_S, board, rng) for i in range(_VIEWS)]
    way = [*range(_THERE), *reversed(range(_THERE))]
    moving = [_message(path, i * _NEAR_S, board, rng) for i in way]
    still = [_message(path, 0.0, board, rng) for _ in range(_VIEWS)]
    return Views(points, everywhere, moving, still)


def _message(
    path: SimulatedPath, time_s: float, board: Board, rng: np.random.Generator
) -> PolygonStamped | PointCloud2:
    pose = path.at(time_s, _CAMERA)
    seen_px = _CAMERA.project(pose.transform(np.pad(board.points, ((0, 0), (0, 1)))))
    seen_px += rng.normal(0.0, _NOISE_PX, seen_px.shape)
    header = Header(frame_id='camera_optical_frame')
    if len(seen_px) == 4:
        return _polygon(header, seen_px)
    return cloud_msg(header, seen_px, board.points, np.arange(len(seen_px)))


def _polygon(header: Header, corners_px: Array) -> PolygonStamped:
    msg = PolygonStamped(header=header)
    msg.polygon.points = [Point32(x=x, y=y) for x, y in corners_px.tolist()]
    return msg
