# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""
The geometry of the boards that can be looked for: numbers only, no OpenCV.

The frame of every board has its origin at the centre of the printed pattern (a bundle's: where its
markers' places are counted from), x to the right, y up and z out of the board towards the viewer;
metres. So a board seen head-on, upright, has the rotation ``camera_from_board`` diag(1, -1, -1).

Every board has

- ``points`` (N, 2) m: the points that can be detected; a point's id is its index here,
- ``sheet_size_m``: width and height of the printed sheet around the origin, with a white margin,
- ``black_squares`` (N, 4) m: left, bottom, right, top of those that belong to no marker,
- ``marker_ids`` and ``marker_corners`` (N, 4, 2) m, clockwise from the marker's top left,
- ``name``: its name, and that of its frame.
"""

from __future__ import annotations

from p4pfr_ros.boards.bundle import Bundle, PlacedMarker
from p4pfr_ros.boards.chess import Charuco, Chessboard
from p4pfr_ros.boards.markers import Marker, MarkerGrid

__all__ = [
    'Board',
    'Bundle',
    'Charuco',
    'Chessboard',
    'Marker',
    'MarkerBoard',
    'MarkerGrid',
    'PlacedMarker',
]

# Point 4 n + i of these is corner i of marker n.
MarkerBoard = Marker | MarkerGrid | Bundle
Board = Chessboard | Charuco | MarkerBoard
