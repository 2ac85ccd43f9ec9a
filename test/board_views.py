# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""Boards, cameras and poses for the tests of detection and rendering."""

import numpy as np
from p4pfr_ros.boards import (
    AprilGrid,
    Bundle,
    Charuco,
    Chessboard,
    CircleGrid,
    Marker,
    MarkerGrid,
    PlacedMarker,
)
from p4pfr_ros.core.cameras.division import DivisionCamera
from p4pfr_ros.core.geometry import Pose

SIZE = (640, 480)
CENTER = (319.5, 239.5)

BOARDS = {
    'chessboard': Chessboard(columns=9, rows=6, square_m=0.025),
    'charuco': Charuco(
        columns=7, rows=5, square_m=0.035, marker_m=0.026, dictionary='DICT_4X4_50'
    ),
    'charuco_legacy': Charuco(
        columns=6,
        rows=6,
        square_m=0.03,
        marker_m=0.022,
        dictionary='DICT_5X5_100',
        legacy_pattern=True,
    ),
    'marker': Marker(id=3, size_m=0.15, dictionary='DICT_APRILTAG_36h11'),
    'marker_grid': MarkerGrid(
        columns=4, rows=3, marker_m=0.05, separation_m=0.0125, dictionary='DICT_6X6_250'
    ),
    'bundle': Bundle(
        markers=(
            PlacedMarker(id=9, x_m=0.05, y_m=0.03, size_m=0.08, angle_deg=30.0),
            PlacedMarker(id=2, x_m=-0.06, y_m=0.02, size_m=0.06),
            PlacedMarker(id=5, x_m=-0.02, y_m=-0.055, size_m=0.045, angle_deg=-100.0),
            PlacedMarker(id=586, x_m=0.06, y_m=-0.06, size_m=0.04, angle_deg=165.0),
        ),
        dictionary='DICT_APRILTAG_36h11',
    ),
    'aprilgrid': AprilGrid(columns=4, rows=3, tag_m=0.05, spacing=0.3),
    'inverted_marker': Marker(id=3, size_m=0.15, dictionary='DICT_5X5_100', inverted=True),
    'circle_grid': CircleGrid(
        columns=4, rows=9, spacing_m=0.025, diameter_m=0.016, asymmetric=True
    ),
    'symmetric_circles': CircleGrid(columns=7, rows=5, spacing_m=0.035, diameter_m=0.02),
}
CAMERAS = {
    'pinhole': DivisionCamera(500.0, CENTER),
    'strong': DivisionCamera(500.0, CENTER, -0.3),
    'wide': DivisionCamera(250.0, CENTER, -0.35),
}
HEAD_ON = Pose(np.diag([1.0, -1.0, -1.0]), np.zeros(3))


def seen_from(distance_m, tilt_rad=(0.0, 0.0), roll_rad=0.0, offset=(0.0, 0.0)):
    """Return the pose of a board: tilt about x and y, roll, offset in units of the distance."""
    rolled = Pose.from_rotation_vector((0.0, 0.0, roll_rad), np.zeros(3))
    x, y = np.multiply(offset, distance_m)
    tilted = Pose.from_rotation_vector((*tilt_rad, 0.0), (x, y, distance_m))
    return tilted @ rolled @ HEAD_ON


def distance_m(camera):
    """Return a distance at which the boards above fill about half of the image."""
    return 0.38 * camera.focal_px / 500.0


def project(camera, camera_from_board, board_points):
    """Project points (N, 2) of the board to pixels (N, 2)."""
    return camera.project(camera_from_board.transform(np.pad(board_points, ((0, 0), (0, 1)))))
