# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""
ArUco and AprilTag markers: the only room that knows OpenCV's two interfaces to them.

OpenCV 4.7 replaced the functions of ``cv2.aruco`` (still current in Debian's and Ubuntu's 4.6) by
classes. What is used of them here is little: a dictionary, a marker's picture, the search.
"""

from __future__ import annotations

import difflib
from functools import lru_cache
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray
from p4pfr_ros.boards import Board, Bundle, Charuco, Marker, MarkerGrid
from p4pfr_ros.core.geometry import Array, Ints

# Type information knows the newer of the two only. Without contrib, 4.6 has no such module.
_aruco: Any = getattr(cv2, 'aruco', None)
_HAS_CLASSES = hasattr(_aruco, 'ArucoDetector')

# Which of a board's keys is to blame for an id that its dictionary lacks.
_KEYS: dict[type[Any], str] = {
    Marker: 'id',
    MarkerGrid: 'first_id',
    Charuco: 'columns',
    Bundle: 'markers',
}


def dictionary_names() -> list[str]:
    """Return the names of the dictionaries that this OpenCV has."""
    return sorted(name for name in dir(_aruco) if name.startswith('DICT_'))


def check_markers(board: Board) -> None:
    """
    Make sure that this OpenCV has the board's dictionary, and that the dictionary has its ids.

    Raises
    ------
    ValueError
        ``KEY: expected ..., got ...``.

    """
    if not board.marker_ids:
        return
    largest = len(_dictionary(board.dictionary).bytesList) - 1  # type: ignore[union-attr]
    if max(board.marker_ids) > largest:
        raise ValueError(
            f'{_KEYS[type(board)]}: expected ids up to {largest}, which is where '
            f'{board.dictionary} ends, got {max(board.marker_ids)}'  # type: ignore[union-attr]
        )


def marker_cells(dictionary: str, marker_id: int) -> NDArray[np.bool_]:
    """Return a marker's cells, (n, n) from the top left, True where black, border included."""
    black: NDArray[np.bool_] = _picture(dictionary, marker_id) < 128
    return np.rot90(black, 2) if _is_upside_down(dictionary) else black


def _picture(dictionary: str, marker_id: int) -> NDArray[np.uint8]:
    known = _dictionary(dictionary)
    side = known.markerSize + 2
    if _HAS_CLASSES:
        return np.asarray(known.generateImageMarker(marker_id, side))
    return np.asarray(_aruco.drawMarker(known, marker_id, side))


def detect_markers(grey: NDArray[np.uint8], dictionary: str) -> tuple[Array, Ints]:
    """Return the corners (M, 4, 2) px, clockwise from the top left, and the ids (M,)."""
    known = _dictionary(dictionary)
    if _HAS_CLASSES:
        corners, ids, _ = _aruco.ArucoDetector(known, _parameters()).detectMarkers(grey)
    else:
        corners, ids, _ = _aruco.detectMarkers(grey, known, parameters=_parameters())
    if ids is None or len(ids) == 0:
        return np.empty((0, 4, 2)), np.empty(0, dtype=np.int64)
    stacked = np.asarray(corners, dtype=np.float64).reshape(-1, 4, 2)
    if _is_upside_down(dictionary):
        stacked = np.roll(stacked, -2, axis=1)
    return stacked, np.asarray(ids, dtype=np.int64).ravel()


@lru_cache(maxsize=32)
def _dictionary(name: str) -> Any:
    if _aruco is None:
        raise ValueError(
            f'dictionary: expected an OpenCV with markers (from 4.7 on, or with contrib), '
            f'got {cv2.__version__} without'
        )
    if name not in dictionary_names():
        near = difflib.get_close_matches(name, dictionary_names(), n=1)
        hint = f' (did you mean {near[0]}?)' if near else ''
        raise ValueError(f"dictionary: expected one of OpenCV's, got {name!r}{hint}")
    return _aruco.getPredefinedDictionary(getattr(_aruco, name))


@lru_cache(maxsize=32)
def _is_upside_down(name: str) -> bool:
    # Up to 5.0.0 OpenCV has AprilTag's families turned by half a turn against AprilTag's own
    # pictures (opencv/opencv#28823). The first tag of 36h11 tells: its code begins with 110101.
    if not name.upper().startswith('DICT_APRILTAG_'):
        return False
    first = _picture('DICT_APRILTAG_36h11', 0)[1, 1:-1] > 127
    return bool(first.tolist() != [True, True, False, True, False, True])


def _parameters() -> Any:
    if _HAS_CLASSES:
        parameters = _aruco.DetectorParameters()
    else:
        parameters = _aruco.DetectorParameters_create()
    return parameters
