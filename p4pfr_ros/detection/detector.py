# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""
``detect``: find the points of any board in an image.

This module stands alone: it holds the public function, above one finder per family of boards.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray
from p4pfr_ros.boards import (
    Board,
    Bundle,
    Charuco,
    Chessboard,
    CircleGrid,
    Marker,
    MarkerBoard,
)
from p4pfr_ros.core.geometry import Array, Ints
from p4pfr_ros.detection.aruco import check_markers, MIN_MARKER_PX
from p4pfr_ros.detection.candidates import RejectedCandidate
from p4pfr_ros.detection.charuco import find_charuco
from p4pfr_ros.detection.chessboard import find_chessboard
from p4pfr_ros.detection.circle_grid import find_circle_grid
from p4pfr_ros.detection.markers import find_markers

# OpenCV's detectors raise on smaller images, in which no board could be resolved anyway.
_MIN_IMAGE_SIDE_PX = 16
# Fewer points do not determine a pose.
_MIN_POINTS = 4


@dataclass(frozen=True, slots=True, eq=False)
class Detection:
    """
    The points of a board that were detected in an image.

    Parameters
    ----------
    image_points : (N, 2) array
        Pixels; pixel centres are integers.
    board_points : (N, 2) array
        The same points on the board, metres.
    ids : (N,) array
        Their indices in the board's ``points``.
    reason
        Why there are no points, or too few for a pose (then N is 0); empty on success.
    rejected
        What looked like a part of the board, and why it is not.

    """

    image_points: Array
    board_points: Array
    ids: Ints
    reason: str = ''
    rejected: tuple[RejectedCandidate, ...] = ()


def detect(
    image: NDArray[np.uint8], board: Board, *, min_marker_px: float = MIN_MARKER_PX
) -> Detection:
    """
    Detect a board in an image, (h, w) grey or (h, w, 3) BGR, uint8.

    A chessboard must be entirely visible. Other boards may be partly visible; the result then
    holds the detected points only.

    Raises
    ------
    ValueError
        The image has another shape or type, or OpenCV lacks the board's dictionary or markers.

    """
    grey = _as_grey(image)
    check_markers(board)
    if min(grey.shape) < _MIN_IMAGE_SIDE_PX:
        height, width = grey.shape
        at_least = f'{_MIN_IMAGE_SIDE_PX}x{_MIN_IMAGE_SIDE_PX}'
        return _rejected(f'image too small: {width}x{height} px, at least {at_least} px needed')
    rejected: tuple[RejectedCandidate, ...] = ()
    if isinstance(board, Chessboard):
        ids, points, reason = find_chessboard(grey, board)
    elif isinstance(board, CircleGrid):
        ids, points, rejected = find_circle_grid(grey, board)
        reason = (
            f'no grid of {board.columns}x{board.rows} circles found among {len(rejected)} dark '
            'circles'
        )
    elif isinstance(board, Charuco):
        ids, points, markers = find_charuco(grey, board, min_marker_px)
        reason = markers.reason or (
            f'no corner of a {board.columns}x{board.rows} ChArUco board found'
        )
        rejected = markers.rejected
    else:
        ids, points, markers = find_markers(grey, board, min_marker_px)
        reason = markers.reason or _no_marker_reason(board)
        rejected = markers.rejected
    if len(ids) >= _MIN_POINTS:
        return Detection(points, board.points[ids], ids, rejected=rejected)
    if len(ids):
        reason = f'only {len(ids)} points of the board found, at least {_MIN_POINTS} needed'
    return _rejected(reason, rejected)


def _as_grey(image: NDArray[np.uint8]) -> NDArray[np.uint8]:
    shape, dtype = np.shape(image), getattr(image, 'dtype', type(image).__name__)
    if dtype != np.uint8 or not (len(shape) == 2 or (len(shape) == 3 and shape[2] == 3)):
        raise ValueError(f'image must be (h, w) or (h, w, 3) of uint8, got {shape} of {dtype}')
    if len(shape) == 3 and image.size:
        image = cv2.cvtColor(image, cv2.COLOR_BGR2GRAY)
    return np.ascontiguousarray(image.reshape(shape[:2]))


def _rejected(reason: str, rejected: tuple[RejectedCandidate, ...] = ()) -> Detection:
    none = np.empty((0, 2))
    return Detection(none, none, np.empty(0, dtype=np.int64), reason, rejected)


def _no_marker_reason(board: MarkerBoard) -> str:
    if isinstance(board, Marker):
        return f'no marker {board.id} of {board.dictionary} found'
    if isinstance(board, Bundle):
        return f'none of the {len(board.markers)} markers of {board.name} found'
    first, last = board.marker_ids[0], board.marker_ids[-1]
    return f'none of the markers {first} to {last} of {board.dictionary} found'
