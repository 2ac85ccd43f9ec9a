# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""
Detection of chessboards: OpenCV finds the corners, which are then ordered as printed and refined.

This module stands alone, as each finder of a family of boards does.
"""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray
from p4pfr_ros.boards import Chessboard
from p4pfr_ros.core.geometry import Array, Ints
from p4pfr_ros.detection.saddles import refine_saddles

# Patches of neighbouring corners must not overlap, so the radius is below half a square. OpenCV's
# windows are square, so theirs is smaller.
_RADIUS_IN_SQUARES = 0.45
_SUBPIX_WINDOW_IN_SQUARES = 0.3
# Largest second difference of corners along a line, in squares. Measured: 0.16 on photographs, 0.6
# with the widest lens or a blurred board; 0.98 and more with a misplaced corner.
_MAX_SECOND_DIFFERENCE = 0.75
# A board with a smaller fraction of its corners refined is a false positive.
_MIN_REFINED_FRACTION = 0.5


def find_chessboard(grey: NDArray[np.uint8], board: Chessboard) -> tuple[Ints, Array]:
    """
    Find a chessboard's inner corners in an image (h, w).

    Returns
    -------
    Ids (N,) (indices in the board's points) and corners (N, 2) px, empty if the board is not
    found. Corners that cannot be fitted, such as covered ones, are left out.

    """
    coarse = _search(grey, board.columns, board.rows)
    if coarse is None:
        return np.empty(0, dtype=np.int64), np.empty((0, 2))
    grid = order_as_printed(grey, coarse)
    along, across = np.gradient(grid, axis=1), np.gradient(grid, axis=0)
    spacing_px = _spacing_px(grid).ravel()
    start = _refine_with_opencv(grey, grid.reshape(-1, 2), spacing_px)
    saddles = refine_saddles(
        grey, start, along.reshape(-1, 2), across.reshape(-1, 2), _RADIUS_IN_SQUARES
    )
    ids = np.flatnonzero(saddles.good)
    if len(ids) < _MIN_REFINED_FRACTION * len(start):
        ids = ids[:0]
    return ids, saddles.points[ids]


def _search(grey: NDArray[np.uint8], columns: int, rows: int) -> Array | None:
    """Return OpenCV's corners (rows, columns, 2) px, accurate to a pixel or two, or None."""
    size = (columns, rows)
    flags = cv2.CALIB_CB_ADAPTIVE_THRESH | cv2.CALIB_CB_NORMALIZE_IMAGE
    # The second detector is slower and misses more photographs (2 of 13, the first one none), but
    # it finds some blurred or distant boards that the first one misses.
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
    """Return whether the lines of corners are as smooth as a lens leaves them."""
    spacing_px = _spacing_px(grid)
    in_rows = np.linalg.norm(np.diff(grid, 2, axis=1), axis=2) / spacing_px[:, 1:-1]
    in_columns = np.linalg.norm(np.diff(grid, 2, axis=0), axis=2) / spacing_px[1:-1]
    return bool(max(in_rows.max(), in_columns.max()) < _MAX_SECOND_DIFFERENCE)


def order_as_printed(grey: NDArray[np.uint8], grid: Array) -> Array:
    """Reorder the corners (rows, columns, 2) to begin at the board's own top left."""
    along, down = np.gradient(grid, axis=1), np.gradient(grid, axis=0)
    if np.sum(along[..., 0] * down[..., 1] - along[..., 1] * down[..., 0]) < 0.0:
        grid = grid[:, ::-1]  # mirrored
    quarter_turns = [0, 1, 2, 3] if grid.shape[0] == grid.shape[1] else [0, 2]
    candidates = [np.rot90(grid, turns) for turns in quarter_turns]
    # All candidates remain if the colours do not decide, or are not those that we print.
    matching = [each for each in candidates if _begins_with_black(grey, each)] or candidates
    return max(matching, key=_upward_px)


def _begins_with_black(grey: NDArray[np.uint8], grid: Array) -> bool:
    """Return whether the board's top left square is black, from the squares between corners."""
    centres = 0.25 * (grid[:-1, :-1] + grid[1:, :-1] + grid[:-1, 1:] + grid[1:, 1:])
    x, y = np.rint(centres).astype(np.int64).reshape(-1, 2).T
    levels = grey[np.clip(y, 0, grey.shape[0] - 1), np.clip(x, 0, grey.shape[1] - 1)]
    row, column = np.indices(centres.shape[:2]).reshape(2, -1)
    # The square between the first four corners has the colour of the board's top left square.
    like_first = (row + column) % 2 == 0
    return bool(levels[like_first].mean() < levels[~like_first].mean())


def _upward_px(grid: Array) -> float:
    """Return how far the board's y axis points up in the image, pixels summed over columns."""
    return float(np.sum(grid[-1, :, 1] - grid[0, :, 1]))


def _spacing_px(grid: Array) -> Array:
    """Return the distance (rows, columns) px from each corner to its nearest neighbour."""
    spacing_px = np.full(grid.shape[:2], np.inf)
    for axis in (0, 1):
        step_px = np.linalg.norm(np.diff(grid, axis=axis), axis=2)
        before, after = [(0, 0), (0, 0)], [(0, 0), (0, 0)]
        before[axis], after[axis] = (1, 0), (0, 1)
        for side in (before, after):
            padded_px = np.pad(step_px, side, constant_values=np.inf)
            spacing_px = np.minimum(spacing_px, padded_px)
    return spacing_px


def _refine_with_opencv(grey: NDArray[np.uint8], points: Array, spacing_px: Array) -> Array:
    """Refine the corners to a fraction of a pixel, in windows scaled with the squares."""
    windows = np.clip(np.rint(_SUBPIX_WINDOW_IN_SQUARES * spacing_px), 2, 15).astype(int)
    refined = points.copy()
    criteria = (cv2.TERM_CRITERIA_EPS | cv2.TERM_CRITERIA_COUNT, 40, 1e-3)
    for window in np.unique(windows):
        chosen = windows == window
        corners = points[chosen].astype(np.float32).reshape(-1, 1, 2).copy()
        moved = cv2.cornerSubPix(grey, corners, (int(window), int(window)), (-1, -1), criteria)
        refined[chosen] = moved.reshape(-1, 2)
    return refined
