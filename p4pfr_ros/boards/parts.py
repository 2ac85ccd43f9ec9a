# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""Shared by all boards: point grids, marker corners and argument checks."""

from __future__ import annotations

from collections.abc import Callable
import functools
import math
from numbers import Integral, Real
import re
from typing import Any, TypeVar

import numpy as np
from numpy.typing import ArrayLike
from p4pfr_ros.boards.conventions import CORNER_ORDERS
from p4pfr_ros.core.geometry import Array

_MAX_PER_ROW, _MAX_TOTAL = 1000, 10_000
_SHORTEST_M, _LONGEST_M = 1e-6, 1e4
_WIDEST_BORDER = 4
_CACHED_BOARDS = 64
_DICTIONARY_SIZE = re.compile(r'(?<=\dX\d)_\d+$')


BoardType = TypeVar('BoardType')


def computed_once(points: Callable[[BoardType], Array]) -> Callable[[BoardType], Array]:
    """Cache an array of a board, which detection needs for every image; return copies of it."""
    cached = functools.lru_cache(maxsize=_CACHED_BOARDS)(points)

    @functools.wraps(points)
    def copied(board: BoardType) -> Array:
        return cached(board).copy()

    return copied


class WithoutMarkers:
    """Shared part of boards without markers, which are black on white."""

    __slots__ = ()

    @property
    def inverted(self) -> bool:
        """Black on white; an inverted chessboard is a chessboard that begins with white."""
        return False

    @property
    def marker_ids(self) -> tuple[int, ...]:
        """No markers: ()."""
        return ()

    @property
    def marker_corners(self) -> Array:
        """No markers: (0, 4, 2)."""
        return np.empty((0, 4, 2))


def grid_points(columns: int, rows: int, step_m: float) -> Array:
    """Return points (rows * columns, 2) centred on the origin, row by row from the top left."""
    x = (np.arange(columns) - 0.5 * (columns - 1)) * step_m
    y = (0.5 * (rows - 1) - np.arange(rows)) * step_m
    grid: Array = np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2)
    return grid


def checkerboard_squares(columns: int, rows: int, side_m: float, *, with_first: bool) -> Array:
    """
    Return every second square of a checkerboard, (N, 4): left, bottom, right, top.

    with_first: whether the square at the top left is one of them.
    """
    column, row = np.meshgrid(np.arange(columns), np.arange(rows))
    chosen = ((column + row) % 2 == 0).ravel() == with_first
    centres = grid_points(columns, rows, side_m)[chosen]
    return np.concatenate([centres - 0.5 * side_m, centres + 0.5 * side_m], axis=1)


def marker_corners_at(centres: Array, side_m: ArrayLike, angle_rad: ArrayLike = 0.0) -> Array:
    """
    Return the corners (N, 4, 2) of markers at centres (N, 2), clockwise from the top left.

    side_m and angle_rad (counter-clockwise, as the viewer sees it) are scalars or (N,).
    """
    side, angle = (np.broadcast_to(each, len(centres))[:, None] for each in (side_m, angle_rad))
    x, y = np.array(CORNER_ORDERS['aruco_cw_from_top_left']).T
    cos, sin = np.cos(angle), np.sin(angle)
    offsets = np.stack([cos * x - sin * y, sin * x + cos * y], axis=-1)
    corners: Array = centres[:, None] + side[..., None] * offsets
    return corners


def code_family(dictionary: str) -> str:
    """
    Return the code family of an OpenCV dictionary: its name without the number of markers.

    DICT_4X4_100 begins with the markers of DICT_4X4_50: same ids, same codes.
    """
    return _DICTIONARY_SIZE.sub('', dictionary.upper())


def check_counts(board: Any, at_least: int) -> None:
    """Raise ValueError unless columns and rows are integers within the limits."""
    for key in ('columns', 'rows'):
        value = getattr(board, key)
        if not _is_integer(value) or value < at_least:
            raise ValueError(f'{key}: expected an integer of at least {at_least}, got {value!r}')
        if value > _MAX_PER_ROW:
            raise ValueError(f'{key}: expected at most {_MAX_PER_ROW}, got {value}')
    if board.columns * board.rows > _MAX_TOTAL:
        raise ValueError(
            f'columns: expected at most {_MAX_TOTAL} for columns times rows, '
            f'got {board.columns * board.rows}'
        )


def check_lengths(board: Any, *keys: str) -> None:
    """Raise ValueError unless the values are lengths of real boards."""
    for key in keys:
        value = getattr(board, key)
        is_number = isinstance(value, Real) and not isinstance(value, bool)
        # This form of the comparison rejects NaN too.
        if not is_number or not 0.0 < value < math.inf:
            raise ValueError(f'{key}: expected a length > 0 (metres), got {value!r}')
        if not _SHORTEST_M <= value <= _LONGEST_M:
            raise ValueError(
                f'{key}: expected a length from {_SHORTEST_M:g} to {_LONGEST_M:g} m, got {value!r}'
            )


def check_numbers(board: Any, *keys: str) -> None:
    """Raise ValueError unless the values are finite numbers, no larger than a real board."""
    for key in keys:
        value = getattr(board, key)
        is_number = isinstance(value, Real) and not isinstance(value, bool)
        if not is_number or not math.isfinite(value):
            raise ValueError(f'{key}: expected a finite number, got {value!r}')
        if not abs(value) <= _LONGEST_M:
            raise ValueError(f'{key}: expected a number within {_LONGEST_M:g}, got {value!r}')


def check_id(board: Any, key: str) -> None:
    """Raise ValueError unless the id is a non-negative integer."""
    value = getattr(board, key)
    if not _is_integer(value) or value < 0:
        raise ValueError(f'{key}: expected an integer of at least 0, got {value!r}')


def check_markers(board: Any) -> None:
    """Raise ValueError unless border, inversion and dictionary of a board's markers are valid."""
    _check_border(board)
    _check_inverted(board)
    _check_dictionary(board)


def _check_dictionary(board: Any) -> None:
    """Raise ValueError unless the name has the form of a dictionary name."""
    # detection/aruco.py checks that OpenCV has it; this package does not import OpenCV.
    if not isinstance(board.dictionary, str) or not board.dictionary.startswith('DICT_'):
        raise ValueError(
            f"dictionary: expected the name of an OpenCV dictionary, such as 'DICT_4X4_50', "
            f'got {board.dictionary!r}'
        )


def _check_border(board: Any) -> None:
    """Raise ValueError unless the width of the markers' black border is an integer, 1 to 4."""
    value = board.border_bits
    if not _is_integer(value) or not 1 <= value <= _WIDEST_BORDER:
        raise ValueError(
            f'border_bits: expected an integer from 1 to {_WIDEST_BORDER} (cells), got {value!r}'
        )


def _check_inverted(board: Any) -> None:
    """Raise ValueError unless inverted is True, False or 'any'."""
    value = board.inverted
    if not (isinstance(value, bool) or value == 'any'):
        raise ValueError(f'inverted: expected true, false or any, got {value!r}')


def check_name(board: Any) -> None:
    """Raise ValueError unless the name is a non-blank string."""
    if not isinstance(board.name, str) or not board.name.strip():
        raise ValueError(f'name: expected a word, got {board.name!r}')


def _is_integer(value: object) -> bool:
    return isinstance(value, Integral) and not isinstance(value, bool)
