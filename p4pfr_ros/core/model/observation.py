# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""
An observation, the points of one board in one image: checked once, and scaled for the kernels.

An ``Observation`` does not depend on a camera. Relative to a distortion centre it is a
``CenteredView``, which is what all kernels work on.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
import math
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from ..cameras.camera_info import corner_radius_px
from ..geometry import (
    Array,
    as_board_points,
    as_image_points,
    Mask,
    Pose,
    POSE_SIZE,
    read_only,
    TRANSLATION,
)
from ..jit import jit

FEWEST_POINTS = 4

# Powers of larger distances from the centre may not be finite.
_FARTHEST_PX = 1e20

# Points within this share of the board's size from one line count as collinear.
_ON_A_LINE = 1e-9


@dataclass(frozen=True, slots=True, eq=False)
class Observation:
    """
    The points of one board in one image.

    image_points (N, 2), raw px, and board_points (N, 2), board units, are the caller's;
    scaled_board (N, 2) is (board_points - board_mean) / board_size. collinear: the board points
    lie on one line, or coincide. stamp: any value that identifies the observation. heights (N,):
    of points of a board that is not flat, in units of board_size; None: it is flat.
    """

    image_points: Array
    board_points: Array
    scaled_board: Array
    board_mean: Array
    board_size: float
    collinear: bool
    stamp: Any = None
    heights: Array | None = None

    def __len__(self) -> int:
        return len(self.image_points)

    def displaced(self, moved: Array) -> Observation:
        """Return the points moved (N, 3), in units of board_size, to where they really are."""
        board = self.scaled_board + moved[:, :2]
        return replace(self, scaled_board=board, heights=np.ascontiguousarray(moved[:, 2]))

    def with_pixels(self, pixels: Array, chosen: Mask) -> Observation:
        """Return the chosen points, seen at other pixels (N, 2)."""
        heights = None if self.heights is None else self.heights[chosen]
        return replace(
            self,
            image_points=pixels[chosen],
            board_points=self.board_points[chosen],
            scaled_board=self.scaled_board[chosen],
            heights=heights,
        )

    @property
    def points_on_board(self) -> Array:
        """Where the points really are, (N, 3), board units."""
        flat = self.board_size * self.scaled_board + self.board_mean
        heights = np.zeros(len(self)) if self.heights is None else self.board_size * self.heights
        return np.column_stack([flat, heights])

    def row_from_pose(self, camera_from_board: Pose) -> Array:
        """Return the pose (12,) of the scaled board."""
        rotation = camera_from_board.rotation
        mean_in_camera = camera_from_board.translation + rotation[:, :2] @ self.board_mean
        return np.concatenate([rotation.ravel(), mean_in_camera / self.board_size])

    def pose_from_row(self, row: Array) -> Pose:
        """Return ``camera_from_board``, board units, from the scaled board's pose (≥ 12,)."""
        rotation = row[:TRANSLATION].reshape(3, 3).copy()
        return Pose.unchecked(read_only(rotation), read_only(self.translation_from_row(row)))

    def translation_from_row(self, row: Array) -> Array:
        """Return the translation in board units from the scaled board's t:  s t - R m."""
        rotation = row[:TRANSLATION].reshape(3, 3)
        translation: Array = self.board_size * row[TRANSLATION:POSE_SIZE]
        translation -= rotation[:, :2] @ self.board_mean
        return translation

    @property
    def board_scale(self) -> tuple[float, float, float]:
        """The mean x and y, and the size, of the board points (board units), for kernels."""
        x, y = self.board_mean.tolist()
        return x, y, self.board_size

    def centered(
        self, center_px: tuple[float, float], image_size: tuple[float, float] | None
    ) -> CenteredView:
        """
        Return the view relative to a distortion centre.

        Without image_size the farthest point replaces the image's farthest corner.

        Raises
        ------
        ValueError
            The points are so far from the centre that powers of the distance are not finite.

        """
        image = self.image_points - center_px
        farthest_px = math.sqrt(_farthest2(image))
        if not farthest_px < _FARTHEST_PX:
            raise ValueError(f'image_points must be within {_FARTHEST_PX:g} px of the centre')
        corner_px = max(farthest_px, 1.0 / _FARTHEST_PX)
        if image_size is not None:
            corner_px = corner_radius_px(image_size, center_px)
        return CenteredView(self, image, self.scaled_board, center_px, corner_px)


@dataclass(frozen=True, slots=True, eq=False)
class CenteredView:
    """
    An observation relative to a distortion centre.

    image (N, 2) px from center_px, board (N, 2) scaled; corner_px is the distance of the image's
    farthest corner.
    """

    observation: Observation
    image: Array
    board: Array
    center_px: tuple[float, float]
    corner_px: float

    @property
    def heights(self) -> Array:
        """Heights of the points over the board's plane (N,), scaled."""
        heights = self.observation.heights
        return np.zeros(len(self.image)) if heights is None else heights


def observe(image_points: ArrayLike, board_points: ArrayLike, stamp: Any = None) -> Observation:
    """
    Check, copy and scale the points of a board in an image.

    Raises
    ------
    ValueError
        A wrong shape, a number that is not finite, or fewer than four points.

    """
    image = as_image_points(image_points, 'image_points')
    board = as_board_points(board_points, 'board_points', len(image))
    if len(image) < FEWEST_POINTS:
        raise ValueError(f'image_points must be at least {FEWEST_POINTS}, got {len(image)}')
    # Copies: the caller's arrays may be read-only, which would compile the kernel once more.
    image, board = image.copy(), board.copy()
    scaled, mean = np.empty_like(board), np.empty(2)
    size = _scale_board(board, scaled, mean)
    if not size < math.inf:
        raise ValueError('board_points must have finite squares')
    collinear = size <= 0.0 or _collinear(scaled)
    return Observation(image, board, scaled, mean, size, collinear, stamp)


def image_center_px(image_size: tuple[float, float]) -> tuple[float, float]:
    """Return the middle of the image, px; pixel centres are integers."""
    return (image_size[0] - 1.0) / 2.0, (image_size[1] - 1.0) / 2.0


@jit
def _farthest2(image: Array) -> float:
    farthest2 = 0.0
    for i in range(len(image)):
        farthest2 = max(farthest2, image[i, 0] * image[i, 0] + image[i, 1] * image[i, 1])
    return farthest2


@jit
def _scale_board(points: Array, board: Array, mean: Array) -> float:
    """Write the scaled points and the mean; return the size, infinite if its square overflows."""
    n = len(points)
    mean[0] = mean[1] = 0.0
    for i in range(n):
        # Relative to the first point: far from the origin a plain sum is inaccurate.
        for j in range(2):
            board[i, j] = points[i, j] - points[0, j]
            mean[j] += board[i, j] / n
    size = 0.0
    for i in range(n):
        for j in range(2):
            board[i, j] -= mean[j]
            size = max(size, abs(board[i, j]))
    for i in range(n):
        for j in range(2):
            board[i, j] /= size
    for j in range(2):
        mean[j] += points[0, j]
    # The kernels square it.
    return size if size * size < math.inf else math.inf


@jit
def _collinear(board: Array) -> bool:
    """Return whether points about their mean lie on one line."""
    farthest = 0
    largest2 = 0.0
    for i in range(len(board)):
        square = board[i, 0] * board[i, 0] + board[i, 1] * board[i, 1]
        if square > largest2:
            farthest, largest2 = i, square
    x, y = board[farthest, 0], board[farthest, 1]
    deviation = 0.0
    for i in range(len(board)):
        deviation = max(deviation, abs(x * board[i, 1] - y * board[i, 0]))
    return not deviation > _ON_A_LINE * largest2
