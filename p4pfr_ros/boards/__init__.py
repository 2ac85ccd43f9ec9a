# SPDX-License-Identifier: Apache-2.0
"""
The geometry of the boards that can be looked for: numbers only, no OpenCV.

The frame of every board has its origin at the centre of the printed pattern, x to the right, y up
and z out of the board towards the viewer; metres. So a board seen head-on, upright, has the
rotation ``camera_from_board`` diag(1, -1, -1).

Every board has

- ``points`` (N, 2) m: the points that can be detected; a point's id is its index here,
- ``sheet_size_m``: width and height of the printed pattern with its white margin,
- ``black_squares`` (N, 4) m: left, bottom, right, top of those that belong to no marker,
- ``marker_ids`` and ``marker_corners`` (N, 4, 2) m, clockwise from the top left as printed,
- ``name``: its name, and that of its frame.
"""

from __future__ import annotations

from p4pfr_ros.boards.chess import Charuco, Chessboard
from p4pfr_ros.boards.markers import Marker, MarkerGrid

__all__ = ['Board', 'Charuco', 'Chessboard', 'Marker', 'MarkerGrid']

Board = Chessboard | Charuco | Marker | MarkerGrid
