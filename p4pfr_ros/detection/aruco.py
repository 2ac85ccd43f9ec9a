# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""
ArUco and AprilTag markers: a wrapper around both of OpenCV's interfaces to them.

OpenCV 4.7 replaced the functions of ``cv2.aruco``, which Debian's and Ubuntu's 4.6 still has, by
classes. This package needs a dictionary, the image of a marker, and the detector.
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

# OpenCV's type stubs cover the classes only. OpenCV 4.6 without contrib has no such module.
_aruco: Any = getattr(cv2, 'aruco', None)
_HAS_CLASSES = hasattr(_aruco, 'ArucoDetector')

# The key to name in the error when the dictionary lacks an id of the board.
_ID_KEYS: dict[type[Any], str] = {
    Marker: 'id',
    MarkerGrid: 'first_id',
    Charuco: 'columns',
    Bundle: 'markers',
}


def dictionary_names() -> list[str]:
    """Return the names of the dictionaries in the installed OpenCV."""
    return sorted(name for name in dir(_aruco) if name.startswith('DICT_'))


def check_markers(board: Board) -> None:
    """
    Check that the installed OpenCV has the board's dictionary and that it contains the ids.

    Raises
    ------
    ValueError
        ``KEY: expected ..., got ...``.

    """
    if not board.marker_ids:
        return
    last_id = len(_dictionary(board.dictionary).bytesList) - 1  # type: ignore[union-attr]
    if max(board.marker_ids) > last_id:
        raise ValueError(
            f'{_ID_KEYS[type(board)]}: expected ids up to {last_id}, the last of '
            f'{board.dictionary}, got {max(board.marker_ids)}'  # type: ignore[union-attr]
        )


def marker_cells(dictionary: str, marker_id: int) -> NDArray[np.bool_]:
    """Return a marker's cells, (n, n) from the top left, True where black, border included."""
    black: NDArray[np.bool_] = _marker_image(dictionary, marker_id) < 128
    return np.rot90(black, 2) if _is_upside_down(dictionary) else black


def _marker_image(dictionary: str, marker_id: int) -> NDArray[np.uint8]:
    """Return the image of a marker as OpenCV draws it, one pixel per cell."""
    predefined = _dictionary(dictionary)
    side = predefined.markerSize + 2
    if _HAS_CLASSES:
        return np.asarray(predefined.generateImageMarker(marker_id, side))
    return np.asarray(_aruco.drawMarker(predefined, marker_id, side))


def detect_markers(grey: NDArray[np.uint8], dictionary: str) -> tuple[Array, Ints]:
    """Return the corners (M, 4, 2) px, clockwise from the top left, and the ids (M,)."""
    predefined = _dictionary(dictionary)
    if _HAS_CLASSES:
        detector = _aruco.ArucoDetector(predefined, _aruco.DetectorParameters())
        corners, ids, _ = detector.detectMarkers(grey)
    else:
        parameters = _aruco.DetectorParameters_create()
        corners, ids, _ = _aruco.detectMarkers(grey, predefined, parameters=parameters)
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
            f'dictionary: expected an OpenCV with markers (4.7 or later, or with contrib), '
            f'got {cv2.__version__} without'
        )
    if name not in dictionary_names():
        near = difflib.get_close_matches(name, dictionary_names(), n=1)
        hint = f' (did you mean {near[0]}?)' if near else ''
        raise ValueError(f'dictionary: expected a dictionary of OpenCV, got {name!r}{hint}')
    return _aruco.getPredefinedDictionary(getattr(_aruco, name))


@lru_cache(maxsize=32)
def _is_upside_down(name: str) -> bool:
    # OpenCV up to 5.0.0 has the AprilTag families rotated by half a turn relative to AprilTag's
    # own images (opencv/opencv#28823). Tag 0 of 36h11 tests for this: its code begins with 110101.
    if not name.upper().startswith('DICT_APRILTAG_'):
        return False
    first_row = _marker_image('DICT_APRILTAG_36h11', 0)[1, 1:-1] > 127
    return bool(first_row.tolist() != [True, True, False, True, False, True])
