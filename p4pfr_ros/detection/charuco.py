# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""
ChArUco boards in pictures: markers tell where the chessboard's corners are, then those are fitted.

Each corner touches two markers, and each of them predicts it by its own homography, over so short
a way that no lens distortion needs to be known. OpenCV's own interpolation is not used: it
differs between versions, and where the lens bends much it drops corners.
"""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray
from p4pfr_ros.boards import Charuco
from p4pfr_ros.core.geometry import Array, Ints
from p4pfr_ros.detection.aruco import detect_markers
from p4pfr_ros.detection.saddles import refine_saddles

# Two predictions of a corner that are farther apart, in squares, come of a wrong marker.
_MOST_DISAGREEMENT = 0.25
# A patch reaches as far as the corner of a marker, in gaps between the two corners.
_RADIUS_IN_GAPS = 1.0


def find_charuco(grey: NDArray[np.uint8], board: Charuco) -> tuple[Ints, Array]:
    """Find a board's corners in a picture (h, w): ids (N,) and corners (N, 2) px."""
    corners, marker_ids = detect_markers(grey, board.dictionary)
    on_board = marker_ids < len(board.marker_ids)
    corners, marker_ids = corners[on_board], marker_ids[on_board]
    ids, guess, along, across = _predict(board, corners, marker_ids)
    if not len(ids):
        return ids, guess
    gap = 0.5 * (1.0 - board.marker_m / board.square_m) * np.sqrt(2.0)
    saddles = refine_saddles(grey, guess, along, across, min(_RADIUS_IN_GAPS * gap, 0.45))
    return ids[saddles.good], saddles.points[saddles.good]


def _predict(board: Charuco, corners: Array, marker_ids: Ints) -> tuple[Ints, Array, Array, Array]:
    """Return ids, places, and the two sides of a square there (px) of the board's corners."""
    # A tenth of a square shows the direction of its sides there.
    steps = 0.1 * board.square_m * np.array([[0, 0], [1, 0], [0, 1]])
    seen: dict[int, list[Array]] = {}
    for image_corners, marker_id in zip(corners, marker_ids.tolist(), strict=True):
        board_corners = board.marker_corners[marker_id]
        image_from_board = cv2.getPerspectiveTransform(
            board_corners.astype(np.float32), image_corners.astype(np.float32)
        )
        off_centre = np.abs(board.points - board_corners.mean(axis=0)).max(axis=1)
        for point_id in np.flatnonzero(off_centre < 0.75 * board.square_m).tolist():
            three = _apply(image_from_board, board.points[point_id] + steps)
            seen.setdefault(point_id, []).append(three)
    guesses = {}
    for point_id in sorted(seen):
        place, right, up = np.mean(seen[point_id], axis=0)
        along, across = 10.0 * (right - place), 10.0 * (up - place)
        apart_px = np.ptp([three[0] for three in seen[point_id]], axis=0).max()
        side_px = min(np.linalg.norm(along), np.linalg.norm(across))
        if apart_px < _MOST_DISAGREEMENT * side_px:
            guesses[point_id] = (place, along, across)
    ids = np.array(list(guesses), dtype=np.int64)
    place, along, across = np.array(list(guesses.values())).reshape(-1, 3, 2).swapaxes(0, 1)
    return ids, place, along, across


def _apply(homography: Array, points: Array) -> Array:
    mapped = np.pad(points, ((0, 0), (0, 1)), constant_values=1.0) @ homography.T
    applied: Array = mapped[:, :2] / mapped[:, 2:]
    return applied
