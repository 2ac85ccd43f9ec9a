# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""The board, or the boards, that a node's parameter ``board_file`` names."""

from __future__ import annotations

from p4pfr_ros.boards import Board
from p4pfr_ros.files.boards import load_board, load_boards
from p4pfr_ros.files.yaml_fields import ConfigError


def required_board(node_name: str, board_file: str) -> Board:
    """
    Read the one board of a node that cannot do without.

    Raises
    ------
    ConfigError
        No file was given, or the file is wrong, or holds several boards.

    """
    return load_board(_required(node_name, board_file))


def required_boards(node_name: str, board_file: str) -> dict[str, Board]:
    """
    Read the boards, by name, of a node that cannot do without.

    Raises
    ------
    ConfigError
        No file was given, or the file is wrong.

    """
    return load_boards(_required(node_name, board_file))


def _required(node_name: str, board_file: str) -> str:
    if not board_file:
        raise ConfigError(f'{node_name}: board_file: expected the path of a board YAML, got none')
    return board_file
