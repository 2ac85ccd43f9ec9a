# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""
From the keys and values of a board file to boards, and words for what is wrong with them.

All that is raised here is a ``ValueError`` in the user's words: the path of a key, what was
expected there, and what came.
"""

from __future__ import annotations

import dataclasses
import difflib
from itertools import combinations
import math
import re
from typing import Any

from p4pfr_ros.boards import Board, Bundle, Charuco, Chessboard, Marker, MarkerGrid, PlacedMarker
from p4pfr_ros.boards.parts import code_family

_TYPES: dict[str, type[Board]] = {
    'chessboard': Chessboard,
    'charuco': Charuco,
    'marker': Marker,
    'marker_grid': MarkerGrid,
    'bundle': Bundle,
}
_PER_METRE = {'m': 1.0, 'mm': 1000.0}
# Metres too, but of either sign, or zero.
_COORDINATES = ('x_m', 'y_m')
_POWER = re.compile(r'(\d+)(\.\d*)?[eE]([-+]?)(\d+)')


def boards_from(tree: object) -> dict[str, Board]:
    """
    Make the boards of a file, by name.

    Raises
    ------
    ValueError
        ``PATH: expected ..., got ...``.

    """
    if tree is None:
        raise ValueError("expected a key 'boards', got an empty file")
    if not isinstance(tree, dict):
        raise ValueError(f"expected a key 'boards', got {_kind(tree)}")
    _reject_unknown(tree, ['boards'], prefix='')
    given = tree.get('boards')
    if not isinstance(given, dict) or not given:
        raise ValueError(f'boards: expected names of boards, got {_kind(given)}')
    boards = {name: _board_from(name, fields) for name, fields in given.items()}
    for first, second in combinations(boards.values(), 2):
        _reject_lookalike(first, second)
    return boards


def _board_from(name: object, given: object) -> Board:
    path = f'boards.{name}'
    if not isinstance(name, str):
        raise ValueError(f'{path}: expected a word as the name, got {_kind(name)}')
    if not isinstance(given, dict):
        raise ValueError(f'{path}: expected keys such as type, got {_kind(given)}')
    kind = _choose_type(given, path)
    values = _values(kind, {key: v for key, v in given.items() if key != 'type'}, path)
    if kind is Bundle:
        values['markers'] = _markers_from(values['markers'], f'{path}.markers')
    try:
        board = kind(name=name, **values)
        if board.marker_ids:
            # OpenCV is behind it, which takes a while.
            from p4pfr_ros.detection.aruco import check_markers

            check_markers(board)
        return board
    except ValueError as error:
        raise ValueError(f'{path}.{error}') from None


def _markers_from(given: object, path: str) -> tuple[PlacedMarker, ...]:
    if not isinstance(given, list):
        raise ValueError(f'{path}: expected a list of markers, got {_kind(given)}')
    return tuple(_marker_from(fields, f'{path}[{n}]') for n, fields in enumerate(given))


def _marker_from(given: object, path: str) -> PlacedMarker:
    if not isinstance(given, dict):
        raise ValueError(f'{path}: expected keys such as id, got {_kind(given)}')
    values = _values(PlacedMarker, given, path)
    try:
        return PlacedMarker(**values)
    except ValueError as error:
        raise ValueError(f'{path}.{error}') from None


def _reject_lookalike(first: Board, second: Board) -> None:
    """Refuse a second board of which a picture would not tell whether it is the first."""
    shared = _told_by(first) & _told_by(second)
    if shared:
        raise ValueError(
            f'boards.{second.name}: expected what no other board has, got {min(shared)}, '
            f'which boards.{first.name} has too'
        )


def _told_by(board: Board) -> set[str]:
    """Return what a board is told by in a picture."""
    if isinstance(board, Chessboard):
        longer, shorter = sorted((board.columns, board.rows), reverse=True)
        return {f'a chessboard of {longer}x{shorter} corners'}
    family = code_family(board.dictionary)
    return {f'marker {marker_id} of {family}' for marker_id in board.marker_ids}


def _choose_type(given: dict[Any, Any], path: str) -> type[Board]:
    kind = given.get('type')
    if not isinstance(kind, str) or kind not in _TYPES:
        got = 'none' if 'type' not in given else repr(kind)
        raise ValueError(
            f'{path}.type: expected one of {", ".join(_TYPES)}, got {got}'
            + _suggest(kind, list(_TYPES))
        )
    return _TYPES[kind]


def _values(
    kind: type[Board] | type[PlacedMarker], given: dict[Any, Any], path: str
) -> dict[str, Any]:
    """Return the values of a class's fields, all that have no default; lengths in metres."""
    fields = {field.name: field for field in dataclasses.fields(kind) if field.name != 'name'}
    values = _in_metres(given, list(fields), path)
    for field in fields.values():
        if field.name not in values and field.default is dataclasses.MISSING:
            unit = f' (or {field.name}m, in millimetres)' if field.name.endswith('_m') else ''
            raise ValueError(f'{path}.{field.name}: expected a value, got none{unit}')
    return values


def _in_metres(given: dict[Any, Any], fields: list[str], path: str) -> dict[str, Any]:
    """Return the values by the names of fields, lengths turned into metres."""
    lengths = [name for name in fields if name.endswith('_m')]
    values: dict[str, Any] = {}
    for key, value in given.items():
        stem, _, unit = str(key).rpartition('_')
        field = f'{stem}_m' if f'{stem}_m' in lengths and unit in _PER_METRE else str(key)
        if f'{key}_m' in lengths:
            raise ValueError(f'{path}.{key}: expected a unit: {key}_m or {key}_mm, got {key}')
        if field not in fields:
            _reject_unknown({key: value}, fields, prefix=f'{path}.')
        if field in values:
            raise ValueError(f'{path}.{key}: expected one of {stem}_m and {stem}_mm, got both')
        values[field] = value
        if field in lengths:
            values[field] = _length(value, f'{path}.{key}', unit, field in _COORDINATES)
    return values


def _length(value: object, path: str, unit: str, is_coordinate: bool) -> float:
    is_number = isinstance(value, (int, float)) and not isinstance(value, bool)
    low = -math.inf if is_coordinate else 0.0
    if not is_number or not low < value < math.inf:  # type: ignore[operator]
        what = 'a finite coordinate' if is_coordinate else 'a length > 0'
        raise ValueError(f'{path}: expected {what} in {unit}, got {value!r}{_power_hint(value)}')
    return float(value) / _PER_METRE[unit]  # type: ignore[arg-type]


def _power_hint(value: object) -> str:
    """Say how YAML 1.1 wants a power of ten, which it takes for text if anything is missing."""
    power = _POWER.fullmatch(value) if isinstance(value, str) else None
    if power is None:
        return ''
    whole, fraction, sign, exponent = power.groups()
    return f' (YAML wants {whole}{fraction or ".0"}e{sign or "+"}{exponent})'


def _reject_unknown(given: dict[Any, Any], known: list[str], prefix: str) -> None:
    for key in given:
        if key not in known:
            raise ValueError(
                f'{prefix}{key}: unknown key, expected one of {", ".join(known)}'
                + _suggest(key, known)
            )


def _suggest(word: object, known: list[str]) -> str:
    near = difflib.get_close_matches(str(word), known, n=1)
    return f' (did you mean {near[0]}?)' if near else ''


def _kind(value: object) -> str:
    """Say what a YAML value is, in a user's words."""
    if value is None:
        return 'nothing'
    if isinstance(value, dict):
        return 'keys and values' if value else 'no key'
    return 'a list' if isinstance(value, list) else repr(value)
