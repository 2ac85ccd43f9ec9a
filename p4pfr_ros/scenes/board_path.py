# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""The way a board moves before camera_simulator's camera: smooth, known, never out of sight."""

from __future__ import annotations

import math

import numpy as np
from p4pfr_ros.boards import Board
from p4pfr_ros.core.cameras.division import DivisionCamera
from p4pfr_ros.core.geometry import Array, Pose

# The board's tilt against the image plane, and how much of the picture's width or height
# (whichever is more) its sheet takes.
TILT_DEG = (15.0, 55.0)
FILL = (0.35, 0.75)
_ROLL_DEG = (-40.0, 40.0)
_TURN_PERIOD_S = 19.0  # of the direction that it is tilted to
_WOBBLE_PERIODS_S = (7.0, 11.0)
# Of the room that the board leaves in the picture, how much it uses for wandering about.
_WANDER = 0.9
_FITTING_STEPS = 12
_FACING = np.diag([1.0, -1.0, -1.0])


class SimulatedPath:
    """
    A board's pose over time, for a camera of its own: ``path.at(time_s, camera)``.

    Parameters
    ----------
    board
        What moves.
    image_size
        Width and height of the picture, pixels.
    seed
        Which of all paths.

    """

    def __init__(self, board: Board, image_size: tuple[int, int], seed: int) -> None:
        self._outline = _outline(*board.sheet_size_m)
        self._size_px = np.array(image_size, dtype=np.float64)
        # Five wobbles (tilt, roll, fill, two to wander) of two sines each, and the turn.
        self._phases = np.random.default_rng(seed).uniform(0.0, 2.0 * np.pi, (6, 2))

    def at(self, time_s: float, camera: DivisionCamera) -> Pose:
        """Return ``camera_from_board`` at a time."""
        tilt, roll, fill, *wander = self._wobbles(time_s)
        turn = 2.0 * np.pi * time_s / _TURN_PERIOD_S + self._phases[5, 0]
        rotation = _rotation(
            math.radians(_between(TILT_DEG, tilt)), turn, math.radians(_between(_ROLL_DEG, roll))
        )
        filled = _between(FILL, fill)
        free_px = 0.5 * (1.0 - filled) * self._size_px
        middle_px = 0.5 * (self._size_px - 1.0) + _WANDER * free_px * wander
        return self._fitted(rotation, filled, middle_px, camera)

    def _wobbles(self, time_s: float) -> Array:
        """Return five smooth numbers from -1 to 1."""
        angles = 2.0 * np.pi * time_s / np.array(_WOBBLE_PERIODS_S) + self._phases[:5]
        wobbles: Array = np.sin(angles).mean(axis=1)
        return wobbles

    def _fitted(
        self, rotation: Array, filled: float, middle_px: Array, camera: DivisionCamera
    ) -> Pose:
        """Move the board along and across the view until its outline lies where it should."""
        outline = self._outline @ rotation.T
        # From too near, a lens with k > 0 does not see the outline at all: begin far away.
        reach = float(np.abs(outline).max())
        distance = 20.0 * reach * max(1.0, camera.focal_px / self._size_px.min())
        aim_px = middle_px
        # Its size in the picture goes with 1 / distance and its place with the aim, nearly:
        # correcting both by what is seen converges at once.
        for _ in range(_FITTING_STEPS):
            ray = camera.unproject(aim_px)
            centre = distance * ray / np.linalg.norm(ray)
            seen_px = camera.project(outline + centre)
            low_px, high_px = seen_px.min(axis=0), seen_px.max(axis=0)
            distance *= float(((high_px - low_px) / self._size_px).max()) / filled
            aim_px = aim_px + middle_px - 0.5 * (low_px + high_px)
        return Pose(rotation, centre)


def _outline(width_m: float, height_m: float) -> Array:
    """Return points (N, 3) all around the sheet."""
    share = np.linspace(-0.5, 0.5, 9)
    edge = np.full_like(share, 0.5)
    x = np.concatenate([share, share, edge, -edge]) * width_m
    y = np.concatenate([edge, -edge, share, share]) * height_m
    return np.column_stack([x, y, np.zeros_like(x)])


def _rotation(tilt_rad: float, turn_rad: float, roll_rad: float) -> Array:
    """Tilt the facing board about an axis in its plane, then turn the picture by the roll."""
    axis = np.array([math.cos(turn_rad), math.sin(turn_rad), 0.0])
    tilted = Pose.from_rotation_vector(tilt_rad * axis, np.zeros(3)).rotation
    rolled = Pose.from_rotation_vector([0.0, 0.0, roll_rad], np.zeros(3)).rotation
    rotation: Array = rolled @ _FACING @ tilted
    return rotation


def _between(limits: tuple[float, float], wobble: float) -> float:
    """Map -1 to 1 to the limits."""
    low, high = limits
    return low + 0.5 * (wobble + 1.0) * (high - low)
