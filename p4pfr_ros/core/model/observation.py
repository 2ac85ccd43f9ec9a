# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""From the caller's view to well-scaled numbers: the image about its centre, the board about 1."""

from __future__ import annotations

from dataclasses import dataclass
import math

import numpy as np
from numpy.typing import ArrayLike

from ..cameras.division import DivisionCamera
from ..geometry import Array, as_points
from ..jit import jit

# Of the board's size: points no farther from a line than rounding takes them are on it.
_ON_A_LINE = 1e-9


@dataclass(frozen=True, slots=True)
class PreparedView:
    """
    One view, scaled, and the way back.

    image (N, 2) px from center_px, board (N, 2) about board_mean (board units) in units of
    board_size; corner_px is how far the picture's farthest corner is from the centre. collinear:
    the board's points lie on one line, or on one spot.
    """

    image: Array
    board: Array
    center_px: tuple[float, float]
    corner_px: float
    board_mean: Array
    board_size: float
    collinear: bool


def prepare(
    image_points: ArrayLike,
    board_points: ArrayLike,
    image_size: tuple[int, int] | None,
    center_px: tuple[float, float] | None,
    camera: DivisionCamera | None,
) -> PreparedView:
    """
    Check and scale a view.

    Raises
    ------
    ValueError
        A wrong shape, a number that is not finite, or nothing that says where the centre is.

    """
    raw = as_points(image_points, 'image_points', (None, 2))
    points = as_points(board_points, 'board_points', (len(raw), 2))
    if len(raw) < 4:
        raise ValueError(f'image_points must be at least 4, got {len(raw)}')
    size = _checked_size(image_size)
    center = _center(size, center_px, camera)
    image, board, mean = np.empty_like(raw), np.empty_like(points), np.empty(2)
    farthest_px, board_size = _scale(raw, points, center, image, board, mean)
    if not (farthest_px < math.inf and board_size < math.inf):
        name = 'board_points' if farthest_px < math.inf else 'image_points'
        raise ValueError(f'{name} must be of sizes whose squares are finite')
    corner_px = farthest_px if size is None else _farthest_corner(size, center)
    collinear = board_size <= 0.0 or _collinear(board)
    return PreparedView(image, board, center, corner_px, mean, board_size, collinear)


def _checked_size(image_size: tuple[int, int] | None) -> tuple[float, float] | None:
    if image_size is None:
        return None
    width, height = as_points(image_size, 'image_size', (2,)).tolist()
    if not (width >= 1.0 and height >= 1.0):
        raise ValueError(f'image_size must be positive, got {image_size}')
    return width, height


def _center(
    size: tuple[float, float] | None,
    center_px: tuple[float, float] | None,
    camera: DivisionCamera | None,
) -> tuple[float, float]:
    if camera is not None:
        return camera.center_px
    if center_px is not None:
        x, y = as_points(center_px, 'center_px', (2,)).tolist()
        return x, y
    if size is None:
        raise ValueError('image_size, center_px or camera must say where the centre is')
    return (size[0] - 1.0) / 2.0, (size[1] - 1.0) / 2.0


def _farthest_corner(size: tuple[float, float], center: tuple[float, float]) -> float:
    """Return how far the outer corner of the farthest corner pixel is from the centre."""
    return math.hypot(
        *(max(c + 0.5, length - 0.5 - c) for c, length in zip(center, size, strict=True))
    )


@jit
def _scale(
    raw: Array,
    points: Array,
    center: tuple[float, float],
    image: Array,
    board: Array,
    mean: Array,
) -> tuple[float, float]:
    """Fill the scaled arrays and the mean; return the farthest pixel and the board's size."""
    n = len(raw)
    mean[0] = mean[1] = 0.0
    farthest2 = 0.0
    for i in range(n):
        image[i, 0], image[i, 1] = raw[i, 0] - center[0], raw[i, 1] - center[1]
        farthest2 = max(farthest2, image[i, 0] * image[i, 0] + image[i, 1] * image[i, 1])
        # About the first point: far from the origin a plain sum would lose digits.
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
    # The square is what overflows first, further on.
    return math.sqrt(farthest2), size if size * size < math.inf else math.inf


@jit
def _collinear(board: Array) -> bool:
    """Say whether points about their mean lie on one line."""
    farthest = 0
    largest2 = 0.0
    for i in range(len(board)):
        square = board[i, 0] * board[i, 0] + board[i, 1] * board[i, 1]
        if square > largest2:
            farthest, largest2 = i, square
    x, y = board[farthest, 0], board[farthest, 1]
    away = 0.0
    for i in range(len(board)):
        away = max(away, abs(x * board[i, 1] - y * board[i, 0]))
    return not away > _ON_A_LINE * largest2
