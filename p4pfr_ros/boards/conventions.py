# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""
Marker axes and corner orders of this package and of others.

docs/conventions.md shows them and cites the source of each.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from p4pfr_ros.core.geometry import Pose

Corners = tuple[tuple[float, float], ...]

# Corner positions in units of the marker's side, in our axes: x right, y up as printed.
CORNER_ORDERS: dict[str, Corners] = {
    'aruco_cw_from_top_left': ((-0.5, 0.5), (0.5, 0.5), (0.5, -0.5), (-0.5, -0.5)),
    'apriltag_ccw_from_bottom_left': ((-0.5, -0.5), (0.5, -0.5), (0.5, 0.5), (-0.5, 0.5)),
}


@dataclass(frozen=True, slots=True, eq=False)
class Convention:
    """
    The marker axes and the corner order of one package.

    It represents our pose ``camera_from_ours`` as ``camera_from_ours @ ours_from_theirs``.

    Parameters
    ----------
    corner_order
        Its corner order: a key of ``CORNER_ORDERS``.
    corners
        The corners in that order and in its axes, in units of the marker's side, as defined in
        its source code.
    ours_from_theirs
        Its axes in ours. Every package has the origin in the marker's centre.

    """

    corner_order: str
    corners: Corners
    ours_from_theirs: Pose


_IDENTITY = Pose(np.eye(3), np.zeros(3))
# x still points right; y points down and z into the marker.
_HALF_TURN_ABOUT_X = Pose(np.diag([1.0, -1.0, -1.0]), np.zeros(3))

_TOP_LEFT_Y_UP = ((-0.5, 0.5), (0.5, 0.5), (0.5, -0.5), (-0.5, -0.5))
_TOP_LEFT_Y_DOWN = ((-0.5, -0.5), (0.5, -0.5), (0.5, 0.5), (-0.5, 0.5))
_BOTTOM_LEFT_Y_UP = ((-0.5, -0.5), (0.5, -0.5), (0.5, 0.5), (-0.5, 0.5))
_BOTTOM_LEFT_Y_DOWN = ((-0.5, 0.5), (0.5, 0.5), (0.5, -0.5), (-0.5, -0.5))

CONVENTIONS: dict[str, Convention] = {
    'p4pfr_ros': Convention('aruco_cw_from_top_left', _TOP_LEFT_Y_UP, _IDENTITY),
    'OpenCV aruco': Convention('aruco_cw_from_top_left', _TOP_LEFT_Y_UP, _IDENTITY),
    'aruco_ros': Convention('aruco_cw_from_top_left', _TOP_LEFT_Y_UP, _IDENTITY),
    'ros2_aruco': Convention('aruco_cw_from_top_left', _TOP_LEFT_Y_UP, _IDENTITY),
    'apriltag_ros': Convention('apriltag_ccw_from_bottom_left', _BOTTOM_LEFT_Y_UP, _IDENTITY),
    'AprilTag 3': Convention(
        'apriltag_ccw_from_bottom_left', _BOTTOM_LEFT_Y_DOWN, _HALF_TURN_ABOUT_X
    ),
    'isaac_ros_apriltag': Convention(
        'aruco_cw_from_top_left', _TOP_LEFT_Y_DOWN, _HALF_TURN_ABOUT_X
    ),
}
