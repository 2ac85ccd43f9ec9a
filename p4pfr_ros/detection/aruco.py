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
from p4pfr_ros.boards import AprilGrid, Board, Bundle, Charuco, Marker, MarkerGrid
from p4pfr_ros.core.geometry import Array, Ints, Mask

# OpenCV's type stubs cover the classes only. OpenCV 4.6 without contrib has no such module.
_aruco: Any = getattr(cv2, 'aruco', None)
_HAS_CLASSES = hasattr(_aruco, 'ArucoDetector')
# OpenCV drops outlines that touch the border of the image. Since 4.12 it does so after it has
# grouped each marker with the outlines around it: a sheet of paper that touches the border, of a
# search window for instance, takes its marker along.
_DROPS_GROUPS = tuple(int(part) for part in cv2.__version__.split('.')[:2]) >= (4, 12)

# Side of the smallest markers that are searched, pixels. OpenCV's own limit is a share of the
# image, which loses small markers in large images.
MIN_MARKER_PX = 14.0
# Smaller ones are searched in the image at twice its size, which takes four times as long.
_MAGNIFY_BELOW_PX = 12.0
# Perimeter of a tilted marker, in lengths of its side.
_LEAST_PERIMETER = 2.2
# A marker whose corner is nearer to the border of the image may be cut by it.
_MIN_TO_BORDER_PX = 3.0
# An image with so many cells shows a pattern: areas that are dark or bright, of at least this
# width, and fill this share of their bounding box. Photographs have up to 220 areas, a ChArUco
# board of 20x14 squares 240, noise thousands that are no cells.
_CELLS, _LEAST_CELL_PX, _FILLED_BY_CELL = 1000, 5, 0.6
_MARKER_IN_CELLS = 2.0

# The key to name in the error when the dictionary lacks an id of the board. A ChArUco board that
# begins with id 0 has too many squares.
_ID_KEYS: dict[type[Any], str] = {
    Marker: 'id',
    MarkerGrid: 'first_id',
    AprilGrid: 'first_id',
    Charuco: 'first_id',
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
        key = _ID_KEYS[type(board)]
        if isinstance(board, Charuco) and board.first_id == 0:
            key = 'columns'
        raise ValueError(
            f'{key}: expected ids up to {last_id}, the last of '
            f'{board.dictionary}, got {max(board.marker_ids)}'  # type: ignore[union-attr]
        )


@lru_cache(maxsize=4096)
def marker_cells(dictionary: str, marker_id: int, border_bits: int = 1) -> NDArray[np.bool_]:
    """
    Return a marker's cells, (n, n) from the top left, True where black, border included.

    The array is read-only.
    """
    black = _marker_image(dictionary, marker_id) < 128
    if _is_upside_down(dictionary):
        black = np.rot90(black, 2)
    cells = np.pad(black, border_bits - 1, constant_values=True)
    cells.flags.writeable = False  # shared through the cache
    return cells


def dictionary_size(name: str) -> int:
    """Return the number of markers in a dictionary."""
    return len(_dictionary(name).bytesList)


def code_cells(dictionary: str) -> int:
    """Return the number of cells per side of a marker, without its border."""
    return int(_dictionary(dictionary).markerSize)


def _marker_image(dictionary: str, marker_id: int) -> NDArray[np.uint8]:
    """Return the image of a marker as OpenCV draws it, one pixel per cell."""
    predefined = _dictionary(dictionary)
    side = predefined.markerSize + 2
    if _HAS_CLASSES:
        return np.asarray(predefined.generateImageMarker(marker_id, side))
    return np.asarray(_aruco.drawMarker(predefined, marker_id, side))


def detect_markers(
    grey: NDArray[np.uint8],
    dictionary: str,
    border_bits: int = 1,
    *,
    ids: tuple[int, ...] = (),
    with_inverted: bool = False,
    min_marker_px: float = MIN_MARKER_PX,
) -> tuple[Array, Ints, Array]:
    """
    Detect markers of a dictionary.

    Parameters
    ----------
    grey : (h, w) array
        The image.
    dictionary
        Name of the dictionary.
    border_bits
        Width of the markers' black border, cells.
    ids
        Detect these only; without any, all. OpenCV compares each quadrilateral with each code,
        which takes most of its time where a dictionary is large and an image cluttered.
    with_inverted
        Also detect markers that are white on black.
    min_marker_px
        Side of the smallest markers, pixels; below 12 px, the search takes four times as long.

    Returns
    -------
    The corners (M, 4, 2) px, clockwise from the top left, the ids (M,), and the corners (Q, 4, 2)
    of the quadrilaterals that contain no code.

    """
    if min_marker_px < _MAGNIFY_BELOW_PX:
        corners, found, quads = detect_markers(
            cv2.resize(grey, None, fx=2.0, fy=2.0, interpolation=cv2.INTER_CUBIC),
            dictionary,
            border_bits,
            ids=ids,
            with_inverted=with_inverted,
            min_marker_px=max(2.0 * min_marker_px, _MAGNIFY_BELOW_PX),
        )
        return 0.5 * (corners + 0.5) - 0.5, found, 0.5 * (quads + 0.5) - 0.5
    codes = _part_of_dictionary(dictionary, ids) if ids else _dictionary(dictionary)
    parameters = _parameters()
    least_px = max(min_marker_px, _least_side_px(grey))
    parameters.minMarkerPerimeterRate = _LEAST_PERIMETER * least_px / max(grey.shape)
    parameters.markerBorderBits = border_bits
    parameters.detectInvertedMarker = with_inverted
    corners, found, quads = _searched(grey, codes, parameters)
    without_code = np.asarray(quads, dtype=np.float64).reshape(-1, 4, 2)
    without_code = without_code[_are_off_border(without_code, grey.shape)]
    if found is None or len(found) == 0:
        return np.empty((0, 4, 2)), np.empty(0, dtype=np.int64), without_code
    stacked = np.asarray(corners, dtype=np.float64).reshape(-1, 4, 2)
    if _is_upside_down(dictionary):
        stacked = np.roll(stacked, -2, axis=1)
    found = np.asarray(found, dtype=np.int64).ravel()
    found = np.array(ids, dtype=np.int64)[found] if ids else found
    off_border = _are_off_border(stacked, grey.shape)
    return stacked[off_border], found[off_border], without_code


def _searched(grey: NDArray[np.uint8], codes: Any, parameters: Any) -> Any:
    """Return OpenCV's corners, ids and quadrilaterals."""
    if _HAS_CLASSES:
        return _aruco.ArucoDetector(codes, parameters).detectMarkers(grey)
    return _aruco.detectMarkers(grey, codes, parameters=parameters)


def _least_side_px(grey: NDArray[np.uint8]) -> float:
    """
    Return from which size on markers are searched in an image that shows a pattern, or 0.

    OpenCV compares all quadrilaterals with each other: tiles, a fence or a keyboard cost seconds,
    of a large image a minute. Markers are larger than the cells of such a pattern.
    """
    if grey.size < _CELLS * _LEAST_CELL_PX**2:
        return 0.0
    small = cv2.resize(grey, None, fx=0.25, fy=0.25, interpolation=cv2.INTER_AREA)
    if max(cv2.connectedComponents(part, connectivity=4)[0] for part in _parts(small)) < _CELLS:
        return 0.0
    for part in _parts(grey):
        _, _, boxes, _ = cv2.connectedComponentsWithStats(part, connectivity=4)
        width, height, area = boxes[:, 2], boxes[:, 3], boxes[:, 4]
        is_cell = (np.minimum(width, height) >= _LEAST_CELL_PX) & (
            area > _FILLED_BY_CELL * width * height
        )
        if np.count_nonzero(is_cell) >= _CELLS:
            return _MARKER_IN_CELLS * float(np.median(np.maximum(width, height)[is_cell]))
    return 0.0


def _parts(grey: NDArray[np.uint8]) -> tuple[NDArray[Any], NDArray[Any]]:
    """Return the masks (h, w) of what is dark among its surroundings, and of the rest."""
    dark = cv2.adaptiveThreshold(
        grey, 255, cv2.ADAPTIVE_THRESH_MEAN_C, cv2.THRESH_BINARY_INV, 7, 4.0
    )
    return np.asarray(dark), np.asarray(255 - dark)


def _are_off_border(quads: Array, shape: tuple[int, ...]) -> Mask:
    """Return which quads (M, 4, 2) px have no corner at the border of an image (h, w)."""
    last = np.array(shape[::-1]) - 1.0
    inside = (quads >= _MIN_TO_BORDER_PX) & (quads <= last - _MIN_TO_BORDER_PX)
    return np.asarray(inside.all(axis=(1, 2)))


@lru_cache(maxsize=32)
def _part_of_dictionary(name: str, ids: tuple[int, ...]) -> Any:
    """Return a dictionary with these markers only, numbered from 0."""
    whole = _dictionary(name)
    codes = np.ascontiguousarray(whole.bytesList[list(ids)])
    if _HAS_CLASSES:
        return _aruco.Dictionary(codes, whole.markerSize, whole.maxCorrectionBits)
    part = _aruco.getPredefinedDictionary(getattr(_aruco, name))
    part.bytesList = codes
    return part


def _parameters() -> Any:
    if not _HAS_CLASSES:
        return _aruco.DetectorParameters_create()
    parameters = _aruco.DetectorParameters()
    if _DROPS_GROUPS:
        parameters.minDistanceToBorder = 0
    return parameters


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
