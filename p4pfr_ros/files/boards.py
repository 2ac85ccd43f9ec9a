# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""Loads boards from YAML files, and Kalibr's targets."""

from __future__ import annotations

import dataclasses
from itertools import combinations
import os
from typing import Any

from p4pfr_ros.boards import (
    AprilGrid,
    Board,
    Bundle,
    Charuco,
    Chessboard,
    CircleGrid,
    Marker,
    MarkerGrid,
    PlacedMarker,
)
from p4pfr_ros.boards.parts import code_family
from p4pfr_ros.files.printable import printable_path, shown
from p4pfr_ros.files.yaml_fields import ConfigError, Fields, length_keys
from p4pfr_ros.files.yaml_reading import read_yaml

_TYPES: dict[str, type[Board]] = {
    'chessboard': Chessboard,
    'charuco': Charuco,
    'marker': Marker,
    'marker_grid': MarkerGrid,
    'aprilgrid': AprilGrid,
    'bundle': Bundle,
    'circle_grid': CircleGrid,
}
# Kalibr's names of the arguments of an AprilGrid; all but the last are required.
_KALIBR_KEYS = {
    'columns': 'tagCols',
    'rows': 'tagRows',
    'tag_m': 'tagSize',
    'spacing': 'tagSpacing',
    'first_id': 'codeOffset',
}
_KALIBR_TYPE = 'target_type'
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
            f'{printable_path(path)}: boards: expected one board, got {len(boards)}: '
            + ', '.join(boards)
        )
    return next(iter(boards.values()))


def load_boards(path: str | os.PathLike[str]) -> dict[str, Board]:
    """
    Load the boards of a file, by name.

    The file's only key ``boards`` maps names to boards. A board's key ``type`` selects its class
    (chessboard, charuco, marker, marker_grid, aprilgrid, bundle, circle_grid); its other keys are
    the fields of that class. Lengths are given in metres (``square_m``) or millimetres
    (``square_mm``). Every board of a file must be distinguishable from the others in an image.

    An aprilgrid has Kalibr's keys (``tagCols``, ``tagRows``, ``tagSize``, ``tagSpacing``). A file
    with Kalibr's key ``target_type: 'aprilgrid'`` holds that one board, called ``board``.

    Raises
    ------
    ConfigError
        ``PATH: KEY: expected ..., got ...``.

    """
    tree = read_yaml(path)
    try:
        return _boards_from(tree)
    except ValueError as error:
        raise ConfigError(f'{printable_path(path)}: {error}') from None


def _boards_from(tree: object) -> dict[str, Board]:
    if tree is None:
        raise ValueError("expected a key 'boards', got an empty file")
    file = Fields.of(tree, expected="a key 'boards'")
    if _KALIBR_TYPE in file:
        return {'board': _kalibr_target_from(file)}
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
        raise ValueError(f'{boards.path_of(name)}: expected a word as the name, got {shown(name)}')
    fields = boards.section(name, 'keys such as type')
    kind = _TYPES[fields.choice('type', _TYPES)]
    if kind is AprilGrid:
        return _aprilgrid_from(fields, name, 'type')
    arguments = _arguments(kind, fields, ['type'])
    if kind is Bundle:
        markers = fields.sections('markers', 'keys such as id', 'a list of markers')
        arguments['markers'] = tuple(_marker_from(marker) for marker in markers)
    try:
        return _checked(kind(name=name, **arguments))
    except ValueError as error:
        raise ValueError(f'{fields.path}.{error}') from None


def _checked(board: Board) -> Board:
    """Return the board, whose markers OpenCV has."""
    if board.marker_ids:
        # Imports OpenCV, which is slow and needed for markers only.
        from p4pfr_ros.detection.aruco import check_markers

        check_markers(board)
    return board


def _kalibr_target_from(fields: Fields) -> Board:
    """Return the board of a target file of Kalibr."""
    kind = fields.values[_KALIBR_TYPE]
    if kind != 'aprilgrid':
        raise fields.error(
            _KALIBR_TYPE, "'aprilgrid'", ': describe other targets with the key boards'
        )
    return _aprilgrid_from(fields, 'board', _KALIBR_TYPE)


def _aprilgrid_from(fields: Fields, name: str, type_key: str) -> Board:
    """Return an AprilGrid from Kalibr's keys and those of its other fields."""
    others = ['first_id', 'dictionary', 'border_bits', 'inverted']
    fields.reject_unknown([type_key, *_KALIBR_KEYS.values(), *others])
    if 'codeOffset' in fields and 'first_id' in fields:
        raise fields.error('codeOffset', 'one of codeOffset and first_id', ' and first_id')
    for required in list(_KALIBR_KEYS.values())[:-1]:
        if required not in fields:
            raise fields.error(required, 'a value')
    keys = {argument: key for argument, key in _KALIBR_KEYS.items() if key in fields}
    arguments = {argument: fields.values[key] for argument, key in keys.items()}
    for argument in ('tag_m', 'spacing'):
        arguments[argument] = fields.number(keys[argument])
    arguments |= {key: fields.values[key] for key in others if key in fields}
    try:
        return _checked(AprilGrid(name=name, **arguments))
    except ValueError as error:
        argument, _, rest = str(error).partition(':')
        raise ValueError(f'{fields.path_of(keys.get(argument, argument))}:{rest}') from None


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
    if isinstance(board, CircleGrid):
        kind = 'an asymmetric' if board.asymmetric else 'a symmetric'
        return {f'{kind} grid of {board.columns}x{board.rows} circles'}
    family = code_family(board.dictionary)
    return {f'marker {marker_id} of {family}' for marker_id in board.marker_ids}
