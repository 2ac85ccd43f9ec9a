# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""The boards of a node whose parameter ``board_file`` is required."""

from __future__ import annotations

from p4pfr_ros.boards import Board
from p4pfr_ros.files.boards import load_board, load_boards
from p4pfr_ros.files.yaml_fields import ConfigError


def required_board(node_name: str, board_file: str) -> Board:
    """
    Load the only board of the file.

    Raises
    ------
    ConfigError
        The parameter is empty, or the file is invalid or has several boards.

    """
    return load_board(_required(node_name, board_file))


def required_boards(node_name: str, board_file: str) -> dict[str, Board]:
    """
    Load all boards of the file, by name.

    Raises
    ------
    ConfigError
        The parameter is empty, or the file is invalid.

    """
    return load_boards(_required(node_name, board_file))


def _required(node_name: str, board_file: str) -> str:
    if not board_file:
        raise ConfigError(f'{node_name}: board_file: expected the path of a board YAML, got none')
    return board_file
