# SPDX-License-Identifier: Apache-2.0
"""The printed pattern of a board as exact rectangles, from which pictures and prints are made."""

from __future__ import annotations

from functools import lru_cache

import numpy as np
from numpy.typing import NDArray
from p4pfr_ros.boards import Board
from p4pfr_ros.core.geometry import Array
from p4pfr_ros.detection.aruco import check_markers, marker_cells


@lru_cache(maxsize=32)
def black_rectangles(board: Board) -> Array:
    """
    Return what is black on the white sheet, (N, 4): left, bottom, right, top in metres.

    The rectangles do not overlap; some touch. The array is read-only.

    Raises
    ------
    ValueError
        This OpenCV has no such dictionary, or the dictionary not these markers.

    """
    check_markers(board)
    parts = [board.black_squares]
    for marker_id, corners in zip(board.marker_ids, board.marker_corners, strict=True):
        cells = marker_cells(board.dictionary, marker_id)  # type: ignore[union-attr]
        parts.append(_cell_rectangles(cells, corners))
    rectangles = np.concatenate(parts)
    rectangles.flags.writeable = False  # the cache keeps it
    return rectangles


def _cell_rectangles(black: NDArray[np.bool_], corners: Array) -> Array:
    """Return the runs of black cells, row by row, of a marker at its (4, 2) corners."""
    (left, top), (right, bottom) = corners[0], corners[2]
    n = len(black)
    # A run begins where black follows white and ends where white follows black.
    steps = np.diff(np.pad(black.astype(np.int8), ((0, 0), (1, 1))), axis=1)
    row, begin = np.nonzero(steps == 1)
    _, end = np.nonzero(steps == -1)
    x = np.linspace(left, right, n + 1)
    y = np.linspace(top, bottom, n + 1)
    return np.stack([x[begin], y[row + 1], x[end], y[row]], axis=1)
