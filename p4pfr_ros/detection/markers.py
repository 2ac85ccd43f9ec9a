# SPDX-License-Identifier: Apache-2.0
"""Single markers and grids of them in pictures."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from p4pfr_ros.boards import Marker, MarkerGrid
from p4pfr_ros.core.geometry import Array, Ints
from p4pfr_ros.detection.aruco import detect_markers, marker_cells
from p4pfr_ros.detection.marker_edges import refine_markers


def find_markers(
    grey: NDArray[np.uint8], board: Marker | MarkerGrid
) -> tuple[Ints, Array, list[int]]:
    """
    Find a board's markers in a picture (h, w).

    Markers that are not on the board are ignored. Of an id that is seen twice nobody knows which
    one is the board's, so both are left out.

    Returns
    -------
    Ids (N,), indices in the board's points, corners (N, 2) px, and what ids were seen twice.

    """
    corners, marker_ids = detect_markers(grey, board.dictionary)
    known, counts = np.unique(marker_ids, return_counts=True)
    places = marker_ids - board.marker_ids[0]
    kept = np.isin(marker_ids, known[counts == 1]) & np.isin(marker_ids, board.marker_ids)
    order = np.flatnonzero(kept)[np.argsort(places[kept])]
    cells = len(marker_cells(board.dictionary, board.marker_ids[0]))
    refined = refine_markers(grey, corners[order], cells)
    ids = 4 * places[order][:, None] + np.arange(4)
    doubled = known[(counts > 1) & np.isin(known, board.marker_ids)].tolist()
    return ids.ravel(), refined.reshape(-1, 2), doubled
