# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""``p4pfr board``: prints a board to scale."""

from __future__ import annotations

import argparse

from p4pfr_ros.boards.symmetry import symmetry_note
from p4pfr_ros.cli.arguments import load_board_with_notes, positive
from p4pfr_ros.files.dependencies import require

# Those of `PAPERS_MM`, which is in a module that imports matplotlib.
_PAPERS = ('A4', 'Letter', 'A3')


def add_parser(commands: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    """Add the command to the parser."""
    parser = commands.add_parser(
        'board',
        help='write a board to a PDF or PNG file that prints to scale',
        description='Write a board to a PDF or PNG file that prints to scale.',
    )
    parser.set_defaults(run=run)
    parser.add_argument('board', metavar='BOARD', help='board file (YAML)')
    parser.add_argument(
        '-o', '--output', required=True, metavar='FILE', help='output file: .pdf or .png'
    )
    parser.add_argument(
        '--paper',
        choices=_PAPERS,
        help="size of the page (default: as large as the board's sheet)",
    )
    parser.add_argument(
        '--dpi',
        type=positive,
        default=300.0,
        help='resolution of a PNG, pixels per inch (default: %(default)g)',
    )


def run(arguments: argparse.Namespace) -> int:
    """Write the board and print its description."""
    require('matplotlib')
    from p4pfr_ros.rendering.printing import describe, print_board  # imports matplotlib: slow

    board = load_board_with_notes(arguments.board)
    print_board(board, arguments.output, dpi=arguments.dpi, paper=arguments.paper)
    print(f'{arguments.output}: {describe(board)}')
    note = symmetry_note(board.name, board.turns)
    if note:
        print(note)
    return 0
