# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""Boards of markers only: a single one, and a grid."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from p4pfr_ros.boards.parts import (
    check_counts,
    check_dictionary,
    check_id,
    check_lengths,
    check_name,
    grid_points,
    marker_corners_at,
)
from p4pfr_ros.core.geometry import Array

# White paper around the pattern: at least one of the marker's cells, of which the smallest
# dictionaries have six.
_MARGIN_IN_MARKERS = 0.25


@dataclass(frozen=True, slots=True, kw_only=True)
class Marker:
    """
    One ArUco or AprilTag marker; its points are the corners, clockwise from the top left.

    Parameters
    ----------
    id
        Number of the marker in its dictionary.
    size_m
        Side of the marker: outer edge of its black border, metres.
    dictionary
        OpenCV's name of the dictionary, such as 'DICT_APRILTAG_36h11'.
    name
        Name of the board and of its frame.

    Raises
    ------
    ValueError
        ``KEY: expected ..., got ...``.

    """

    id: int
    size_m: float
    dictionary: str
    name: str = 'board'

    def __post_init__(self) -> None:
        check_id(self, 'id')
        check_lengths(self, 'size_m')
        check_dictionary(self)
        check_name(self)

    @property
    def points(self) -> Array:
        """The marker's corners, (4, 2) metres, clockwise from the top left."""
        corners: Array = self.marker_corners[0]
        return corners

    @property
    def sheet_size_m(self) -> tuple[float, float]:
        """Width and height of the pattern with its white margin."""
        side = (1.0 + 2.0 * _MARGIN_IN_MARKERS) * self.size_m
        return side, side

    @property
    def black_squares(self) -> Array:
        """No squares beside the marker: (0, 4)."""
        return np.empty((0, 4))

    @property
    def marker_ids(self) -> tuple[int, ...]:
        """The id of the one marker."""
        return (self.id,)

    @property
    def marker_corners(self) -> Array:
        """The marker's corners, (1, 4, 2) metres, clockwise from the top left."""
        return marker_corners_at(np.zeros((1, 2)), self.size_m)


@dataclass(frozen=True, slots=True, kw_only=True)
class MarkerGrid:
    """
    Markers in rows and columns, with ids that count up row by row from the top left.

    Its points are the corners of the markers in the order of their ids, each clockwise from the
    top left: point 4 n + i is corner i of the marker with the id ``first_id`` + n.

    Parameters
    ----------
    columns, rows
        Number of markers; at least two markers in all.
    marker_m, separation_m
        Side of a marker (outer edge of its black border) and gap between two, metres.
    dictionary
        OpenCV's name of the markers' dictionary, such as 'DICT_6X6_250'.
    first_id
        Id of the marker at the top left.
    name
        Name of the board and of its frame.

    Raises
    ------
    ValueError
        ``KEY: expected ..., got ...``.

    """

    columns: int
    rows: int
    marker_m: float
    separation_m: float
    dictionary: str
    first_id: int = 0
    name: str = 'board'

    def __post_init__(self) -> None:
        check_counts(self, at_least=1)
        if self.columns * self.rows < 2:
            raise ValueError('columns: expected at least two markers in all, got 1')
        check_lengths(self, 'marker_m', 'separation_m')
        check_id(self, 'first_id')
        check_dictionary(self)
        check_name(self)

    @property
    def points(self) -> Array:
        """The corners of all markers, (4 * rows * columns, 2) metres."""
        return self.marker_corners.reshape(-1, 2)

    @property
    def sheet_size_m(self) -> tuple[float, float]:
        """Width and height of the pattern with its white margin."""
        step = self.marker_m + self.separation_m
        margin = 2.0 * _MARGIN_IN_MARKERS * self.marker_m - self.separation_m
        return self.columns * step + margin, self.rows * step + margin

    @property
    def black_squares(self) -> Array:
        """No squares beside the markers: (0, 4)."""
        return np.empty((0, 4))

    @property
    def marker_ids(self) -> tuple[int, ...]:
        """The ids of the markers, row by row from the top left."""
        return tuple(range(self.first_id, self.first_id + self.rows * self.columns))

    @property
    def marker_corners(self) -> Array:
        """The corners of each marker, (N, 4, 2) metres, clockwise from the top left."""
        centres = grid_points(self.columns, self.rows, self.marker_m + self.separation_m)
        return marker_corners_at(centres, self.marker_m)
