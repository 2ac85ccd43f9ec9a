# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""Loads boards from YAML files."""

from __future__ import annotations

import dataclasses
from itertools import combinations
import os
from typing import Any

from p4pfr_ros.boards import Board, Bundle, Charuco, Chessboard, Marker, MarkerGrid, PlacedMarker
from p4pfr_ros.boards.parts import code_family
from p4pfr_ros.files.yaml_fields import ConfigError, Fields, length_keys, read_yaml

_TYPES: dict[str, type[Board]] = {
    'chessboard': Chessboard,
    'charuco': Charuco,
    'marker': Marker,
    'marker_grid': MarkerGrid,
    'bundle': Bundle,
}
# In metres like the lengths, but of any sign.
_COORDINATES = ('x_m', 'y_m')


def load_board(path: str | os.PathLike[str]) -> Board:
    """
    Load the board of a file that holds exactly one.

    Raises
    ------
    ConfigError
        The file is wrong (see `load_boards`) or holds several boards.

    """
    boards = load_boards(path)
    if len(boards) != 1:
        raise ConfigError(
            f'{path}: boards: expected one board, got {len(boards)}: ' + ', '.join(boards)
        )
    return next(iter(boards.values()))


def load_boards(path: str | os.PathLike[str]) -> dict[str, Board]:
    """
    Load the boards of a file, by name.

    The file's only key ``boards`` maps names to boards. A board's key ``type`` selects its class
    (chessboard, charuco, marker, marker_grid, bundle); its other keys are the fields of that
    class. Lengths are given in metres (``square_m``) or millimetres (``square_mm``). Every board
    of a file must be distinguishable from the others in an image.

    Raises
    ------
    ConfigError
        ``PATH: KEY: expected ..., got ...``.

    """
    tree = read_yaml(path)
    try:
        return _boards_from(tree)
    except ValueError as error:
        raise ConfigError(f'{path}: {error}') from None


def _boards_from(tree: object) -> dict[str, Board]:
    if tree is None:
        raise ValueError("expected a key 'boards', got an empty file")
    file = Fields.of(tree, expected="a key 'boards'")
    file.reject_unknown(['boards'])
    given = file.section('boards', 'names of boards')
    if not given.values:
        raise file.error('boards', 'names of boards')
    boards = {name: _board_from(name, given) for name in given.values}
    for first, second in combinations(boards.values(), 2):
        _reject_ambiguous(first, second)
    return boards


def _board_from(name: object, boards: Fields) -> Board:
    if not isinstance(name, str):
        raise ValueError(f'{boards.path_of(name)}: expected a word as the name, got {name!r}')
    fields = boards.section(name, 'keys such as type')
    kind = _TYPES[fields.choice('type', _TYPES)]
    arguments = _arguments(kind, fields, ['type'])
    if kind is Bundle:
        markers = fields.sections('markers', 'keys such as id', 'a list of markers')
        arguments['markers'] = tuple(_marker_from(marker) for marker in markers)
    try:
        board = kind(name=name, **arguments)
        if board.marker_ids:
            # Imports OpenCV, which is slow and needed for markers only.
            from p4pfr_ros.detection.aruco import check_markers

            check_markers(board)
        return board
    except ValueError as error:
        raise ValueError(f'{fields.path}.{error}') from None


def _marker_from(fields: Fields) -> PlacedMarker:
    arguments = _arguments(PlacedMarker, fields)
    try:
        return PlacedMarker(**arguments)
    except ValueError as error:
        raise ValueError(f'{fields.path}.{error}') from None


def _arguments(
    kind: type[Board] | type[PlacedMarker], fields: Fields, other_keys: list[str] | None = None
) -> dict[str, Any]:
    """Return the arguments of a class, all required ones included, lengths in metres."""
    parameters = [field for field in dataclasses.fields(kind) if field.name != 'name']
    lengths = [p.name.removesuffix('_m') for p in parameters if p.name.endswith('_m')]
    known = [*(other_keys or ()), *(parameter.name for parameter in parameters)]
    fields.reject_unknown(known, aliases=length_keys(lengths))
    arguments: dict[str, Any] = {}
    for parameter in parameters:
        name = parameter.name
        length = name.removesuffix('_m')
        if length in lengths:
            value = fields.length_m(length, is_coordinate=name in _COORDINATES)
        else:
            # The class checks values that are not floats.
            is_float = parameter.type == 'float' and name in fields
            value = fields.number(name) if is_float else fields.values.get(name)
        if value is not None or name in fields:
            arguments[name] = value
        elif parameter.default is dataclasses.MISSING:
            hint = f' (or {length}_mm, in millimetres)' if length in lengths else ''
            raise fields.error(name, 'a value', hint)
    return arguments


def _reject_ambiguous(first: Board, second: Board) -> None:
    """Reject two boards that an image cannot tell apart."""
    shared = _features(first) & _features(second)
    if shared:
        raise ValueError(
            f'boards.{second.name}: expected a pattern that no other board shares, got '
            f'{min(shared)}, also in boards.{first.name}'
        )


def _features(board: Board) -> set[str]:
    """Return descriptions of what identifies a board in an image."""
    if isinstance(board, Chessboard):
        longer, shorter = sorted((board.columns, board.rows), reverse=True)
        return {f'a chessboard of {longer}x{shorter} corners'}
    family = code_family(board.dictionary)
    return {f'marker {marker_id} of {family}' for marker_id in board.marker_ids}
