# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""
Boards that look the same after a turn: each view has several poses, and no image tells which.

A board's ``turns`` are rigid motions ``board_from_turned`` about its z axis and its origin, so
that ``camera_from_board @ turn`` shows the same image.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from p4pfr_ros.core.geometry import Pose, rotation_angle_rad
from p4pfr_ros.core.minimal.solution import Solution
from p4pfr_ros.core.one_view.results import PoseEstimate

_COSINE_AND_SINE = {0: (1.0, 0.0), 90: (0.0, 1.0), 180: (-1.0, 0.0), 270: (0.0, -1.0)}


def turn_about_z(angle_deg: int) -> Pose:
    """Return the turn by a multiple of 90° below 360°, without rounding."""
    cos, sin = _COSINE_AND_SINE[angle_deg]
    return Pose(np.array([[cos, -sin, 0.0], [sin, cos, 0.0], [0.0, 0.0, 1.0]]), np.zeros(3))


NO_TURN = turn_about_z(0)


def symmetry_note(name: str, turns: Sequence[Pose]) -> str:
    """Return a line for people about the turns of a board; empty if it has none."""
    if not turns:
        return ''
    angles = ', '.join(f'{round(np.degrees(turn.rotation_vector[2])) % 360}' for turn in turns)
    return (
        f'{name}: the board looks the same after a turn of {angles} degrees, so each view has '
        f'{len(turns) + 1} poses: one is returned, the others are alternatives. A board with an '
        'even number of columns and an odd number of rows, or the reverse, has one'
    )


def with_turned_poses(
    estimate: PoseEstimate, turns: Sequence[Pose], before: Pose | None = None
) -> tuple[PoseEstimate, Pose]:
    """
    Return the estimate with the turned poses among its alternatives, and the turn of its model.

    before: a recent pose of the board; the turned pose that is nearest to it becomes the model.
    Without it the model stays, and its turn is the identity. The covariance is the same for all:
    a turn leaves the origin in place, and the rotation is about fixed axes of the camera. The
    point p of the observation is the point ``turn.inverse() p`` of the board in its new pose.
    """
    if estimate.model is None or not turns:
        return estimate, NO_TURN
    pose = estimate.model.camera_from_board
    order = [NO_TURN, *turns]
    if before is not None:
        rotation = before.rotation
        order.sort(key=lambda t: rotation_angle_rad(pose.rotation @ t.rotation, rotation))
    first, *others = (_turned(estimate.model, turn) for turn in order)
    alternatives = (_turned(s, turn) for s in estimate.alternatives for turn in order)
    return replace(estimate, model=first, alternatives=(*others, *alternatives)), order[0]


def _turned(solution: Solution, turn: Pose) -> Solution:
    if turn is NO_TURN:
        return solution
    return replace(solution, camera_from_board=solution.camera_from_board @ turn)
