# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""
``detect``: find the points of any board in an image.

This module stands alone: it holds the public function, above one finder per family of boards.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

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
from p4pfr_ros.detection.candidates import (
    BoardMarkers,
    NOT_ON_BOARD,
    RejectedCandidate,
    summary,
)
from p4pfr_ros.detection.charuco import find_charuco
from p4pfr_ros.detection.chessboard import find_chessboard
from p4pfr_ros.detection.circle_centres import LensMiddle
from p4pfr_ros.detection.circle_grid import find_circle_grid
from p4pfr_ros.detection.markers import find_markers

# OpenCV's detectors raise on smaller images, in which no board could be resolved anyway.
_MIN_IMAGE_SIDE_PX = 16
# Around the last place of a board: a margin in sizes of the board, and at least this. A window of
# almost the whole image saves nothing.
_WINDOW_MARGIN, _MIN_MARGIN_PX = 0.3, 24.0
_MAX_WINDOW = 0.7
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
    image: NDArray[np.uint8],
    board: Board,
    *,
    near: Detection | None = None,
    min_marker_px: float = MIN_MARKER_PX,
) -> Detection:
    """
    Detect a board in an image, (h, w) grey or (h, w, 3) BGR, uint8.

    A chessboard must be entirely visible. Other boards may be partly visible; the result then
    holds the detected points only.

    Parameters
    ----------
    image, board
        The image, and what to look for.
    near
        The detection in the image before. The board is first searched around its place there, and
        in the whole image if it is not there with at least as many points. A second, equal board
        elsewhere is not noticed meanwhile.
    min_marker_px
        Side of the smallest markers, pixels. Larger values save time; below 12 px, the search
        takes four times as long. In an image of a pattern with a thousand cells, such as tiles or
        a fence, markers smaller than two cells are not searched.

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
    found = None
    if near is not None and len(near.ids):
        found = _detect_near(grey, board, near, min_marker_px)
    return found or _detect_in(grey, board, min_marker_px, LensMiddle.of(grey.shape))


def _detect_near(
    grey: NDArray[np.uint8], board: Board, near: Detection, min_marker_px: float
) -> Detection | None:
    """Return what is found around the place of an earlier detection; None if it may be less."""
    rows, columns = _window(board, near, grey.shape)
    window = np.ascontiguousarray(grey[rows, columns])
    is_small = window.size < _MAX_WINDOW * grey.size
    if not is_small or min(window.shape) < _MIN_IMAGE_SIDE_PX:
        return None
    offset_px = np.array([columns.start, rows.start])
    lens = LensMiddle.of(grey.shape, offset_px)
    found = _moved(_detect_in(window, board, min_marker_px, lens), offset_px)
    is_complete = len(found.ids) >= len(near.ids) and not _is_cut(
        board, found, offset_px, offset_px + window.shape[::-1], grey.shape
    )
    return found if is_complete else None


def _window(board: Board, near: Detection, shape: tuple[int, ...]) -> tuple[slice, slice]:
    """Return the rows and columns around the place of a whole board, of which points are known."""
    points = near.image_points
    if len(points) < len(board.points):
        points = np.concatenate([points, _predicted_points(board, near)])
    margin = np.maximum(_WINDOW_MARGIN * np.ptp(near.image_points, axis=0).max(), _MIN_MARGIN_PX)
    size = np.array(shape[::-1])
    low = np.clip(np.nan_to_num(points.min(axis=0) - margin), 0, size).astype(int)
    high = np.clip(np.nan_to_num(points.max(axis=0) + margin), 0, size).astype(int)
    high = np.maximum(high, np.minimum(low + _MIN_IMAGE_SIDE_PX, size))
    return slice(int(low[1]), int(high[1])), slice(int(low[0]), int(high[0]))


def _is_cut(board: Board, found: Detection, low: Ints, high: Ints, shape: tuple[int, ...]) -> bool:
    """Return whether a board goes on in an image (h, w) outside the window from low to high."""
    if len(found.ids) == len(board.points):
        return False
    points = _predicted_points(board, found)
    in_image = ((points >= 0) & (points < shape[::-1])).all(axis=1)
    in_window = ((points >= low) & (points < high)).all(axis=1)
    return not len(points) or bool((in_image & ~in_window).any())


def _predicted_points(board: Board, near: Detection) -> Array:
    """Return all points (N, 2) px of a board of which some are known; none if they do not tell."""
    homography, _ = cv2.findHomography(near.board_points, near.image_points)
    if homography is None:
        return np.empty((0, 2))
    points: Array = cv2.perspectiveTransform(board.points[:, None], homography)[:, 0]
    return points


def _moved(detection: Detection, offset_px: Ints) -> Detection:
    """Return a detection in a window as one in the image."""
    return replace(
        detection,
        image_points=detection.image_points + offset_px,
        rejected=tuple(
            replace(each, outline=each.outline + offset_px) for each in detection.rejected
        ),
    )


def _detect_in(
    grey: NDArray[np.uint8], board: Board, min_marker_px: float, lens: LensMiddle
) -> Detection:
    rejected: tuple[RejectedCandidate, ...] = ()
    if isinstance(board, Chessboard):
        ids, points, reason, rejected = find_chessboard(grey, board)
    elif isinstance(board, CircleGrid):
        ids, points, reason, rejected = find_circle_grid(grey, board, lens)
    elif isinstance(board, Charuco):
        ids, points, markers = find_charuco(grey, board, min_marker_px)
        reason, rejected = '' if len(ids) else _why_absent(board, markers), markers.rejected
    else:
        ids, points, markers = find_markers(grey, board, min_marker_px)
        reason, rejected = '' if len(ids) else _why_absent(board, markers), markers.rejected
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
    # Kernels are compiled for writable arrays; those of messages may be read-only.
    return np.require(image.reshape(shape[:2]), requirements=['C', 'W'])


def _rejected(reason: str, rejected: tuple[RejectedCandidate, ...] = ()) -> Detection:
    none = np.empty((0, 2))
    return Detection(none, none, np.empty(0, dtype=np.int64), reason, rejected)


def _why_absent(board: Charuco | MarkerBoard, markers: BoardMarkers) -> str:
    """Return why there is no point, with the markers that are visible instead."""
    if markers.reason:
        return markers.reason
    # An id in the board file may be wrong.
    others = [each for each in markers.rejected if each.reason.endswith(NOT_ON_BOARD)]
    return _nothing_found(board) + (f', but {summary([], others)}' if others else '')


def _nothing_found(board: Charuco | MarkerBoard) -> str:
    if isinstance(board, Charuco):
        return f'no corner of a {board.columns}x{board.rows} ChArUco board found'
    if isinstance(board, Marker):
        return f'no marker {board.id} of {board.dictionary} found'
    if isinstance(board, Bundle):
        return f'none of the {len(board.markers)} markers of {board.name} found'
    first, last = board.marker_ids[0], board.marker_ids[-1]
    return f'none of the markers {first} to {last} of {board.dictionary} found'
