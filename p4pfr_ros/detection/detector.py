# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""``detect``: each kind of board by its own finder, all with one answer."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray
from p4pfr_ros.boards import Board, Bundle, Charuco, Chessboard, Marker, MarkerBoard
from p4pfr_ros.core.geometry import Array, Ints
from p4pfr_ros.detection.aruco import check_markers
from p4pfr_ros.detection.charuco import find_charuco
from p4pfr_ros.detection.chessboard import find_chessboard
from p4pfr_ros.detection.markers import find_markers

# OpenCV's detectors fail on less, and no board could be told there.
_SMALLEST_IMAGE_PX = 16
# With fewer points there is no pose.
_FEWEST_POINTS = 4


@dataclass(frozen=True, slots=True, eq=False)
class Detection:
    """
    Points of a board that were found in a picture.

    Parameters
    ----------
    image_points : (N, 2) array
        Pixels; pixel centres are integers.
    board_points : (N, 2) array
        The same points on the board, metres.
    ids : (N,) array
        Their indices in the board's ``points``.
    reason
        Why nothing was found, or too little for a pose (then N is 0); else empty.

    """

    image_points: Array
    board_points: Array
    ids: Ints
    reason: str = ''


def detect(image: NDArray[np.uint8], board: Board) -> Detection:
    """
    Find a board in a picture, (h, w) grey or (h, w, 3) BGR, uint8.

    A board need not be seen whole, except a chessboard: of the others, what is found is returned.

    Raises
    ------
    ValueError
        The picture is of another kind, or this OpenCV does not know the board's markers.

    """
    grey = _as_grey(image)
    check_markers(board)
    if min(grey.shape) < _SMALLEST_IMAGE_PX:
        width, height = grey.shape[::-1]
        return _nothing(f'the picture is too small: {width}x{height} px')
    if isinstance(board, Chessboard):
        ids, points = find_chessboard(grey, board)
        missing = f'no {board.columns}x{board.rows} chessboard found'
    elif isinstance(board, Charuco):
        ids, points = find_charuco(grey, board)
        missing = f'no corner of a {board.columns}x{board.rows} ChArUco board found'
    else:
        ids, points, doubled = find_markers(grey, board)
        missing = _missing(board)
        if doubled:
            missing = f'marker {doubled[0]} is seen more than once: which one is meant?'
    if 0 < len(ids) < _FEWEST_POINTS:
        missing = f"only {len(ids)} of the board's points found, {_FEWEST_POINTS} are needed"
    enough = len(ids) >= _FEWEST_POINTS
    return Detection(points, board.points[ids], ids) if enough else _nothing(missing)


def _as_grey(image: NDArray[np.uint8]) -> NDArray[np.uint8]:
    shape, kind = np.shape(image), getattr(image, 'dtype', type(image).__name__)
    if kind != np.uint8 or not (len(shape) == 2 or (len(shape) == 3 and shape[2] == 3)):
        raise ValueError(f'image must be (h, w) or (h, w, 3) of uint8, got {shape} of {kind}')
    if len(shape) == 3 and image.size:
        image = cv2.cvtColor(image, cv2.COLOR_BGR2GRAY)
    return np.ascontiguousarray(image.reshape(shape[:2]))


def _nothing(reason: str) -> Detection:
    return Detection(np.empty((0, 2)), np.empty((0, 2)), np.empty(0, dtype=np.int64), reason)


def _missing(board: MarkerBoard) -> str:
    if isinstance(board, Marker):
        return f'no marker {board.id} of {board.dictionary} found'
    if isinstance(board, Bundle):
        return f'none of the {len(board.markers)} markers of {board.name} found'
    first, last = board.marker_ids[0], board.marker_ids[-1]
    return f'none of the markers {first} to {last} of {board.dictionary} found'
