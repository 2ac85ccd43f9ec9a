# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""Single markers, grids and bundles of them in pictures."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from p4pfr_ros.boards import MarkerBoard
from p4pfr_ros.core.geometry import Array, Ints
from p4pfr_ros.detection.aruco import detect_markers, marker_cells
from p4pfr_ros.detection.marker_edges import refine_markers


def find_markers(grey: NDArray[np.uint8], board: MarkerBoard) -> tuple[Ints, Array, list[int]]:
    """
    Find a board's markers in a picture (h, w).

    Markers that are not on the board are ignored. Of an id that is seen twice nobody knows which
    one is the board's, so both are left out.

    Returns
    -------
    Ids (N,), indices in the board's points, corners (N, 2) px, and what ids were seen twice.

    """
    corners, marker_ids = detect_markers(grey, board.dictionary)
    # Pairs of a marker of the board and one in the picture, in the board's order.
    places, seen = np.nonzero(np.array(board.marker_ids)[:, None] == marker_ids)
    known, counts = np.unique(marker_ids, return_counts=True)
    once = np.isin(marker_ids[seen], known[counts == 1])
    cells = len(marker_cells(board.dictionary, board.marker_ids[0]))
    refined = refine_markers(grey, corners[seen[once]], cells)
    ids = 4 * places[once][:, None] + np.arange(4)
    doubled = np.unique(marker_ids[seen[~once]]).tolist()
    return ids.ravel(), refined.reshape(-1, 2), doubled
