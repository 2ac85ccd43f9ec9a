# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""
Grids of circles, symmetric and asymmetric.

This module stands alone: it has all boards whose points are centres of circles.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from p4pfr_ros.boards.parts import (
    check_counts,
    check_lengths,
    check_name,
    computed_once,
    grid_points,
    WithoutMarkers,
)
from p4pfr_ros.boards.symmetry import turn_about_z
from p4pfr_ros.core.geometry import Array, Pose

# White margin between the outermost circles and the edge of the sheet, in spacings.
_MARGIN_IN_SPACINGS = 0.5


@dataclass(frozen=True, slots=True, kw_only=True)
class CircleGrid(WithoutMarkers):
    """
    Black circles on white; the points are their centres, row by row from the top left.

    In a symmetric grid the circles are ``spacing_m`` apart. In an asymmetric one the rows are
    ``spacing_m`` apart and the circles of a row twice as far; every second row, beginning with
    the second, is shifted to the right by ``spacing_m``. This is the size that OpenCV and
    camera_calibration (``--pattern acircles --square``) ask for.

    An asymmetric grid with an odd number of rows looks different after every turn. All others
    look the same after half a turn, symmetric ones with columns = rows also after a quarter turn
    (see ``turns``), and detection chooses the frame whose y axis points up most.

    Parameters
    ----------
    columns, rows
        Number of circles in a row, and of rows, as OpenCV counts; each at least 3, asymmetric
        grids at least 2 columns.
    spacing_m, diameter_m
        Spacing as above, and diameter of a circle, metres. The diameter corrects the centres for
        perspective; it must leave white between neighbours.
    asymmetric
        Whether every second row is shifted.
    name
        Name of the board and of its frame.

    Raises
    ------
    ValueError
        ``KEY: expected ..., got ...``.

    """

    columns: int
    rows: int
    spacing_m: float
    diameter_m: float
    asymmetric: bool = False
    name: str = 'board'

    def __post_init__(self) -> None:
        if not isinstance(self.asymmetric, bool):
            raise ValueError(f'asymmetric: expected true or false, got {self.asymmetric!r}')
        check_counts(self, at_least=2 if self.asymmetric else 3)
        if self.rows < 3:
            raise ValueError(f'rows: expected at least 3, got {self.rows}')
        check_lengths(self, 'spacing_m', 'diameter_m')
        if not self.diameter_m < self.nearest_m:
            raise ValueError(
                f'diameter_m: expected less than the distance of two circles, '
                f'{self.nearest_m:g} m, got {self.diameter_m:g}'
            )
        check_name(self)

    @property
    def nearest_m(self) -> float:
        """Distance of the nearest two centres: in an asymmetric grid they are in two rows."""
        return self.spacing_m * (np.sqrt(2.0) if self.asymmetric else 1.0)

    @property
    @computed_once
    def points(self) -> Array:
        """The centres, (rows * columns, 2) metres."""
        if not self.asymmetric:
            return grid_points(self.columns, self.rows, self.spacing_m)
        grid = grid_points(2 * self.columns, self.rows, self.spacing_m)
        by_row = grid.reshape(self.rows, self.columns, 2, 2)
        shifted = np.arange(self.rows) % 2
        centres: Array = by_row[np.arange(self.rows), :, shifted].reshape(-1, 2)
        return centres

    @property
    def sheet_size_m(self) -> tuple[float, float]:
        """Width and height of the pattern with its white margin."""
        across = 2 * self.columns if self.asymmetric else self.columns
        margin_m = self.diameter_m + 2.0 * _MARGIN_IN_SPACINGS * self.spacing_m
        return (
            (across - 1) * self.spacing_m + margin_m,
            (self.rows - 1) * self.spacing_m + margin_m,
        )

    @property
    def turns(self) -> tuple[Pose, ...]:
        """The turns after which the board looks the same."""
        # Half a turn maps row i to row rows - 1 - i and exchanges shifted and unshifted rows; an
        # odd number of rows begins and ends with an unshifted one.
        if self.asymmetric:
            return (turn_about_z(180),) if self.rows % 2 == 0 else ()
        angles = (90, 180, 270) if self.columns == self.rows else (180,)
        return tuple(turn_about_z(angle) for angle in angles)

    @property
    def black_squares(self) -> Array:
        """No squares: (0, 4)."""
        return np.empty((0, 4))
