# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""``p4pfr board``: a board on paper, to scale."""

from __future__ import annotations

import argparse

from p4pfr_ros.cli.arguments import positive
from p4pfr_ros.files.boards import load_board


def add_parser(commands: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    """Describe the command to argparse."""
    parser = commands.add_parser('board', help='write a board to a file that prints to scale')
    parser.set_defaults(run=run)
    parser.add_argument('board', metavar='FILE', help='the board, in YAML')
    parser.add_argument(
        '-o', '--output', required=True, metavar='FILE', help='where to: a .pdf or a .png'
    )
    parser.add_argument(
        '--dpi', type=positive, default=300.0, help='pixels per inch of a PNG (default: 300)'
    )


def run(arguments: argparse.Namespace) -> int:
    """Write the board and say what it is."""
    # matplotlib is behind it, which takes a while.
    from p4pfr_ros.rendering.printing import describe, print_board

    board = load_board(arguments.board)
    print_board(board, arguments.output, dpi=arguments.dpi)
    print(f'{arguments.output}: {describe(board)}')
    return 0
