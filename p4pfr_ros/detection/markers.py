# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""
Detection of boards made of markers: single markers, grids and bundles.

This module stands alone, as each finder of a family of boards does.
"""

from __future__ import annotations

from dataclasses import replace

import cv2
import numpy as np
from numpy.typing import NDArray
from p4pfr_ros.boards import MarkerBoard
from p4pfr_ros.core.geometry import Array, Ints, Mask
from p4pfr_ros.detection.aruco import marker_cells
from p4pfr_ros.detection.candidates import (
    are_legible,
    BoardMarkers,
    find_board_markers,
    rechecked,
)
from p4pfr_ros.detection.explanations import explained
from p4pfr_ros.detection.marker_edges import FOUND, NO_EDGES, OTHER_CODE, refine_markers

# Why a marker is not found at its fitted edges.
_FAILURES = {
    NO_EDGES: 'not dark inside and bright outside along its edges (narrow margin, or covered)',
    OTHER_CODE: 'its cells do not fit its outline (wrong border_bits, covered, or blurred)',
}
# Number of markers whose corners predict the place of another one: several are more precise, the
# nearest alone is less affected by a wide lens.
_NEIGHBOURS = (4, 1)


def find_markers(
    grey: NDArray[np.uint8], board: MarkerBoard, min_marker_px: float
) -> tuple[Ints, Array, BoardMarkers]:
    """
    Find a board's markers in an image (h, w).

    Returns
    -------
    Ids (N,) (indices in the board's points), corners (N, 2) px, and the markers with what was
    rejected.

    """
    markers = find_board_markers(grey, board, min_marker_px)
    corners, status = _refined(grey, board, markers.corners, markers.indices, markers.inverted)
    failures = [_FAILURES.get(each, '') for each in status.tolist()]
    markers = rechecked(grey, board, markers, corners, failures, doubtful=status != FOUND)
    if 0 < len(markers.indices) < len(board.marker_ids):
        markers = _completed(grey, board, markers)
    markers = explained(grey, board, markers)
    ids = 4 * markers.indices[:, None] + np.arange(4)
    return ids.ravel(), markers.corners.reshape(-1, 2), markers


def _completed(grey: NDArray[np.uint8], board: MarkerBoard, markers: BoardMarkers) -> BoardMarkers:
    """
    Look for the other markers where the board has them; return all.

    OpenCV finds a marker only if its outline is a closed curve, which neighbours that touch it,
    blur and glare prevent. Its place follows from the markers around it, and its code is read.
    """
    found = dict(zip(markers.indices.tolist(), markers.corners, strict=True))
    inverted = bool(markers.inverted.all())
    for neighbours in _NEIGHBOURS:
        new: dict[int, Array] | None = None
        while new is None or new:
            left = [
                n
                for n, marker_id in enumerate(board.marker_ids)
                if n not in found and marker_id not in markers.repeated
            ]
            new = _found_as_predicted(grey, board, found, left, neighbours, inverted=inverted)
            found |= new
    order = sorted(found)
    return replace(
        markers,
        corners=np.array([found[n] for n in order]),
        indices=np.array(order, dtype=np.int64),
        inverted=np.full(len(order), inverted),
    )


def _found_as_predicted(
    grey: NDArray[np.uint8],
    board: MarkerBoard,
    found: dict[int, Array],
    left: list[int],
    neighbours: int,
    *,
    inverted: bool,
) -> dict[int, Array]:
    """Return the corners (4, 2) px, by index, of markers that are where the others suggest."""
    predicted = np.array([_predicted(board, found, n, neighbours) for n in left])
    predicted = predicted.reshape(-1, 4, 2)
    last = np.array(grey.shape[::-1]) - 1.0
    visible = ((predicted >= 0.0) & (predicted <= last)).all(axis=(1, 2))
    tried, quads = np.array(left, dtype=np.int64)[visible], predicted[visible]
    if not len(tried):
        return {}
    legible = are_legible(grey, board, quads, tried)
    tried, quads = tried[legible], quads[legible]
    refined, _ = _refined(grey, board, quads, tried, np.full(len(tried), inverted))
    fitted = np.isfinite(refined).all(axis=(1, 2))
    return dict(zip(tried[fitted].tolist(), refined[fitted], strict=True))


def _predicted(board: MarkerBoard, found: dict[int, Array], index: int, neighbours: int) -> Array:
    """Return the corners (4, 2) px of a marker as the nearest found markers suggest."""
    on_board = board.marker_corners
    known = np.array(list(found))
    distance = np.linalg.norm(on_board[known].mean(axis=1) - on_board[index].mean(axis=0), axis=1)
    nearest = known[np.argsort(distance)[:neighbours]]
    homography, _ = cv2.findHomography(
        on_board[nearest].reshape(-1, 2), np.concatenate([found[n] for n in nearest.tolist()])
    )
    if homography is None:
        return np.full((4, 2), -1.0)
    return np.asarray(cv2.perspectiveTransform(on_board[index][:, None], homography)[:, 0])


def _refined(
    grey: NDArray[np.uint8], board: MarkerBoard, corners: Array, indices: Ints, inverted: Mask
) -> tuple[Array, Ints]:
    """Refine markers (M, 4, 2): corners, NaN where one is not found, and status (M,)."""
    ids = [board.marker_ids[n] for n in indices.tolist()]
    cells = [marker_cells(board.dictionary, each, board.border_bits) for each in ids]
    refined, status = np.full_like(corners, np.nan), np.full(len(corners), NO_EDGES)
    for is_inverted, image in ((False, grey), (True, 255 - grey if inverted.any() else grey)):
        chosen = np.flatnonzero(inverted == is_inverted)
        if len(chosen):
            chosen_cells = np.array([cells[n] for n in chosen.tolist()])
            refined[chosen], status[chosen] = refine_markers(image, corners[chosen], chosen_cells)
    return refined, status
