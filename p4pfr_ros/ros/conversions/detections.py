# Copyright 2026 p4pfr_ros maintainers
#
# Licensed under the Apache License, Version 2.0 (the "License");
# you may not use this file except in compliance with the License.
# You may obtain a copy of the License at
#
#     http://www.apache.org/licenses/LICENSE-2.0
#
# Unless required by applicable law or agreed to in writing, software
# distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied.
# See the License for the specific language governing permissions and
# limitations under the License.

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

from .points import checked, Correspondences
from ..rejections import Rejected

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
) -> list[Correspondences] | Rejected:
    """
    Take the markers of boards out of a message.

    Each board of markers (single, grid, bundle) of which one is seen gives one answer, with the
    board's place in ``boards``. Other tags are ignored. Of a marker that is seen twice nobody
    knows which is the board's, so both are left out.

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
    The boards that are seen; none where there is no detection. ``Rejected`` where none of the
    tags is on a board, or a message cannot be right.

    """
    wrong = _wrong_corners(msg.detections)
    if wrong is not None:
        return wrong
    seen = _corners_by_marker(msg.detections, CORNER_ORDERS[corner_order], pixel_center_px)
    answers = []
    for index, board in enumerate(boards.values()):
        answer = _of_board(board, index, seen)
        if isinstance(answer, Rejected):
            return answer
        if answer is not None:
            answers.append(answer)
    return answers if answers or not msg.detections else _unknown(msg.detections)


def _wrong_corners(detections: Iterable[Any]) -> Rejected | None:
    for detection in detections:
        if len(detection.corners) != 4:
            return Rejected(
                'corner_count',
                f'detections: expected 4 corners of tag {detection.id}, '
                f'got {len(detection.corners)}',
            )
    return None


def _corners_by_marker(
    detections: Iterable[Any], order: tuple[tuple[float, float], ...], pixel_center_px: float
) -> dict[_Marker, Array]:
    """Return the corners (4, 2) px, clockwise from the top left, of each marker seen once."""
    ours = [order.index(corner) for corner in CORNER_ORDERS['aruco_cw_from_top_left']]
    times: Counter[_Marker] = Counter()
    corners: dict[_Marker, Array] = {}
    for detection in detections:
        marker = (_code_family_of(detection.family), detection.id)
        times[marker] += 1
        theirs = np.array([(corner.x, corner.y) for corner in detection.corners], dtype=float)
        corners[marker] = theirs[ours] - pixel_center_px
    return {marker: points for marker, points in corners.items() if times[marker] == 1}


def _code_family_of(family: str) -> str:
    """Return what ``code_family`` says of OpenCV's dictionary; '' of a family that it lacks."""
    known = _FAMILY.fullmatch(family)
    return code_family(f'DICT_APRILTAG_{known[1]}') if known else ''


def _of_board(
    board: Board, index: int, seen: Mapping[_Marker, Array]
) -> Correspondences | Rejected | None:
    if not isinstance(board, MarkerBoard):
        return None
    family = code_family(board.dictionary)
    markers = [(family, marker_id) for marker_id in board.marker_ids]
    places = np.array([place for place, marker in enumerate(markers) if marker in seen], dtype=int)
    if not places.size:
        return None
    image_points = np.concatenate([seen[markers[place]] for place in places])
    ids = (4 * places[:, None] + np.arange(4)).ravel()
    return checked(image_points, board.points[ids], ids, 'detections', index)


def _unknown(detections: Iterable[Any]) -> Rejected:
    tags = sorted({f'{detection.family}:{detection.id}' for detection in detections})
    more = ', ...' if len(tags) > _NAMED else ''
    return Rejected(
        'unknown_tags',
        f'detections: none of the tags seen ({", ".join(tags[:_NAMED])}{more}) is on a board of '
        'board_file, or each is seen more than once',
    )
