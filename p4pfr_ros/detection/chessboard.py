# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""Chessboards in pictures: found by OpenCV, refined by us, turned the way the board is printed."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray
from p4pfr_ros.boards import Chessboard
from p4pfr_ros.core.geometry import Array, Ints
from p4pfr_ros.detection.saddles import refine_saddles

# Half a square away begins the next corner's patch; windows of OpenCV's are square.
_RADIUS_IN_SQUARES = 0.45
_SUBPIX_IN_SQUARES = 0.3
# Second difference of corners in a line, in squares. Seen: 0.16 on photographs, 0.6 through the
# widest lens or on a blurred board; 0.98 and more where a corner is a wrong one.
_MOST_BEND = 0.75
# A board with fewer of its corners refined is a false alarm.
_LEAST_PART = 0.5


def find_chessboard(grey: NDArray[np.uint8], board: Chessboard) -> tuple[Ints, Array]:
    """
    Find a chessboard's inner corners in a picture (h, w).

    Returns
    -------
    Ids (N,), indices in the board's points, and corners (N, 2) px; empty when it is not found. A
    corner that does not look like one (something covers it) is left out.

    """
    rough = _search(grey, board.columns, board.rows)
    if rough is None:
        return np.empty(0, dtype=np.int64), np.empty((0, 2))
    grid = as_printed(grey, rough)
    along, across = np.gradient(grid, axis=1), np.gradient(grid, axis=0)
    spacing = _spacing(grid).ravel()
    start = _approach(grey, grid.reshape(-1, 2), spacing)
    saddles = refine_saddles(
        grey, start, along.reshape(-1, 2), across.reshape(-1, 2), _RADIUS_IN_SQUARES
    )
    ids = np.flatnonzero(saddles.good)
    if len(ids) < _LEAST_PART * len(start):
        ids = ids[:0]
    return ids, saddles.points[ids]


def _search(grey: NDArray[np.uint8], columns: int, rows: int) -> Array | None:
    """Return the corners (rows, columns, 2) px as OpenCV finds them, to a pixel or two."""
    size = (columns, rows)
    flags = cv2.CALIB_CB_ADAPTIVE_THRESH | cv2.CALIB_CB_NORMALIZE_IMAGE
    # The second detector is slower and misses more photographs than the first one (2 of 13 where
    # that finds all), but finds some boards that are blurred or far away and that it misses.
    for search, options in (
        (cv2.findChessboardCorners, flags),
        (cv2.findChessboardCornersSB, 0),
    ):
        found, corners = search(grey, size, flags=options)
        if found:
            grid = np.asarray(corners, dtype=np.float64).reshape(rows, columns, 2)
            if is_smooth(grid):
                return grid
    return None


def is_smooth(grid: Array) -> bool:
    """Say whether the corners' lines bend as a lens bends them: no corner is a wrong one."""
    spacing = _spacing(grid)
    by_columns = np.linalg.norm(np.diff(grid, 2, axis=1), axis=2) / spacing[:, 1:-1]
    by_rows = np.linalg.norm(np.diff(grid, 2, axis=0), axis=2) / spacing[1:-1]
    return bool(max(by_columns.max(), by_rows.max()) < _MOST_BEND)


def as_printed(grey: NDArray[np.uint8], grid: Array) -> Array:
    """Turn the corners (rows, columns, 2) so that they begin at the board's own top left."""
    along, down = np.gradient(grid, axis=1), np.gradient(grid, axis=0)
    if np.sum(along[..., 0] * down[..., 1] - along[..., 1] * down[..., 0]) < 0.0:
        grid = grid[:, ::-1]  # a mirror image
    turns = [0, 1, 2, 3] if grid.shape[0] == grid.shape[1] else [0, 2]
    ways = [np.rot90(grid, turn) for turn in turns]
    # Where colours cannot tell, or are not those that we print, all ways remain.
    fitting = [way for way in ways if _begins_with_black(grey, way)] or ways
    return max(fitting, key=_upwards)


def _begins_with_black(grey: NDArray[np.uint8], grid: Array) -> bool:
    """Say whether the square at the top left is black, from those between the corners."""
    centres = 0.25 * (grid[:-1, :-1] + grid[1:, :-1] + grid[:-1, 1:] + grid[1:, 1:])
    x, y = np.rint(centres).astype(np.int64).reshape(-1, 2).T
    levels = grey[np.clip(y, 0, grey.shape[0] - 1), np.clip(x, 0, grey.shape[1] - 1)]
    row, column = np.indices(centres.shape[:2]).reshape(2, -1)
    # The square between the first four corners has the colour of the one at the board's corner.
    like_first = (row + column) % 2 == 0
    return bool(levels[like_first].mean() < levels[~like_first].mean())


def _upwards(grid: Array) -> float:
    """Return how far up in the picture (pixels) the board's y axis points."""
    return float(np.sum(grid[-1, :, 1] - grid[0, :, 1]))


def _spacing(grid: Array) -> Array:
    """Return the distance (rows, columns) px from each corner to the nearest one."""
    spacing = np.full(grid.shape[:2], np.inf)
    for axis in (0, 1):
        step = np.linalg.norm(np.diff(grid, axis=axis), axis=2)
        before, after = [(0, 0), (0, 0)], [(0, 0), (0, 0)]
        before[axis], after[axis] = (1, 0), (0, 1)
        for side in (before, after):
            spacing = np.minimum(spacing, np.pad(step, side, constant_values=np.inf))
    return spacing


def _approach(grey: NDArray[np.uint8], points: Array, spacing_px: Array) -> Array:
    """Move the corners to within a fraction of a pixel, with windows that suit the squares."""
    windows = np.clip(np.rint(_SUBPIX_IN_SQUARES * spacing_px), 2, 15).astype(int)
    moved = points.copy()
    stop = (cv2.TERM_CRITERIA_EPS | cv2.TERM_CRITERIA_COUNT, 40, 1e-3)
    for window in np.unique(windows):
        chosen = windows == window
        corners = points[chosen].astype(np.float32).reshape(-1, 1, 2).copy()
        refined = cv2.cornerSubPix(grey, corners, (int(window), int(window)), (-1, -1), stop)
        moved[chosen] = refined.reshape(-1, 2)
    return moved
