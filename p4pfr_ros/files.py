# SPDX-License-Identifier: Apache-2.0
"""Board files: YAML on disk, dataclasses in memory, and clear words where a file is wrong."""

from __future__ import annotations

from collections.abc import Hashable
import dataclasses
import difflib
import math
import os
from pathlib import Path
import re
from typing import Any

from p4pfr_ros.boards import Board, Charuco, Chessboard, Marker, MarkerGrid
import yaml

_TYPES: dict[str, type[Board]] = {
    'chessboard': Chessboard,
    'charuco': Charuco,
    'marker': Marker,
    'marker_grid': MarkerGrid,
}
_PER_METRE = {'m': 1.0, 'mm': 1000.0}
_POWER = re.compile(r'(\d+)(\.\d*)?[eE]([-+]?)(\d+)')
_MERGE = 'tag:yaml.org,2002:merge'


class ConfigError(Exception):
    """A file or parameter of the user's is wrong: one line with file, key and expectation."""


def load_board(path: str | os.PathLike[str]) -> Board:
    """
    Read the one board of a file.

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
    Read the boards of a file, by name.

    The file's one key ``boards`` maps names to boards. A board's key ``type`` says which class it
    is (chessboard, charuco, marker, marker_grid); its other keys are the fields of that class,
    where a length may be given in metres (``square_m``) or millimetres (``square_mm``).

    Raises
    ------
    ConfigError
        The file cannot be read, or is not such a file: says where and what was expected.

    """
    tree = _read_yaml(Path(path))
    try:
        return _boards_from(tree)
    except ValueError as error:
        raise ConfigError(f'{path}: {error}') from None


def _boards_from(tree: object) -> dict[str, Board]:
    if tree is None:
        raise ValueError("expected a key 'boards', got an empty file")
    if not isinstance(tree, dict):
        raise ValueError(f"expected a key 'boards', got {_kind(tree)}")
    _reject_unknown(tree, ['boards'], prefix='')
    boards = tree.get('boards')
    if not isinstance(boards, dict) or not boards:
        raise ValueError(f'boards: expected names of boards, got {_kind(boards)}')
    return {name: _board_from(name, fields) for name, fields in boards.items()}


def _board_from(name: object, given: object) -> Board:
    path = f'boards.{name}'
    if not isinstance(name, str):
        raise ValueError(f'{path}: expected a word as the name, got {_kind(name)}')
    if not isinstance(given, dict):
        raise ValueError(f'{path}: expected keys such as type, got {_kind(given)}')
    kind = _choose_type(given, path)
    fields = {f.name: f for f in dataclasses.fields(kind) if f.name != 'name'}
    values = _in_metres({key: v for key, v in given.items() if key != 'type'}, list(fields), path)
    for field in fields.values():
        if field.name not in values and field.default is dataclasses.MISSING:
            unit = f' (or {field.name}m, in millimetres)' if field.name.endswith('_m') else ''
            raise ValueError(f'{path}.{field.name}: expected a value, got none{unit}')
    try:
        board = kind(name=name, **values)
        if board.marker_ids:
            # OpenCV is behind it, which takes a while.
            from p4pfr_ros.detection.aruco import check_markers

            check_markers(board)
        return board
    except ValueError as error:
        raise ValueError(f'{path}.{error}') from None


def _choose_type(given: dict[Any, Any], path: str) -> type[Board]:
    kind = given.get('type')
    if not isinstance(kind, str) or kind not in _TYPES:
        got = 'none' if 'type' not in given else repr(kind)
        raise ValueError(
            f'{path}.type: expected one of {", ".join(_TYPES)}, got {got}'
            + _suggest(kind, list(_TYPES))
        )
    return _TYPES[kind]


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
            _reject_unknown({key: value}, ['type', *fields], prefix=f'{path}.')
        if field in values:
            raise ValueError(f'{path}.{key}: expected one of {stem}_m and {stem}_mm, got both')
        values[field] = _length(value, f'{path}.{key}', unit) if field in lengths else value
    return values


def _length(value: object, path: str, unit: str) -> float:
    is_number = isinstance(value, (int, float)) and not isinstance(value, bool)
    if not is_number or not 0.0 < value < math.inf:  # type: ignore[operator]
        raise ValueError(
            f'{path}: expected a length > 0 in {unit}, got {value!r}{_power_hint(value)}'
        )
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


def _read_yaml(path: Path) -> object:
    try:
        with path.open(encoding='utf-8') as file:
            return yaml.load(file, Loader=_StrictLoader)
    except OSError as error:
        raise ConfigError(f'{path}: expected a readable file: {error.strerror}') from None
    except UnicodeDecodeError:
        raise ConfigError(f'{path}: expected text in UTF-8') from None
    except yaml.MarkedYAMLError as error:
        mark = error.problem_mark
        line = f', line {mark.line + 1}' if mark else ''
        raise ConfigError(f'{path}{line}: expected YAML: {error.problem}') from None
    except yaml.YAMLError as error:
        raise ConfigError(f'{path}: expected YAML: {" ".join(str(error).split())}') from None


class _StrictLoader(yaml.SafeLoader):
    """A safe loader that does not let a key's second value replace the first in silence."""

    def construct_mapping(self, node: yaml.MappingNode, deep: bool = False) -> dict[Hashable, Any]:
        seen: set[Hashable] = set()
        for key_node, _ in node.value:
            if key_node.tag == _MERGE:
                continue  # what it brings may be replaced
            key = self.construct_object(key_node, deep=True)
            if not isinstance(key, Hashable):
                continue  # refused below
            if key in seen:
                raise yaml.constructor.ConstructorError(
                    None, None, f'the key {key!r} stands there twice', key_node.start_mark
                )
            seen.add(key)
        return super().construct_mapping(node, deep)
