# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""Board files: YAML on disk, dataclasses in memory, and clear words where a file is wrong."""

from __future__ import annotations

from collections.abc import Hashable
import os
from pathlib import Path
from typing import Any

from p4pfr_ros.boards import Board
from p4pfr_ros.files.board_fields import boards_from
import yaml

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
    is (chessboard, charuco, marker, marker_grid, bundle); its other keys are the fields of that
    class, where a length may be given in metres (``square_m``) or millimetres (``square_mm``).
    No two boards of a file look alike: a picture tells which of them it shows.

    Raises
    ------
    ConfigError
        The file cannot be read, or is not such a file: says where and what was expected.

    """
    tree = read_yaml(path)
    try:
        return boards_from(tree)
    except ValueError as error:
        raise ConfigError(f'{path}: {error}') from None


def read_yaml(path: str | os.PathLike[str]) -> object:
    """
    Read what a YAML file holds, in which no key stands twice.

    Raises
    ------
    ConfigError
        The file cannot be read, or is no such YAML.

    """
    try:
        with Path(path).open(encoding='utf-8') as file:
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
