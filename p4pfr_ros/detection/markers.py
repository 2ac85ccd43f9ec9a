# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""
Detection of boards made of markers: single markers, grids and bundles.

This module stands alone, as each finder of a family of boards does.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from p4pfr_ros.boards import MarkerBoard
from p4pfr_ros.core.geometry import Array, Ints
from p4pfr_ros.detection.aruco import detect_markers, marker_cells
from p4pfr_ros.detection.marker_edges import FOUND, refine_markers


def find_markers(grey: NDArray[np.uint8], board: MarkerBoard) -> tuple[Ints, Array, list[int]]:
    """
    Find a board's markers in an image (h, w).

    Markers that are not on the board are ignored. If an id is detected more than once, it is
    ambiguous which marker belongs to the board, so all markers with that id are left out.

    Returns
    -------
    Ids (N,) (indices in the board's points), corners (N, 2) px, and the duplicate marker ids.

    """
    corners, marker_ids = detect_markers(grey, board.dictionary)
    # Pairs of equal ids, in the board's order: index on the board, index among the detections.
    on_board, detected = np.nonzero(np.array(board.marker_ids)[:, None] == marker_ids)
    distinct_ids, counts = np.unique(marker_ids, return_counts=True)
    is_unique = np.isin(marker_ids[detected], distinct_ids[counts == 1])
    cells = np.array([marker_cells(board.dictionary, i) for i in marker_ids[detected[is_unique]]])
    refined, status = refine_markers(grey, corners[detected[is_unique]], cells)
    is_found = status == FOUND
    ids = 4 * on_board[is_unique][is_found][:, None] + np.arange(4)
    duplicates = np.unique(marker_ids[detected[~is_unique]]).tolist()
    return ids.ravel(), refined[is_found].reshape(-1, 2), duplicates
