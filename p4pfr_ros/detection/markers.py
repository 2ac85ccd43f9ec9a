# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""
Detection of boards made of markers: single markers, grids and bundles.

This module stands alone, as each finder of a family of boards does.
"""

from __future__ import annotations

from dataclasses import replace

import cv2
import numpy as np
from numpy.typing import NDArray
from p4pfr_ros.boards import MarkerBoard
from p4pfr_ros.core.geometry import Array, Ints
from p4pfr_ros.detection.aruco import code_cells
from p4pfr_ros.detection.candidates import (
    are_legible,
    BoardMarkers,
    find_board_markers,
    rechecked,
)
from p4pfr_ros.detection.cells import levels_in, pixels_of
from p4pfr_ros.detection.marker_edges import refine_markers

# Profiles across each side of a marker, where they begin and end, and their steps.
_PROFILES = 9
# Markers whose corners predict the place of another one.
_NEIGHBOURS = 4
_REACH_IN_CELLS, _STEP_IN_CELLS = (-0.5, 1.25), 0.1


def find_markers(grey: NDArray[np.uint8], board: MarkerBoard) -> tuple[Ints, Array, BoardMarkers]:
    """
    Find a board's markers in an image (h, w).

    Returns
    -------
    Ids (N,) (indices in the board's points), corners (N, 2) px, and the markers with what was
    rejected.

    """
    markers = find_board_markers(grey, board)
    cells = code_cells(board.dictionary) + 2 * board.border_bits
    refined = np.empty_like(markers.corners)
    for chosen, image in ((~markers.inverted, grey), (markers.inverted, 255 - grey)):
        if chosen.any():
            refined[chosen] = _refined(image, markers.corners[chosen], cells)
    markers = rechecked(grey, board, markers, refined)
    if 0 < len(markers.indices) < len(board.marker_ids):
        markers = _completed(grey, board, markers, cells)
    ids = 4 * markers.indices[:, None] + np.arange(4)
    return ids.ravel(), markers.corners.reshape(-1, 2), markers


def _completed(
    grey: NDArray[np.uint8], board: MarkerBoard, markers: BoardMarkers, cells: int
) -> BoardMarkers:
    """
    Look for the other markers where the board has them; return all.

    OpenCV finds a marker only if its outline is a closed curve, which neighbours that touch it,
    blur and glare prevent. Its place follows from the markers around it, and its code is read.
    """
    found = dict(zip(markers.indices.tolist(), markers.corners, strict=True))
    image = 255 - grey if markers.inverted.all() else grey
    size = np.array(grey.shape[::-1])
    left = [
        n for n, i in enumerate(board.marker_ids) if n not in found and i not in markers.repeated
    ]
    while left:
        predicted = np.array([_predicted(board, found, n) for n in left])
        visible = ((predicted >= 0.0) & (predicted <= size - 1.0)).all(axis=(1, 2))
        tried, quads = np.array(left)[visible], predicted[visible]
        if not len(tried):
            break
        legible = are_legible(grey, board, quads, tried)
        tried, quads = tried[legible], quads[legible]
        refined = _refined(image, quads, cells)
        fitted = (refined != quads).any(axis=(1, 2))
        new = dict(zip(tried[fitted].tolist(), refined[fitted], strict=True))
        if not new:
            break
        found |= new
        left = [n for n in left if n not in new]
    order = sorted(found)
    return replace(
        markers,
        corners=np.array([found[n] for n in order]),
        indices=np.array(order, dtype=np.int64),
        inverted=np.full(len(order), markers.inverted.all()),
    )


def _predicted(board: MarkerBoard, found: dict[int, Array], index: int) -> Array:
    """Return the corners (4, 2) px of a marker as the nearest found markers suggest."""
    on_board = board.marker_corners
    known = np.array(list(found))
    distance = np.linalg.norm(on_board[known].mean(axis=1) - on_board[index].mean(axis=0), axis=1)
    nearest = known[np.argsort(distance)[:_NEIGHBOURS]]
    homography, _ = cv2.findHomography(
        on_board[nearest].reshape(-1, 2), np.concatenate([found[n] for n in nearest.tolist()])
    )
    if homography is None:
        return np.full((4, 2), -1.0)
    return np.asarray(cv2.perspectiveTransform(on_board[index][:, None], homography)[:, 0])


def _refined(grey: NDArray[np.uint8], corners: Array, cells: int) -> Array:
    """Refine the corners (M, 4, 2) of markers; a marker that cannot be refined keeps its own."""
    refined = refine_markers(grey, corners, cells)
    # Squares that touch the corners of a marker, as in Kalibr's grid, pull OpenCV's outline into
    # its border by a few pixels.
    kept = (refined == corners).all(axis=(1, 2))
    if kept.any():
        start = _moved_to_edges(grey, corners[kept], cells)
        again = refine_markers(grey, start, cells)
        fitted = (again != start).any(axis=(1, 2))
        refined[kept] = np.where(fitted[:, None, None], again, corners[kept])
    return refined


def _moved_to_edges(grey: NDArray[np.uint8], corners: Array, cells: int) -> Array:
    """Move the sides of quads (M, 4, 2) within black borders to the step from black to white."""
    along = np.linspace(0.2, 0.8, _PROFILES)
    outwards = np.arange(*_REACH_IN_CELLS, _STEP_IN_CELLS)
    u, v = np.meshgrid(along, -outwards / cells)
    sides = []
    for turn in range(4):
        quads = np.roll(corners, -turn, axis=1)  # the side of interest is the first
        profile = np.median(levels_in(grey, quads, np.stack([u, v], axis=-1)), axis=2)
        middle = 0.5 * (profile.min(axis=1) + profile.max(axis=1))
        bright = profile > middle[:, None]
        sides.append(outwards[bright.argmax(axis=1)] - 0.5 * _STEP_IN_CELLS)
    top, right, bottom, left = np.array(sides) / cells
    places = [
        (-left, -top),
        (1.0 + right, -top),
        (1.0 + right, 1.0 + bottom),
        (-left, 1.0 + bottom),
    ]
    return pixels_of(corners, np.stack([np.stack(place, axis=1) for place in places], axis=1))
