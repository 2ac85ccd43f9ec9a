# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""
Boards with black squares: the chessboard and the ChArUco board.

This module stands alone: it has all boards whose points are corners between squares.
"""

from __future__ import annotations

from dataclasses import dataclass

from p4pfr_ros.boards.parts import (
    check_counts,
    check_id,
    check_lengths,
    check_markers,
    check_name,
    checkerboard_squares,
    computed_once,
    grid_points,
    marker_corners_at,
    WithoutMarkers,
)
from p4pfr_ros.boards.symmetry import turn_about_z
from p4pfr_ros.core.geometry import Array, Pose

# White margin around the pattern. OpenCV detects a chessboard more reliably with a margin; with
# half a square, a 9x6 board of 25 mm still fits on A4.
_MARGIN_IN_SQUARES = 0.5


@dataclass(frozen=True, slots=True, kw_only=True)
class Chessboard(WithoutMarkers):
    """
    A chessboard; its points are the inner corners, row by row from the top left.

    The square at the top left is black. One of ``columns`` and ``rows`` should be even and the
    other odd: the board then looks different upside down (in 9x6, the left column of squares has
    black ends, the right column white ends), and its frame is unique in every image. Otherwise
    it looks the same after half a turn, with columns = rows, both even, also after a quarter turn
    (see ``turns``), and detection chooses the frame whose y axis points up most.

    Parameters
    ----------
    columns, rows
        Number of inner corners, as OpenCV counts; each at least 3.
    square_m
        Side of a square, metres.
    name
        Name of the board and of its frame.

    Raises
    ------
    ValueError
        ``KEY: expected ..., got ...``.

    """

    columns: int
    rows: int
    square_m: float
    name: str = 'board'

    def __post_init__(self) -> None:
        # Fewer are no lattice that one could tell from clutter.
        check_counts(self, at_least=3)
        check_lengths(self, 'square_m')
        check_name(self)

    @property
    @computed_once
    def points(self) -> Array:
        """The inner corners, (rows * columns, 2) metres."""
        return grid_points(self.columns, self.rows, self.square_m)

    @property
    def sheet_size_m(self) -> tuple[float, float]:
        """Width and height of the pattern with its white margin."""
        squares = 1.0 + 2.0 * _MARGIN_IN_SQUARES
        return (self.columns + squares) * self.square_m, (self.rows + squares) * self.square_m

    @property
    def black_squares(self) -> Array:
        """The black squares, (N, 4): left, bottom, right, top in metres."""
        return checkerboard_squares(
            self.columns + 1, self.rows + 1, self.square_m, with_first=True
        )

    @property
    def turns(self) -> tuple[Pose, ...]:
        """The turns after which the board looks the same."""
        # A turn maps the corner squares onto each other, and they must have the same colour. Half
        # a turn: the squares (i, j) and (columns - i, rows - j). A quarter turn, with columns =
        # rows: (i, j) and (j, columns - i).
        if (self.columns + self.rows) % 2 == 1:
            return ()
        quarter = self.columns == self.rows and self.columns % 2 == 0
        return tuple(turn_about_z(angle) for angle in ((90, 180, 270) if quarter else (180,)))


@dataclass(frozen=True, slots=True, kw_only=True)
class Charuco:
    """
    A chessboard with a marker in each white square (ids count up row by row from the first).

    Its points are the inner corners, row by row from the top left. The markers identify each
    corner, so a part of the board is enough.

    Parameters
    ----------
    columns, rows
        Number of squares, as OpenCV counts for this kind of board; each at least 3, because
        collinear corners do not determine a pose.
    square_m, marker_m
        Sides of a square and of a marker (outer edge of its black border), metres.
    dictionary
        Name of the OpenCV dictionary, such as 'DICT_4X4_50'.
    legacy_pattern
        Pattern printed by OpenCV before 4.6: with an even number of rows, the square at the top
        left is white. (With an odd number of rows both patterns are the same.)
    first_id
        Id of the marker at the top left.
    border_bits
        Width of the markers' black border, in cells.
    inverted
        Whether black and white are exchanged; 'any' accepts both.
    name
        Name of the board and of its frame.

    Raises
    ------
    ValueError
        ``KEY: expected ..., got ...``.

    """

    columns: int
    rows: int
    square_m: float
    marker_m: float
    dictionary: str
    legacy_pattern: bool = False
    first_id: int = 0
    border_bits: int = 1
    inverted: bool | str = False
    name: str = 'board'

    def __post_init__(self) -> None:
        check_counts(self, at_least=3)
        check_lengths(self, 'square_m', 'marker_m')
        if not self.marker_m < self.square_m:
            raise ValueError(
                f'marker_m: expected less than square_m = {self.square_m:g}, got {self.marker_m:g}'
            )
        if not isinstance(self.legacy_pattern, bool):
            raise ValueError(
                f'legacy_pattern: expected true or false, got {self.legacy_pattern!r}'
            )
        check_id(self, 'first_id')
        check_markers(self)
        check_name(self)

    @property
    @computed_once
    def points(self) -> Array:
        """The inner corners, ((rows - 1) * (columns - 1), 2) metres."""
        return grid_points(self.columns - 1, self.rows - 1, self.square_m)

    @property
    def sheet_size_m(self) -> tuple[float, float]:
        """Width and height of the pattern with its white margin."""
        margin = 2.0 * _MARGIN_IN_SQUARES
        return (self.columns + margin) * self.square_m, (self.rows + margin) * self.square_m

    @property
    def black_squares(self) -> Array:
        """The black squares, (N, 4): left, bottom, right, top in metres."""
        return checkerboard_squares(
            self.columns, self.rows, self.square_m, with_first=self._black_first
        )

    @property
    def turns(self) -> tuple[Pose, ...]:
        """None: the markers look different after every turn."""
        return ()

    @property
    def marker_ids(self) -> tuple[int, ...]:
        """The ids of the markers, row by row from the top left."""
        squares = self.columns * self.rows
        markers = squares // 2 if self._black_first else (squares + 1) // 2
        return tuple(range(self.first_id, self.first_id + markers))

    @property
    @computed_once
    def marker_corners(self) -> Array:
        """The corners of each marker, (M, 4, 2) metres, clockwise from the top left."""
        white = checkerboard_squares(
            self.columns, self.rows, self.square_m, with_first=not self._black_first
        )
        centres = 0.5 * (white[:, :2] + white[:, 2:])
        return marker_corners_at(centres, self.marker_m)

    @property
    def _black_first(self) -> bool:
        return not (self.legacy_pattern and self.rows % 2 == 0)
