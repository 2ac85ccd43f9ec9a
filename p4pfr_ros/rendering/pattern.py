# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""The printed pattern of a board as exact shapes, from which pictures and prints are made."""

from __future__ import annotations

from functools import lru_cache

import numpy as np
from numpy.typing import NDArray
from p4pfr_ros.boards import Board
from p4pfr_ros.core.geometry import Array
from p4pfr_ros.detection.aruco import check_markers, marker_cells


@lru_cache(maxsize=32)
def black_quads(board: Board) -> Array:
    """
    Return what is black on the white sheet, (N, 4, 2) corners in metres.

    They are rectangles, turned as their marker is, with their corners clockwise. They do not
    overlap; some touch. The array is read-only.

    Raises
    ------
    ValueError
        This OpenCV has no such dictionary, or the dictionary not these markers.

    """
    check_markers(board)
    parts = [quads(board.black_squares)]
    for marker_id, corners in zip(board.marker_ids, board.marker_corners, strict=True):
        cells = marker_cells(board.dictionary, marker_id)  # type: ignore[union-attr]
        parts.append(_cell_quads(cells, corners))
    black = np.concatenate(parts)
    black.flags.writeable = False  # the cache keeps it
    return black


def quads(rectangles: Array) -> Array:
    """Return the corners (N, 4, 2), clockwise from the top left, of (N, 4) rectangles."""
    left, bottom, right, top = rectangles.T
    corners = [(left, top), (right, top), (right, bottom), (left, bottom)]
    return np.stack([np.stack(corner, axis=1) for corner in corners], axis=1)


def _cell_quads(black: NDArray[np.bool_], corners: Array) -> Array:
    """Return the runs of black cells, row by row, of a marker at its (4, 2) corners."""
    # A run begins where black follows white and ends where white follows black.
    steps = np.diff(np.pad(black.astype(np.int8), ((0, 0), (1, 1))), axis=1)
    row, begin = np.nonzero(steps == 1)
    _, end = np.nonzero(steps == -1)
    # In cells from the marker's top left, y down.
    runs = quads(np.stack([begin, row + 1, end, row], axis=1)) / len(black)
    top_left, top_right, _, bottom_left = corners
    across, down = top_right - top_left, bottom_left - top_left
    placed: Array = top_left + runs[..., :1] * across + runs[..., 1:] * down
    return placed
