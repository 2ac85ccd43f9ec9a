# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""
The choice between the poses of a board that looks the same after a turn.

This module stands alone: it holds the last pose of each board, which the pipeline does not need.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from p4pfr_ros import Pose, PoseEstimate
from p4pfr_ros.boards.symmetry import NO_TURN, with_turned_poses

from .inputs import BoardObservation

# A pose that is older, by the stamps, says nothing about how the board is turned now.
_RECENT_NS = 1_000_000_000


class TurnedBoards:
    """Continues the orientation of each symmetric board from image to image."""

    def __init__(self) -> None:
        self._last: dict[str, tuple[int, Pose]] = {}

    def resolve(
        self, observation: BoardObservation, estimate: PoseEstimate
    ) -> tuple[BoardObservation, PoseEstimate]:
        """
        Add the turned poses to an estimate; the one nearest to a recent pose is the answer.

        The points of the observation are turned with the board.
        """
        board = observation.target.board
        if board is None or not board.turns or estimate.model is None:
            return observation, estimate
        prefix = observation.target.prefix
        stamp_ns, before = self._last.get(prefix, (0, None))
        recent = abs(observation.stamp_ns - stamp_ns) <= _RECENT_NS
        estimate, turn = with_turned_poses(estimate, board.turns, before if recent else None)
        assert estimate.model is not None
        if estimate.observable.pose:
            self._last[prefix] = observation.stamp_ns, estimate.model.camera_from_board
        return _turned(observation, turn), estimate


def _turned(observation: BoardObservation, turn: Pose) -> BoardObservation:
    if turn is NO_TURN:
        return observation
    points = observation.points
    in_board = turn.inverse().transform(np.pad(points.board_points, ((0, 0), (0, 1))))
    surface = observation.surface_points
    return replace(
        observation,
        points=replace(points, board_points=in_board[:, :2]),
        surface_points=None if surface is None else turn.inverse().transform(surface),
    )
