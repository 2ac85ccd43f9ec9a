# SPDX-License-Identifier: Apache-2.0
"""The board that a node's parameter ``board_file`` names."""

from __future__ import annotations

from p4pfr_ros.boards import Board
from p4pfr_ros.files import ConfigError, load_board


def required_board(node_name: str, board_file: str) -> Board:
    """
    Read the board of a node that cannot do without.

    Raises
    ------
    ConfigError
        No file was given, or the file is wrong.

    """
    if not board_file:
        raise ConfigError(f'{node_name}: board_file: expected the path of a board YAML, got none')
    return load_board(board_file)
