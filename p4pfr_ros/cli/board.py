# Copyright 2026 p4pfr_ros maintainers
#
# Licensed under the Apache License, Version 2.0 (the "License");
# you may not use this file except in compliance with the License.
# You may obtain a copy of the License at
#
#     http://www.apache.org/licenses/LICENSE-2.0
#
# Unless required by applicable law or agreed to in writing, software
# distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied.
# See the License for the specific language governing permissions and
# limitations under the License.

"""``p4pfr board``: a board on paper, to scale."""

from __future__ import annotations

import argparse

from p4pfr_ros.cli.arguments import positive
from p4pfr_ros.files import load_board


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
