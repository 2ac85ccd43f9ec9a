# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""A board of markers that lie anywhere on one plane, each with a size and a turn of its own."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass
import math

import numpy as np
from p4pfr_ros.boards.parts import (
    check_dictionary,
    check_id,
    check_lengths,
    check_name,
    check_numbers,
    marker_corners_at,
)
from p4pfr_ros.core.geometry import Array, Ints, Mask

# White paper around the outermost corner: at least one cell of the largest marker.
_MARGIN_IN_MARKERS = 0.25
# Markers that are nearer than this part of a side have no white between them.
_TOUCHING_IN_SIDES = 1e-6
# No dictionary has more.
_MOST_MARKERS = 2500


@dataclass(frozen=True, slots=True, kw_only=True)
class PlacedMarker:
    """
    A marker at its place on the plane of a bundle.

    Parameters
    ----------
    id
        Number of the marker in the bundle's dictionary.
    x_m, y_m
        Its centre in the bundle's frame, metres.
    size_m
        Side of the marker: outer edge of its black border, metres.
    angle_deg
        How far it is turned, counter-clockwise as the viewer sees it, degrees. 0: upright.

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
class Bundle:
    """
    Markers anywhere on one plane.

    The frame is the one that the markers' places are given in: x to the right, y up, its origin
    wherever they have it. Its points are the markers' corners in the order of the markers, each
    clockwise from the marker's own top left: point 4 n + i is corner i of marker n.

    Parameters
    ----------
    markers
        The markers with their places; at least one, no id twice, none touches another.
    dictionary
        OpenCV's name of the markers' dictionary, such as 'DICT_APRILTAG_36h11'.
    name
        Name of the board and of its frame.

    Raises
    ------
    ValueError
        ``KEY: expected ..., got ...``.

    """

    markers: tuple[PlacedMarker, ...]
    dictionary: str
    name: str = 'board'

    def __post_init__(self) -> None:
        if not 1 <= len(self.markers) <= _MOST_MARKERS:
            raise ValueError(f'markers: expected 1 to {_MOST_MARKERS}, got {len(self.markers)}')
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
        check_dictionary(self)
        check_name(self)

    @property
    def points(self) -> Array:
        """The corners of all markers, (4 N, 2) metres."""
        return self.marker_corners.reshape(-1, 2)

    @property
    def sheet_size_m(self) -> tuple[float, float]:
        """Width and height of a sheet that holds all markers, its middle the frame's origin."""
        margin = _MARGIN_IN_MARKERS * max(marker.size_m for marker in self.markers)
        x, y = (np.abs(self.points).max(axis=0) + margin).tolist()
        return 2.0 * x, 2.0 * y

    @property
    def black_squares(self) -> Array:
        """No squares beside the markers: (0, 4)."""
        return np.empty((0, 4))

    @property
    def marker_ids(self) -> tuple[int, ...]:
        """The ids of the markers, in their order."""
        return tuple(marker.id for marker in self.markers)

    @property
    def marker_corners(self) -> Array:
        """The corners of each marker, (N, 4, 2) metres, clockwise from its own top left."""
        centres = np.array([(marker.x_m, marker.y_m) for marker in self.markers])
        sides = [marker.size_m for marker in self.markers]
        turns = [math.radians(marker.angle_deg) for marker in self.markers]
        return marker_corners_at(centres, sides, turns)


def _first_overlap(squares: Array) -> tuple[int, int] | None:
    """Return the first two of the squares (N, 4, 2) that touch or overlap, if there are any."""
    first, second = _near_pairs(squares)
    # Convex shapes are apart when a line parallel to some side of one of them lies between.
    apart = _lies_beyond(squares[first], squares[second])
    apart |= _lies_beyond(squares[second], squares[first])
    together = np.flatnonzero(~apart)
    return (int(first[together[0]]), int(second[together[0]])) if together.size else None


def _near_pairs(squares: Array) -> tuple[Ints, Ints]:
    """Return the pairs of squares whose circumcircles meet."""
    centres = squares.mean(axis=1)
    radii = np.linalg.norm(squares[:, 0] - centres, axis=1)
    first, second = np.triu_indices(len(squares), k=1)
    distance = np.linalg.norm(centres[first] - centres[second], axis=1)
    near = distance <= 1.001 * (radii[first] + radii[second])
    return first[near], second[near]


def _lies_beyond(squares: Array, others: Array) -> Mask:
    """Say of each pair whether the other lies beyond the line through a side of the square."""
    centres = squares.mean(axis=1, keepdims=True)
    # In a frame with half the side as its unit, the square reaches from -1 to 1 along both axes.
    axes = 0.5 * (np.roll(squares, -1, axis=1)[:, :2] - squares[:, :2])
    half2 = np.sum(axes**2, axis=2)[:, None]
    reach = np.einsum('nci,nai->nca', others - centres, axes) / half2
    limit = 1.0 + 2.0 * _TOUCHING_IN_SIDES
    beyond = (reach.min(axis=1) > limit) | (reach.max(axis=1) < -limit)
    any_side: Mask = beyond.any(axis=1)
    return any_side
