# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""
AprilTagDetectionArray (apriltag_msgs) to correspondences.

Of each detection are used ``family``, ``id`` and ``corners[4]`` with ``x`` and ``y``, px. The
package need not be installed: nothing in here needs its classes.
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

from .points import checked, Correspondences, wrong_coordinates
from ..runtime.rejections import Rejected

# A marker: the set of codes that it is of, and its number there.
_Marker = tuple[str, int]

_FAMILY = re.compile(r'(?:tag)?(\d+h\d+)', re.IGNORECASE)
_NAMED = 3


def detection_array_type() -> type[Any] | None:
    """Return the message's class, or None where apriltag_msgs is not installed."""
    try:
        from apriltag_msgs.msg import AprilTagDetectionArray
    except ImportError:
        return None
    return AprilTagDetectionArray  # type: ignore[no-any-return]


def correspondences_from_detections(
    msg: Any,
    boards: Mapping[str, Board],
    corner_order: str = 'apriltag_ccw_from_bottom_left',
    pixel_center_px: float = 0.5,
) -> list[Correspondences | Rejected]:
    """
    Take the markers of boards out of a message.

    Each board of markers (single, grid, bundle) of which one is seen gives one answer, with the
    board's place in ``boards``. Other tags are ignored. Of a marker that is seen twice nobody
    knows which is the board's, so both are left out. A tag that cannot be right is no reason to
    mistrust other boards than its own.

    Parameters
    ----------
    msg
        An AprilTagDetectionArray, or what has its fields.
    boards
        The boards by name, in the order of their file.
    corner_order
        One of ``CORNER_ORDERS``; the default is AprilTag's own, which apriltag_ros passes on.
    pixel_center_px
        What the middle of the first pixel is called; AprilTag's own library calls it 0.5.

    Returns
    -------
    The boards that are seen; none where there is no detection. ``Rejected`` stands for a board
    with a tag that cannot be right, for each such tag that is on no board, and for a message
    that has nothing else.

    """
    seen = _corners_by_marker(msg.detections, CORNER_ORDERS[corner_order], pixel_center_px)
    answers: list[Correspondences | Rejected] = []
    strays = dict(seen)
    for index, board in enumerate(boards.values()):
        markers = _markers_of(board)
        answer = _of_board(board, index, markers, seen)
        if answer is not None:
            answers.append(answer)
        for marker in markers:
            strays.pop(marker, None)
    answers += [corners for corners in strays.values() if isinstance(corners, Rejected)]
    return answers if answers or not msg.detections else [_unknown(msg.detections)]


def _corners_by_marker(
    detections: Iterable[Any], order: tuple[tuple[float, float], ...], pixel_center_px: float
) -> dict[_Marker, Array | Rejected]:
    """
    Return the corners (4, 2) px, clockwise from the top left, of each marker seen once.

    In their place stands what is wrong with them where one of its detections cannot be right.
    """
    ours = [order.index(corner) for corner in CORNER_ORDERS['aruco_cw_from_top_left']]
    times: Counter[_Marker] = Counter()
    seen: dict[_Marker, Array | Rejected] = {}
    for detection in detections:
        marker = (_code_family_of(detection.family), detection.id)
        times[marker] += 1
        theirs = _corners_of(detection)
        if not isinstance(theirs, Rejected):
            theirs = theirs[ours] - pixel_center_px
        if not isinstance(seen.get(marker), Rejected):
            seen[marker] = theirs
    return {m: found for m, found in seen.items() if times[m] == 1 or isinstance(found, Rejected)}


def _corners_of(detection: Any) -> Array | Rejected:
    """Return the corners (4, 2) px of a tag as they came."""
    count = len(detection.corners)
    if count != 4:
        return Rejected(
            'corner_count', f'detections: expected 4 corners of tag {detection.id}, got {count}'
        )
    corners = np.array([(corner.x, corner.y) for corner in detection.corners], dtype=float)
    return wrong_coordinates(corners, f'detections: tag {detection.id}') or corners


def _code_family_of(family: str) -> str:
    """Return what ``code_family`` says of OpenCV's dictionary; '' of a family that it lacks."""
    known = _FAMILY.fullmatch(family)
    return code_family(f'DICT_APRILTAG_{known[1]}') if known else ''


def _markers_of(board: Board) -> list[_Marker]:
    """Return the markers of which a board consists: each has four of its points."""
    if not isinstance(board, MarkerBoard):
        return []
    family = code_family(board.dictionary)
    return [(family, marker_id) for marker_id in board.marker_ids]


def _of_board(
    board: Board, index: int, markers: list[_Marker], seen: Mapping[_Marker, Array | Rejected]
) -> Correspondences | Rejected | None:
    places, corners = [], []
    for place, marker in enumerate(markers):
        found = seen.get(marker)
        if isinstance(found, Rejected):
            return found
        if found is not None:
            places.append(place)
            corners.append(found)
    if not places:
        return None
    ids = (4 * np.array(places)[:, None] + np.arange(4)).ravel()
    return checked(np.concatenate(corners), board.points[ids], ids, 'detections', index)


def _unknown(detections: Iterable[Any]) -> Rejected:
    tags = sorted({f'{detection.family}:{detection.id}' for detection in detections})
    more = ', ...' if len(tags) > _NAMED else ''
    return Rejected(
        'unknown_tags',
        f'detections: none of the tags seen ({", ".join(tags[:_NAMED])}{more}) is on a board of '
        'board_file, or each is seen more than once',
    )
