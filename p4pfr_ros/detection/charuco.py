# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""
Detection of ChArUco boards: predict the chessboard corners from the markers, then refine them.

Each corner touches two markers. Each of them predicts the corner by its own homography, over a
distance so short that lens distortion is negligible. OpenCV's interpolation is not used: it
differs between versions and drops corners under strong distortion.

This module stands alone, as each finder of a family of boards does.
"""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray
from p4pfr_ros.boards import Charuco
from p4pfr_ros.core.geometry import Array, Ints
from p4pfr_ros.detection.candidates import BoardMarkers, find_board_markers
from p4pfr_ros.detection.saddles import refine_saddles

# Predictions of one corner that differ by more, in squares, come from a misdetected marker.
_MAX_DISAGREEMENT_IN_SQUARES = 0.25
# Radius of the refinement patch, in distances from the corner to the nearest marker corner.
_RADIUS_IN_GAPS = 1.0


def find_charuco(grey: NDArray[np.uint8], board: Charuco) -> tuple[Ints, Array, BoardMarkers]:
    """
    Find a board's corners in an image (h, w).

    Returns
    -------
    Ids (N,) (indices in the board's points), corners (N, 2) px, and the markers with what was
    rejected.

    """
    markers = find_board_markers(grey, board)
    ids, predicted, along, across = _predict(board, markers.corners, markers.indices)
    if not len(ids):
        return ids, predicted, markers
    gap = 0.5 * (1.0 - board.marker_m / board.square_m) * np.sqrt(2.0)
    radius = min(_RADIUS_IN_GAPS * gap, 0.45)
    saddles = refine_saddles(grey, predicted, along, across, radius)
    return ids[saddles.good], saddles.points[saddles.good], markers


def _predict(board: Charuco, corners: Array, indices: Ints) -> tuple[Ints, Array, Array, Array]:
    """Return ids (N,), corners (N, 2) and the two sides of a square there, (N, 2) each, in px."""
    # Steps of a tenth of a square give the local directions of the sides.
    steps = 0.1 * board.square_m * np.array([[0, 0], [1, 0], [0, 1]])
    predictions: dict[int, list[Array]] = {}
    for image_corners, index in zip(corners, indices.tolist(), strict=True):
        board_corners = board.marker_corners[index]
        image_from_board = cv2.getPerspectiveTransform(
            board_corners.astype(np.float32), image_corners.astype(np.float32)
        )
        off_centre = np.abs(board.points - board_corners.mean(axis=0)).max(axis=1)
        for point_id in np.flatnonzero(off_centre < 0.75 * board.square_m).tolist():
            corner_and_steps = _apply(image_from_board, board.points[point_id] + steps)
            predictions.setdefault(point_id, []).append(corner_and_steps)
    accepted = {}
    for point_id in sorted(predictions):
        corner, right, up = np.mean(predictions[point_id], axis=0)
        along, across = 10.0 * (right - corner), 10.0 * (up - corner)
        disagreement_px = np.ptp([each[0] for each in predictions[point_id]], axis=0).max()
        side_px = min(np.linalg.norm(along), np.linalg.norm(across))
        if disagreement_px < _MAX_DISAGREEMENT_IN_SQUARES * side_px:
            accepted[point_id] = (corner, along, across)
    ids = np.array(list(accepted), dtype=np.int64)
    corner, along, across = np.array(list(accepted.values())).reshape(-1, 3, 2).swapaxes(0, 1)
    return ids, corner, along, across


def _apply(homography: Array, points: Array) -> Array:
    mapped = np.pad(points, ((0, 0), (0, 1)), constant_values=1.0) @ homography.T
    applied: Array = mapped[:, :2] / mapped[:, 2:]
    return applied
