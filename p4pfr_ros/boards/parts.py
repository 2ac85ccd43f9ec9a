# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""What the kinds of boards share: grids of points, and checks of their numbers."""

from __future__ import annotations

import math
from numbers import Integral, Real
import re
from typing import Any

import numpy as np
from numpy.typing import ArrayLike
from p4pfr_ros.boards.conventions import CORNER_ORDERS
from p4pfr_ros.core.geometry import Array

_MOST_IN_A_ROW, _MOST_IN_ALL = 1000, 10_000
_HOW_MANY = re.compile(r'(?<=\dX\d)_\d+$')


def grid_points(columns: int, rows: int, step_m: float) -> Array:
    """Return (rows * columns, 2) points around the origin, row by row from the top left."""
    x = (np.arange(columns) - 0.5 * (columns - 1)) * step_m
    y = (0.5 * (rows - 1) - np.arange(rows)) * step_m
    grid: Array = np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2)
    return grid


def checkers(columns: int, rows: int, side_m: float, *, black_first: bool) -> Array:
    """Return every second square, (N, 4): left, bottom, right, top; the first or not."""
    column, row = np.meshgrid(np.arange(columns), np.arange(rows))
    chosen = ((column + row) % 2 == 0).ravel() == black_first
    centres = grid_points(columns, rows, side_m)[chosen]
    return np.concatenate([centres - 0.5 * side_m, centres + 0.5 * side_m], axis=1)


def marker_corners_at(centres: Array, side_m: ArrayLike, turn_rad: ArrayLike = 0.0) -> Array:
    """
    Return the corners (N, 4, 2) of markers at centres (N, 2), clockwise from the top left.

    Sides and turns (counter-clockwise, as the viewer sees it) are one for all, or (N,).
    """
    side, turn = (np.broadcast_to(each, len(centres))[:, None] for each in (side_m, turn_rad))
    x, y = np.array(CORNER_ORDERS['aruco_cw_from_top_left']).T
    cos, sin = np.cos(turn), np.sin(turn)
    offsets = np.stack([cos * x - sin * y, sin * x + cos * y], axis=-1)
    corners: Array = centres[:, None] + side[..., None] * offsets
    return corners


def code_family(dictionary: str) -> str:
    """
    Name the set of codes that a dictionary of OpenCV's is taken from.

    DICT_4X4_50 is the beginning of DICT_4X4_100: a marker of both has the same id and picture.
    """
    return _HOW_MANY.sub('', dictionary.upper())


def check_counts(board: Any, at_least: int) -> None:
    """Refuse columns and rows that are no integers, too few, or more than anybody prints."""
    for key in ('columns', 'rows'):
        value = getattr(board, key)
        if not _is_integer(value) or value < at_least:
            raise ValueError(f'{key}: expected an integer of at least {at_least}, got {value!r}')
        if value > _MOST_IN_A_ROW:
            raise ValueError(f'{key}: expected at most {_MOST_IN_A_ROW}, got {value}')
    if board.columns * board.rows > _MOST_IN_ALL:
        raise ValueError(
            f'columns: expected at most {_MOST_IN_ALL} for columns times rows, '
            f'got {board.columns * board.rows}'
        )


def check_lengths(board: Any, *keys: str) -> None:
    """Refuse lengths that are not positive, finite numbers."""
    for key in keys:
        value = getattr(board, key)
        is_number = isinstance(value, Real) and not isinstance(value, bool)
        # Written so that NaN fails too.
        if not is_number or not 0.0 < value < math.inf:
            raise ValueError(f'{key}: expected a length > 0 (metres), got {value!r}')


def check_numbers(board: Any, *keys: str) -> None:
    """Refuse what is no finite number."""
    for key in keys:
        value = getattr(board, key)
        is_number = isinstance(value, Real) and not isinstance(value, bool)
        if not is_number or not math.isfinite(value):
            raise ValueError(f'{key}: expected a finite number, got {value!r}')


def check_id(board: Any, key: str) -> None:
    """Refuse an id that is no integer or negative."""
    value = getattr(board, key)
    if not _is_integer(value) or value < 0:
        raise ValueError(f'{key}: expected an integer of at least 0, got {value!r}')


def check_dictionary(board: Any) -> None:
    """Refuse what cannot be a dictionary's name."""
    # Whether OpenCV has a dictionary of this name is known in aruco.py.
    if not isinstance(board.dictionary, str) or not board.dictionary.startswith('DICT_'):
        raise ValueError(
            f"dictionary: expected OpenCV's name of one, such as 'DICT_4X4_50', "
            f'got {board.dictionary!r}'
        )


def check_name(board: Any) -> None:
    """Refuse a name that is not a word."""
    if not isinstance(board.name, str) or not board.name.strip():
        raise ValueError(f'name: expected a word, got {board.name!r}')


def _is_integer(value: object) -> bool:
    return isinstance(value, Integral) and not isinstance(value, bool)
