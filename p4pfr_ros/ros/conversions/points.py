# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""Corners of one marker (PolygonStamped) to correspondences."""

from __future__ import annotations

from dataclasses import dataclass

from geometry_msgs.msg import PolygonStamped
import numpy as np
from p4pfr_ros.boards.conventions import CORNER_ORDERS
from p4pfr_ros.core.geometry import Array, Ints

from ..runtime.rejections import Rejected

# Pixels or metres: further out than any picture or board reaches, and near enough for squares and
# cubes of it.
_FARTHEST = 1e7

# More than any board has: so many points take tenths of a second, and the calibration keeps 40
# views of them.
_MOST_POINTS = 10_000


@dataclass(frozen=True, slots=True, eq=False)
class Correspondences:
    """
    Points of a board and where a picture shows them; at least four, all finite.

    Parameters
    ----------
    image_points : (N, 2) array
        Pixels of the picture as it was sent; pixel centres are integers.
    board_points : (N, 2) array
        Metres, in the board's frame: x right, y up.
    ids : (N,) array of int
        Which point of the board each is.
    board
        Which board it is: its place among those of the board file; None: nobody has said.

    """

    image_points: Array
    board_points: Array
    ids: Ints
    board: int | None = None


def correspondences_from_polygon(
    msg: PolygonStamped, size_m: float, corner_order: str, pixel_center_px: float = 0.0
) -> Correspondences | Rejected:
    """
    Take the four corners of a marker of a size (outer edge of its black border).

    ``corner_order`` is one of ``CORNER_ORDERS``, and ``pixel_center_px`` what the middle of the
    first pixel is called there; neither can be seen in the message.
    """
    corners = msg.polygon.points
    if len(corners) != 4:
        return Rejected('point_count', f'corners: expected 4 points, got {len(corners)}')
    if not size_m > 0.0:
        return Rejected('marker_size', 'corners: set the parameter marker.size_m, metres')
    image_points = np.array([(corner.x, corner.y) for corner in corners]) - pixel_center_px
    board_points = size_m * np.array(CORNER_ORDERS[corner_order])
    return checked(image_points, board_points, np.arange(4), 'corners')


def checked(
    image_points: Array,
    board_points: Array,
    ids: Ints,
    topic: str,
    board: int | None = None,
) -> Correspondences | Rejected:
    """Hold what ``Correspondences`` promises, or say what is wrong."""
    if len(image_points) < 4:
        return Rejected(
            'point_count', f'{topic}: expected at least 4 points, got {len(image_points)}'
        )
    if len(image_points) > _MOST_POINTS:
        return Rejected(
            'point_count',
            f'{topic}: expected at most {_MOST_POINTS} points, got {len(image_points)}',
        )
    wrong = wrong_coordinates(image_points, topic) or wrong_coordinates(board_points, topic)
    return wrong or Correspondences(image_points, board_points, ids, board)


def wrong_coordinates(points: Array, topic: str) -> Rejected | None:
    """Say why (N, 2) pixels or metres cannot be any picture's or board's, if they cannot."""
    if not np.isfinite(points).all():
        return Rejected('not_finite', f'{topic}: a coordinate is not finite')
    if np.abs(points).max() > _FARTHEST:
        return Rejected('out_of_range', f'{topic}: a coordinate is beyond 1e7 (px, m)')
    return None
