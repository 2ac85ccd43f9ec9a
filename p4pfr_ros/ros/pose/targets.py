# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""The boards that pose_node looks for, and what they are called on topics and in /tf."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
import re

from p4pfr_ros.boards import Board
from p4pfr_ros.files.boards import load_boards
from p4pfr_ros.files.yaml_fields import ConfigError

from ..parameters.pose_options import PoseNodeOptions
from ..runtime.rejections import Rejected

_ALONE = '~'
_NAMELESS = 'board'


@dataclass(frozen=True, slots=True)
class Target:
    """
    A board as others know it.

    prefix
        What its topics' names begin with: ``~`` where it is the only one, or ``~/NAME``.
    board
        Its geometry, where a file tells it.
    """

    prefix: str = _ALONE
    board: Board | None = None

    def frame(self, board_frame: str) -> str:
        """Return the name of its frame, given the parameter of that name."""
        name = _NAMELESS if self.board is None else self.board.name
        if self.prefix == _ALONE:
            return board_frame or name
        return f'{board_frame}/{name}' if board_frame else name


# The marker whose corners come on the topic ``corners``: no file knows of it.
MARKER = Target()


class Targets:
    """
    The boards of a file in its order, or one without a name where there is no file.

    Raises
    ------
    ConfigError
        The file is wrong, or one of several boards has a name that no topic can have.

    """

    def __init__(self, board_file: str) -> None:
        self.boards: Mapping[str, Board] = load_boards(board_file) if board_file else {}
        if len(self.boards) > 1:
            self._in_order = [
                Target(f'{_ALONE}/{_topic(board_file, name)}', board)
                for name, board in self.boards.items()
            ]
        else:
            self._in_order = [Target(_ALONE, board) for board in self.boards.values()] or [MARKER]

    def remark_on_tf(self, options: PoseNodeOptions) -> Rejected | None:
        """Say whether /tf would be no tree with these options."""
        if not (options.publish_tf and options.invert_tf) or len(self._in_order) < 2:
            return None
        return Rejected(
            'tf_parents',
            f'invert_tf gives the frame of the camera {len(self._in_order)} parents on /tf, one '
            'for each board of board_file, but a frame has one: set it to false, or name a file '
            'of one board',
        )

    @property
    def prefixes(self) -> set[str]:
        """Of the topics of all targets, MARKER included."""
        return {MARKER.prefix, *(target.prefix for target in self._in_order)}

    def at(self, index: int | None) -> Target | Rejected:
        """Return the board with a number: its place in the file; one that is alone needs none."""
        if index is None:
            return self._in_order[0] if len(self._in_order) == 1 else _which_one(self.boards)
        if 0 <= index < len(self._in_order):
            return self._in_order[index]
        return Rejected(
            'unknown_board',
            f'a board with number {index}: expected 0 to {len(self._in_order) - 1}, the places of '
            'the boards in board_file, which has to be the one that the detector has',
        )


def _which_one(boards: Mapping[str, Board]) -> Rejected:
    numbered = ', '.join(f'{index} for {name}' for index, name in enumerate(boards))
    return Rejected(
        'unknown_board',
        f'correspondences: which of the {len(boards)} boards of board_file it is, a cloud says by '
        f'its integer field board: {numbered}',
    )


def _topic(board_file: str, name: str) -> str:
    if re.fullmatch(r'[A-Za-z]\w*', name, re.ASCII) is None:
        raise ConfigError(
            f'{board_file}: boards.{name}: expected a letter, and then letters, digits and _, for '
            'the name of one of several boards: it is part of the names of topics'
        )
    return name
