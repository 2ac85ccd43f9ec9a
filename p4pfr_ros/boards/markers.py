# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""
Boards made of markers only: a single marker, a grid, Kalibr's grid, and a bundle.

This module stands alone: it has all boards whose points are marker corners.
"""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass
import math

import numpy as np
from p4pfr_ros.boards.parts import (
    check_counts,
    check_id,
    check_lengths,
    check_markers,
    check_name,
    check_numbers,
    computed_once,
    grid_points,
    marker_corners_at,
)
from p4pfr_ros.core.geometry import Array, Ints, Mask, Pose

# White margin around the pattern, in sides of the largest marker. The detector needs at least one
# cell; the smallest dictionaries have six cells per side.
_MARGIN_IN_SIDES = 0.25
# Markers closer than this, in sides, have no white between them.
_TOUCHING_IN_SIDES = 1e-6
# No OpenCV dictionary has more markers.
_MAX_MARKERS = 2500


class _CornerPoints:
    """Shared part of boards whose points are the corners of their markers."""

    __slots__ = ()

    @property
    def marker_corners(self) -> Array:
        """Corners of each marker, (M, 4, 2) metres, clockwise from its own top left."""
        raise NotImplementedError

    @property
    def points(self) -> Array:
        """Corners of all markers, (4 M, 2) metres: point 4 n + i is corner i of marker n."""
        return self.marker_corners.reshape(-1, 2)

    @property
    def turns(self) -> tuple[Pose, ...]:
        """None: the markers look different after every turn."""
        return ()

    @property
    def black_squares(self) -> Array:
        """No squares outside markers: (0, 4)."""
        return np.empty((0, 4))


@dataclass(frozen=True, slots=True, kw_only=True)
class Marker(_CornerPoints):
    """
    One ArUco or AprilTag marker; its points are the corners, clockwise from the top left.

    Parameters
    ----------
    id
        Number of the marker in its dictionary.
    size_m
        Side of the marker: outer edge of its black border, metres.
    dictionary
        Name of the OpenCV dictionary, such as 'DICT_APRILTAG_36h11'.
    border_bits
        Width of the black border, in cells.
    inverted
        Whether black and white are exchanged; 'any' accepts both.
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
    border_bits: int = 1
    inverted: bool | str = False
    name: str = 'board'

    def __post_init__(self) -> None:
        check_id(self, 'id')
        check_lengths(self, 'size_m')
        check_markers(self)
        check_name(self)

    @property
    def sheet_size_m(self) -> tuple[float, float]:
        """Width and height of the pattern with its white margin."""
        side = (1.0 + 2.0 * _MARGIN_IN_SIDES) * self.size_m
        return side, side

    @property
    def marker_ids(self) -> tuple[int, ...]:
        """The id of the marker."""
        return (self.id,)

    @property
    @computed_once
    def marker_corners(self) -> Array:
        """The marker's corners, (1, 4, 2) metres, clockwise from the top left."""
        return marker_corners_at(np.zeros((1, 2)), self.size_m)


@dataclass(frozen=True, slots=True, kw_only=True)
class MarkerGrid(_CornerPoints):
    """
    Markers in rows and columns, with ids that count up row by row from the top left.

    Parameters
    ----------
    columns, rows
        Number of markers; at least two markers in total.
    marker_m, separation_m
        Side of a marker (outer edge of its black border) and gap between two, metres.
    dictionary
        Name of the OpenCV dictionary, such as 'DICT_6X6_250'.
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
    marker_m: float
    separation_m: float
    dictionary: str
    first_id: int = 0
    border_bits: int = 1
    inverted: bool | str = False
    name: str = 'board'

    def __post_init__(self) -> None:
        check_counts(self, at_least=1)
        if self.columns * self.rows < 2:
            raise ValueError('columns: expected at least two markers in total, got 1')
        check_lengths(self, 'marker_m', 'separation_m')
        check_id(self, 'first_id')
        check_markers(self)
        check_name(self)

    @property
    def sheet_size_m(self) -> tuple[float, float]:
        """Width and height of the pattern with its white margin."""
        step = self.marker_m + self.separation_m
        margin = 2.0 * _MARGIN_IN_SIDES * self.marker_m - self.separation_m
        return self.columns * step + margin, self.rows * step + margin

    @property
    def marker_ids(self) -> tuple[int, ...]:
        """The ids of the markers, row by row from the top left."""
        return tuple(range(self.first_id, self.first_id + self.rows * self.columns))

    @property
    @computed_once
    def marker_corners(self) -> Array:
        """The corners of each marker, (M, 4, 2) metres, clockwise from the top left."""
        centres = grid_points(self.columns, self.rows, self.marker_m + self.separation_m)
        return marker_corners_at(centres, self.marker_m)


@dataclass(frozen=True, slots=True, kw_only=True)
class AprilGrid(_CornerPoints):
    """
    The grid of AprilTags that Kalibr prints: ids count up row by row from the *bottom* left.

    Black squares as wide as the gap touch the corners of the tags. Kalibr's origin is the lower
    left corner of the first tag; the origin here is the middle of the grid, as of every board.

    Parameters
    ----------
    columns, rows
        Number of tags; at least two in total.
    tag_m
        Side of a tag (outer edge of its black border), metres.
    spacing
        Gap between two tags, in sides of a tag, up to 1.
    dictionary
        Name of the OpenCV dictionary.
    first_id
        Id of the tag at the bottom left.
    border_bits
        Width of the tags' black border, in cells. Kalibr prints 2, other generators 1.
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
    tag_m: float
    spacing: float
    dictionary: str = 'DICT_APRILTAG_36h11'
    first_id: int = 0
    border_bits: int = 2
    inverted: bool | str = False
    name: str = 'board'

    def __post_init__(self) -> None:
        check_counts(self, at_least=1)
        if self.columns * self.rows < 2:
            raise ValueError('columns: expected at least two tags in total, got 1')
        check_lengths(self, 'tag_m')
        check_numbers(self, 'spacing')
        if not 0.0 < self.spacing <= 1.0:
            raise ValueError(
                f'spacing: expected a number above 0, up to 1 (of the tag), got {self.spacing!r}'
            )
        check_id(self, 'first_id')
        check_markers(self)
        check_name(self)

    @property
    def sheet_size_m(self) -> tuple[float, float]:
        """Width and height of the pattern with its white margin."""
        margin = (self.spacing + 2.0 * _MARGIN_IN_SIDES) * self.tag_m
        return self.columns * self._step_m + margin, self.rows * self._step_m + margin

    @property
    def black_squares(self) -> Array:
        """The squares at the corners of the tags, (N, 4): left, bottom, right, top in metres."""
        centres = grid_points(self.columns + 1, self.rows + 1, self._step_m)
        half_m = 0.5 * self.spacing * self.tag_m
        return np.concatenate([centres - half_m, centres + half_m], axis=1)

    @property
    def marker_ids(self) -> tuple[int, ...]:
        """The ids of the tags, row by row from the bottom left."""
        return tuple(range(self.first_id, self.first_id + self.rows * self.columns))

    @property
    @computed_once
    def marker_corners(self) -> Array:
        """The corners of each tag, (M, 4, 2) metres, clockwise from the top left."""
        from_the_top = grid_points(self.columns, self.rows, self._step_m)
        centres = from_the_top.reshape(self.rows, self.columns, 2)[::-1].reshape(-1, 2)
        return marker_corners_at(centres, self.tag_m)

    @property
    def _step_m(self) -> float:
        return (1.0 + self.spacing) * self.tag_m


@dataclass(frozen=True, slots=True, kw_only=True)
class PlacedMarker:
    """
    A marker with its position in a bundle.

    Parameters
    ----------
    id
        Number of the marker in the bundle's dictionary.
    x_m, y_m
        Centre of the marker in the bundle's frame, metres.
    size_m
        Side of the marker: outer edge of its black border, metres.
    angle_deg
        Rotation of the marker in the plane, degrees, counter-clockwise as the viewer sees it;
        0 is upright.

    Raises
    ------
    ValueError
        ``KEY: expected ..., got ...``.

    """

    id: int
    x_m: float
    y_m: float
    size_m: float
    angle_deg: float = 0.0

    def __post_init__(self) -> None:
        check_id(self, 'id')
        check_numbers(self, 'x_m', 'y_m', 'angle_deg')
        check_lengths(self, 'size_m')


@dataclass(frozen=True, slots=True, kw_only=True)
class Bundle(_CornerPoints):
    """
    Markers at arbitrary positions on one plane, each with its own size and rotation.

    The marker positions define the frame: x right, y up, origin at their (0, 0).

    Parameters
    ----------
    markers
        The markers; at least one, each id once, no two touching.
    dictionary
        Name of the OpenCV dictionary, such as 'DICT_APRILTAG_36h11'.
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

    markers: tuple[PlacedMarker, ...]
    dictionary: str
    border_bits: int = 1
    inverted: bool | str = False
    name: str = 'board'

    def __post_init__(self) -> None:
        if not 1 <= len(self.markers) <= _MAX_MARKERS:
            raise ValueError(f'markers: expected 1 to {_MAX_MARKERS}, got {len(self.markers)}')
        id_, times = Counter(self.marker_ids).most_common(1)[0]
        if times > 1:
            raise ValueError(f'markers: expected each id once, got {id_} {times} times')
        overlap = _first_overlap(self.marker_corners)
        if overlap is not None:
            first, second = (self.marker_ids[n] for n in overlap)
            raise ValueError(
                f'markers: expected white between any two, got {first} and {second}, which touch '
                'or overlap'
            )
        check_markers(self)
        check_name(self)

    @property
    def sheet_size_m(self) -> tuple[float, float]:
        """Width and height of a sheet that holds all markers, centred on the frame's origin."""
        margin = _MARGIN_IN_SIDES * max(marker.size_m for marker in self.markers)
        x, y = (np.abs(self.points).max(axis=0) + margin).tolist()
        return 2.0 * x, 2.0 * y

    @property
    def marker_ids(self) -> tuple[int, ...]:
        """The ids of the markers, in the given order."""
        return tuple(marker.id for marker in self.markers)

    @property
    def marker_corners(self) -> Array:
        """The corners of each marker, (M, 4, 2) metres, clockwise from its own top left."""
        centres = np.array([(marker.x_m, marker.y_m) for marker in self.markers])
        sides = [marker.size_m for marker in self.markers]
        angles = [math.radians(marker.angle_deg) for marker in self.markers]
        return marker_corners_at(centres, sides, angles)


def _first_overlap(squares: Array) -> tuple[int, int] | None:
    """Return the indices of the first two squares (N, 4, 2) that touch or overlap, or None."""
    first, second = _close_pairs(squares)
    # Separating axis theorem: two convex shapes are disjoint if and only if a line parallel to a
    # side of one of them separates them.
    disjoint = _has_separating_side(squares[first], squares[second])
    disjoint |= _has_separating_side(squares[second], squares[first])
    overlapping = np.flatnonzero(~disjoint)
    if not overlapping.size:
        return None
    return int(first[overlapping[0]]), int(second[overlapping[0]])


def _close_pairs(squares: Array) -> tuple[Ints, Ints]:
    """Return the index pairs of squares whose circumcircles intersect."""
    centres = squares.mean(axis=1)
    radii = np.linalg.norm(squares[:, 0] - centres, axis=1)
    first, second = np.triu_indices(len(squares), k=1)
    distance = np.linalg.norm(centres[first] - centres[second], axis=1)
    close = distance <= 1.001 * (radii[first] + radii[second])
    return first[close], second[close]


def _has_separating_side(squares: Array, others: Array) -> Mask:
    """Return, for each pair, whether the line through a side of the square separates the two."""
    centres = squares.mean(axis=1, keepdims=True)
    # In units of half a side, the square extends from -1 to 1 along both of its axes.
    axes = 0.5 * (np.roll(squares, -1, axis=1)[:, :2] - squares[:, :2])
    half2 = np.sum(axes**2, axis=2)[:, None]
    extent = np.einsum('nci,nai->nca', others - centres, axes) / half2
    limit = 1.0 + 2.0 * _TOUCHING_IN_SIDES
    separated = (extent.min(axis=1) > limit) | (extent.max(axis=1) < -limit)
    any_side: Mask = separated.any(axis=1)
    return any_side
