# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""The motion of a simulated board: smooth, reproducible, always inside the image."""

from __future__ import annotations

import math

import numpy as np
from p4pfr_ros.boards import Board
from p4pfr_ros.core.cameras.division import DivisionCamera
from p4pfr_ros.core.geometry import Array, Pose

# Ranges of the board's tilt against the image plane, and of the fraction of the image's width or
# height (whichever is larger) that its sheet fills.
TILT_DEG = (15.0, 55.0)
FILL = (0.35, 0.75)
_ROLL_DEG = (-40.0, 40.0)
_AZIMUTH_PERIOD_S = 19.0  # of the direction of the tilt
_PERIODS_S = (7.0, 11.0)  # of the two sines of every other quantity
# Fraction of the free space in the image that the board moves through.
_USED_FRACTION = 0.9
_PLACEMENT_STEPS = 12
_HEAD_ON = np.diag([1.0, -1.0, -1.0])


class SimulatedPath:
    """
    A board's pose over time: ``path.at(time_s, camera)``.

    Parameters
    ----------
    board
        The board.
    image_size
        Width and height of the image, pixels.
    seed
        Seed of the path.

    """

    def __init__(self, board: Board, image_size: tuple[int, int], seed: int) -> None:
        self._outline = outline_of(board)
        self._image_size = image_size
        self._size_px = np.array(image_size, dtype=np.float64)
        # Two sines each for tilt, roll, fill and the position (x, y); one row for the azimuth.
        self._phases = np.random.default_rng(seed).uniform(0.0, 2.0 * np.pi, (6, 2))

    def at(self, time_s: float, camera: DivisionCamera) -> Pose:
        """Return ``camera_from_board`` at a time in seconds."""
        tilt, roll, fill, *position = self._oscillations(time_s)
        azimuth = 2.0 * np.pi * time_s / _AZIMUTH_PERIOD_S + self._phases[5, 0]
        tilt_deg, roll_deg = _between(TILT_DEG, tilt), _between(_ROLL_DEG, roll)
        rotation = tilted_rotation(math.radians(tilt_deg), azimuth, math.radians(roll_deg))
        filled = _between(FILL, fill)
        free_px = 0.5 * (1.0 - filled) * self._size_px
        middle_px = 0.5 * (self._size_px - 1.0) + _USED_FRACTION * free_px * position
        return placed(self._outline, rotation, filled, middle_px, camera, self._image_size)

    def _oscillations(self, time_s: float) -> Array:
        """Return five smooth numbers from -1 to 1."""
        angles = 2.0 * np.pi * time_s / np.array(_PERIODS_S) + self._phases[:5]
        oscillations: Array = np.sin(angles).mean(axis=1)
        return oscillations


def placed(
    outline: Array,
    rotation: Array,
    filled: float,
    middle_px: Array,
    camera: DivisionCamera,
    image_size: tuple[int, int],
) -> Pose:
    """
    Return the pose at which a board has the given size and middle in the image.

    Parameters
    ----------
    outline : (N, 3) array
        Points on the border of the board, as of `outline_of`.
    rotation : (3, 3) array
        Rotation of ``camera_from_board``.
    filled
        Share of the image's width or height, whichever is larger, that the outline fills.
    middle_px : (2,) array
        Middle of the outline's bounding box in the image, pixels.
    camera, image_size
        The camera, and width and height of its image, pixels.

    """
    turned, size_px = outline @ rotation.T, np.asarray(image_size, dtype=np.float64)
    # Start far away: close up, the outline exceeds the field of view of a lens with k > 0.
    extent = float(np.abs(turned).max())
    distance = 20.0 * extent * max(1.0, camera.focal_px / size_px.min())
    aim_px = middle_px
    # The size in the image is nearly proportional to 1 / distance, and the position moves
    # nearly with the aim: correcting both by the projected outline converges fast.
    for _ in range(_PLACEMENT_STEPS):
        ray = camera.unproject(aim_px)
        centre = distance * ray / np.linalg.norm(ray)
        pixels = camera.project(turned + centre)
        low_px, high_px = pixels.min(axis=0), pixels.max(axis=0)
        distance *= float(((high_px - low_px) / size_px).max()) / filled
        aim_px = aim_px + middle_px - 0.5 * (low_px + high_px)
    return Pose(rotation, centre)


def outline_of(board: Board) -> Array:
    """Return points (N, 3) on the border of the board's sheet, metres."""
    width_m, height_m = board.sheet_size_m
    share = np.linspace(-0.5, 0.5, 9)
    edge = np.full_like(share, 0.5)
    x = np.concatenate([share, share, edge, -edge]) * width_m
    y = np.concatenate([edge, -edge, share, share]) * height_m
    return np.column_stack([x, y, np.zeros_like(x)])


def tilted_rotation(tilt_rad: float, azimuth_rad: float, roll_rad: float) -> Array:
    """
    Tilt a head-on board about an axis in its plane, then roll it about the optical axis.

    azimuth_rad: direction of the axis in the board's plane, from its x axis.
    """
    axis = np.array([math.cos(azimuth_rad), math.sin(azimuth_rad), 0.0])
    tilted = Pose.from_rotation_vector(tilt_rad * axis, np.zeros(3)).rotation
    rolled = Pose.from_rotation_vector([0.0, 0.0, roll_rad], np.zeros(3)).rotation
    rotation: Array = rolled @ _HEAD_ON @ tilted
    return rotation


def _between(limits: tuple[float, float], value: float) -> float:
    """Map the range -1 to 1 linearly to the limits."""
    low, high = limits
    return low + 0.5 * (value + 1.0) * (high - low)
