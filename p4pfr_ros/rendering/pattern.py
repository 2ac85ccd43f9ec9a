# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""The printed pattern of a board as exact shapes, for rendering and printing."""

from __future__ import annotations

from functools import lru_cache

import numpy as np
from numpy.typing import NDArray
from p4pfr_ros.boards import Board, CircleGrid
from p4pfr_ros.core.geometry import Array
from p4pfr_ros.detection.aruco import check_markers, marker_cells

# Vertices of a circle's polygon, which has the circle's area: its outline is within 1e-4 radii.
_CIRCLE_VERTICES = 180


@lru_cache(maxsize=32)
def black_shapes(board: Board) -> Array:
    """
    Return the black shapes of the pattern as polygons (N, n, 2) in metres, clockwise.

    Squares and cells are rectangles (n = 4), circles have more vertices. A rectangle in a marker
    is rotated with it. Shapes may touch but do not overlap. In an inverted board they are white.
    The array is read-only.

    Raises
    ------
    ValueError
        OpenCV lacks the dictionary, or the dictionary lacks a marker.

    """
    black = _discs(board) if isinstance(board, CircleGrid) else _black_quads(board)
    black.flags.writeable = False  # shared through the cache
    return black


def _black_quads(board: Board) -> Array:
    check_markers(board)
    parts = [quads(board.black_squares)]
    for marker_id, corners in zip(board.marker_ids, board.marker_corners, strict=True):
        cells = marker_cells(
            board.dictionary,  # type: ignore[union-attr]
            marker_id,
            board.border_bits,  # type: ignore[union-attr]
        )
        parts.append(_cell_quads(cells, corners))
    return np.concatenate(parts)


def _discs(board: CircleGrid) -> Array:
    """Return the circles as polygons (N, n, 2)."""
    angles = np.linspace(0.0, -2.0 * np.pi, _CIRCLE_VERTICES, endpoint=False)
    step = 2.0 * np.pi / _CIRCLE_VERTICES
    radius_m = 0.5 * board.diameter_m * np.sqrt(step / np.sin(step))
    circle = radius_m * np.stack([np.cos(angles), np.sin(angles)], axis=1)
    discs: Array = board.points[:, None] + circle
    return discs


def quads(rectangles: Array) -> Array:
    """Return the corners (N, 4, 2), clockwise from the top left, of (N, 4) rectangles."""
    left, bottom, right, top = rectangles.T
    corners = [(left, top), (right, top), (right, bottom), (left, bottom)]
    return np.stack([np.stack(corner, axis=1) for corner in corners], axis=1)


def _cell_quads(black: NDArray[np.bool_], corners: Array) -> Array:
    """Return a marker's runs of black cells, row by row, as quads (N, 4, 2)."""
    # A run begins at a step from white to black and ends at one from black to white.
    steps = np.diff(np.pad(black.astype(np.int8), ((0, 0), (1, 1))), axis=1)
    row, begin = np.nonzero(steps == 1)
    _, end = np.nonzero(steps == -1)
    # In units of the marker's side from its top left, y down.
    runs = quads(np.stack([begin, row + 1, end, row], axis=1)) / len(black)
    top_left, top_right, _, bottom_left = corners
    across, down = top_right - top_left, bottom_left - top_left
    placed: Array = top_left + runs[..., :1] * across + runs[..., 1:] * down
    return placed
