# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""
AprilTagDetectionArray (apriltag_msgs, isaac_ros_apriltag_interfaces) -> correspondences.

Only ``family``, ``id`` and ``corners[4]`` (``x``, ``y`` in px) of each detection are used, which
both messages have. Nothing here needs the message classes, so the packages need not be installed.

This module stands alone: unlike a cloud, an array of tags is assigned to several boards.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Mapping
import re
from typing import Any

import numpy as np
from p4pfr_ros.boards import Board, MarkerBoard
from p4pfr_ros.boards.conventions import CORNER_ORDERS
from p4pfr_ros.boards.parts import code_family
from p4pfr_ros.core.geometry import Array
from p4pfr_ros.files.printable import printable

from .correspondences import checked, Correspondences, wrong_coordinates
from ..runtime.rejections import Rejected

# Code family and id of a marker.
_Marker = tuple[str, int]

_FAMILY = re.compile(r'(?:tag)?(\d+h\d+)', re.IGNORECASE)
_MAX_LISTED = 3


def detection_array_type() -> type[Any] | None:
    """Return the message class; None if apriltag_msgs is not installed."""
    try:
        from apriltag_msgs.msg import AprilTagDetectionArray
    except ImportError:
        return None
    return AprilTagDetectionArray  # type: ignore[no-any-return]


def isaac_detection_array_type() -> type[Any] | None:
    """Return the message class; None if isaac_ros_apriltag_interfaces is not installed."""
    try:
        from isaac_ros_apriltag_interfaces.msg import AprilTagDetectionArray
    except ImportError:
        return None
    return AprilTagDetectionArray  # type: ignore[no-any-return]


def correspondences_from_detections(
    msg: Any,
    boards: Mapping[str, Board],
    corner_order: str = 'apriltag_ccw_from_bottom_left',
    pixel_center_px: float = 0.5,
    *,
    topic: str = 'detections',
) -> list[Correspondences | Rejected]:
    """
    Assign the detected tags to the boards.

    A marker board (single marker, grid, bundle) is detected if at least one of its markers is.
    Tags that belong to no board are ignored. If a tag is detected twice, it is ambiguous which
    one is on the board, so both are left out. An invalid tag rejects its own board only.

    Parameters
    ----------
    msg
        An AprilTagDetectionArray, or any object with its fields.
    boards
        The boards by name, in the order of the board file.
    corner_order
        One of ``CORNER_ORDERS``; the default is AprilTag's, which apriltag_ros publishes.
    pixel_center_px
        Coordinate of the centre of the first pixel; 0.5 in AprilTag's library.
    topic
        The topic, for the texts of rejections.

    Returns
    -------
    The correspondences of each detected board, with its index; empty without detections.
    ``Rejected`` for each board with an invalid tag, for each invalid tag that belongs to no
    board, and for a message without anything else.

    """
    order = CORNER_ORDERS[corner_order]
    detected = _corners_by_marker(msg.detections, order, pixel_center_px, topic)
    results: list[Correspondences | Rejected] = []
    others = dict(detected)
    for index, board in enumerate(boards.values()):
        markers = _markers_of(board)
        result = _of_board(board, index, markers, detected, topic)
        if result is not None:
            results.append(result)
        for marker in markers:
            others.pop(marker, None)
    results += [corners for corners in others.values() if isinstance(corners, Rejected)]
    return results if results or not msg.detections else [_unknown(msg.detections, topic)]


def _corners_by_marker(
    detections: Iterable[Any],
    order: tuple[tuple[float, float], ...],
    pixel_center_px: float,
    topic: str,
) -> dict[_Marker, Array | Rejected]:
    """
    Return the corners (4, 2) px, clockwise from the top left, of each marker detected once.

    A marker with an invalid detection has ``Rejected`` instead.
    """
    clockwise = [order.index(corner) for corner in CORNER_ORDERS['aruco_cw_from_top_left']]
    counts: Counter[_Marker] = Counter()
    corners: dict[_Marker, Array | Rejected] = {}
    for detection in detections:
        marker = (_code_family_of(detection.family), detection.id)
        counts[marker] += 1
        points = _corners_of(detection, topic)
        if not isinstance(points, Rejected):
            points = points[clockwise] - pixel_center_px
        if not isinstance(corners.get(marker), Rejected):
            corners[marker] = points
    return {m: c for m, c in corners.items() if counts[m] == 1 or isinstance(c, Rejected)}


def _corners_of(detection: Any, topic: str) -> Array | Rejected:
    """Return the corners (4, 2) px of a tag in the order of the message."""
    count = len(detection.corners)
    if count != 4:
        return Rejected(
            'corner_count', f'{topic}: expected 4 corners of tag {detection.id}, got {count}'
        )
    corners = np.array([(corner.x, corner.y) for corner in detection.corners], dtype=float)
    return wrong_coordinates(corners, f'{topic}: tag {detection.id}') or corners


def _code_family_of(family: str) -> str:
    """Return ``code_family`` of OpenCV's dictionary; '' if OpenCV does not have the family."""
    match = _FAMILY.fullmatch(family)
    return code_family(f'DICT_APRILTAG_{match[1]}') if match else ''


def _markers_of(board: Board) -> list[_Marker]:
    """Return the markers of a board, in the order of its points (four each)."""
    if not isinstance(board, MarkerBoard):
        return []
    family = code_family(board.dictionary)
    return [(family, marker_id) for marker_id in board.marker_ids]


def _of_board(
    board: Board,
    index: int,
    markers: list[_Marker],
    detected: Mapping[_Marker, Array | Rejected],
    topic: str,
) -> Correspondences | Rejected | None:
    indices, corners = [], []
    for i, marker in enumerate(markers):
        points = detected.get(marker)
        if isinstance(points, Rejected):
            return points
        if points is not None:
            indices.append(i)
            corners.append(points)
    if not indices:
        return None
    ids = (4 * np.array(indices)[:, None] + np.arange(4)).ravel()
    return checked(np.concatenate(corners), board.points[ids], ids, topic, index)


def _unknown(detections: Iterable[Any], topic: str) -> Rejected:
    families = {(printable(detection.family, 20), detection.id) for detection in detections}
    tags = sorted(f'{family}:{number}' for family, number in families)
    more = ', ...' if len(tags) > _MAX_LISTED else ''
    return Rejected(
        'unknown_tags',
        f'{topic}: no tag ({", ".join(tags[:_MAX_LISTED])}{more}) belongs to a board of '
        'board_file, or each was detected more than once',
    )
