# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""
Geometry of the supported calibration boards: numbers only, no OpenCV.

Board frame: x right, y up, z out of the board towards the viewer, in metres. The origin is the
centre of the printed pattern; a bundle has its origin where its marker positions put it. An
upright board seen head-on has the rotation ``camera_from_board`` = diag(1, -1, -1).

Every board has these attributes:

==================  ===============  ==============================================================
``name``            str              name of the board and of its frame
``points``          (N, 2) m         the detectable points; the index of a point is its id
``sheet_size_m``    (width, height)  printed sheet, centred on the origin, white margin included
``black_squares``   (S, 4) m         black squares outside markers: left, bottom, right, top
``inverted``        bool or 'any'    whether black and white are exchanged; 'any' accepts both
``marker_ids``      (M,) ints        ids of the markers
``marker_corners``  (M, 4, 2) m      marker corners, clockwise from each marker's own top left
``turns``           tuple of Pose    the turns after which it looks the same; see ``symmetry``
==================  ===============  ==============================================================

Boards with markers also have ``dictionary``, the name of an OpenCV marker dictionary, and
``border_bits``, the width of the markers' black border in cells. A ``CircleGrid`` has black
circles around its points.

Boards are immutable. Their constructors raise ``ValueError('KEY: expected ..., got ...')``.
"""

from __future__ import annotations

from p4pfr_ros.boards.chess import Charuco, Chessboard
from p4pfr_ros.boards.circles import CircleGrid
from p4pfr_ros.boards.markers import AprilGrid, Bundle, Marker, MarkerGrid, PlacedMarker

__all__ = [
    'AprilGrid',
    'Board',
    'Bundle',
    'Charuco',
    'Chessboard',
    'CircleGrid',
    'Marker',
    'MarkerBoard',
    'MarkerGrid',
    'PlacedMarker',
]

# Boards whose points are marker corners: point 4 n + i is corner i of marker n.
MarkerBoard = Marker | MarkerGrid | AprilGrid | Bundle
Board = Chessboard | Charuco | CircleGrid | MarkerBoard
