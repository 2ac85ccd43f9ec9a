# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""
Why an image seems to show a board, and none of its markers is accepted.

OpenCV reports a quadrilateral as empty if its border or its colours are not as expected, or if its
code is not the board's. Here each is read again, with other borders, with colours exchanged, and
compared with the whole dictionary: a wrong key of the board file is the most frequent reason.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import lru_cache
from itertools import compress

import cv2
import numpy as np
from numpy.typing import NDArray
from p4pfr_ros.boards import Charuco, MarkerBoard
from p4pfr_ros.core.geometry import Array
from p4pfr_ros.detection.aruco import code_cells, dictionary_size, marker_cells
from p4pfr_ros.detection.candidates import (
    BoardMarkers,
    BORDERS,
    cells_text,
    NO_CODE,
    NOT_ON_BOARD,
    polarity_reason,
    RejectedCandidate,
    summary,
    wrong_border,
)
from p4pfr_ros.detection.cells import cell_levels, dark_sides, levels_in, relative_levels

# Only the largest candidates are read, and only if they can be, in pixels per cell.
_MAX_READ = 100
_MIN_CELL_PX = 2.0
_MIN_CONTRAST = 20.0  # grey levels
# Rows and columns inside a candidate that are looked at first, in its width, and the share of the
# samples of its frame that may differ: few, so more than of the cells.
_LOOKED_AT = (0.2, 0.35, 0.45, 0.55, 0.65, 0.8)
_MISREAD_IN_FRAME = 0.15
# Cells of the border and of the code that may be misread, as shares of their number.
# The codes of all dictionaries but ARUCO_ORIGINAL differ by more than twice as many cells.
_MISREAD_IN_BORDER, _MISREAD_IN_CODE = 0.1, 0.05
# A cell is read at so many places in a row of it, and another width of the border is better if its
# mean square of misfits is that much smaller.
_SAMPLES_PER_CELL, _CLEARER = 3, 0.9
# The largest quadrilaterals, so many, may be sheets with a marker: each is resampled to so many
# pixels a side, and a marker covers these shares of its area.
_MAX_SHEETS, _SHEET_PX = 8, 96
_LEAST_OF_SHEET, _MOST_OF_SHEET = 0.15, 0.95
# A polygon approximates an outline that is no farther from it, as a share of its length.
_POLYGON_TOLERANCE = 0.04
# Quadrilaterals are the same if their corners are closer, as a share of the perimeter.
_SAME = 0.03


def explained(
    grey: NDArray[np.uint8], board: Charuco | MarkerBoard, markers: BoardMarkers
) -> BoardMarkers:
    """Return the markers; if there are none, with the key of the board that is wrong."""
    if len(markers.indices) or markers.repeated or not markers.rejected:
        return markers
    large = sorted(markers.rejected, key=_minus_perimeter_px)[:_MAX_READ]
    has_contrast, has_frame = _looked_at(grey, board.dictionary, large)
    within = _on_sheets(grey, list(compress(large, has_contrast)), large)
    candidates = list(compress(large, has_frame))
    if within:
        candidates += compress(within, _looked_at(grey, board.dictionary, within)[1])
    if not candidates:
        return markers
    quads = np.array([candidate.outline for candidate in candidates])
    wrong_keys: dict[int, str] = {}
    others: dict[int, str] = {}
    for bits in sorted({*BORDERS, board.border_bits}):
        for code in _codes_in(grey, board, quads, bits):
            if code.marker_id in board.marker_ids:
                reason = _reason(grey, board, code)
                if reason:
                    wrong_keys.setdefault(code.index, reason)
            elif candidates[code.index].reason == NO_CODE:
                others.setdefault(code.index, f'marker {code.marker_id}: {NOT_ON_BOARD}')
    reasons = wrong_keys | {n: each for n, each in others.items() if n not in wrong_keys}
    first = [replace(candidates[n], reason=reason) for n, reason in reasons.items()]
    replaced = {id(candidates[n]) for n in reasons}
    left = [each for each in markers.rejected if id(each) not in replaced]
    return replace(
        markers,
        reason=summary([], first[: len(wrong_keys)]) or markers.reason,
        rejected=(*first, *left),
    )


def _looked_at(
    grey: NDArray[np.uint8], dictionary: str, candidates: list[RejectedCandidate]
) -> tuple[list[bool], list[bool]]:
    """
    Return which candidates are not of one colour, and which of these have a frame of one colour.

    In images without markers few have, and reading is over: squares of a chessboard have none.
    """
    quads = np.array([candidate.outline for candidate in candidates])
    # Outer cells of a border of 1 are within wider ones, too.
    depth = 0.5 / (code_cells(dictionary) + 2)
    at = np.array([depth, *_LOOKED_AT, 1.0 - depth])
    levels = levels_in(grey, quads, np.stack(np.meshgrid(at, at), axis=-1))
    low, high = levels.min(axis=(1, 2)), levels.max(axis=(1, 2))
    inner = levels[:, 1:-1, 1:-1]
    has_contrast = np.ptp(inner, axis=(1, 2)) > _MIN_CONTRAST
    bright = levels > 0.5 * (low + high)[:, None, None]
    frame = np.ones(bright.shape[1:], dtype=bool)
    frame[1:-1, 1:-1] = False
    in_frame = bright[:, frame].mean(axis=1)
    has_frame = has_contrast & (np.minimum(in_frame, 1.0 - in_frame) <= _MISREAD_IN_FRAME)
    return has_contrast.tolist(), has_frame.tolist()


def _on_sheets(
    grey: NDArray[np.uint8], sheets: list[RejectedCandidate], known: list[RejectedCandidate]
) -> list[RejectedCandidate]:
    """
    Return quadrilaterals that are large within the first sheets, and are not known.

    Of a marker and the outline of its sheet, which are near each other, OpenCV reports only the
    outer one if it finds no code in either.
    """
    outlines = np.array([each.outline for each in known])
    found: list[RejectedCandidate] = []
    without_code = [each for each in sheets if each.reason == NO_CODE]
    for sheet in without_code[:_MAX_SHEETS]:
        for inner in _quads_within(grey, sheet.outline):
            # From each corner to the nearest one of each outline; they may begin anywhere.
            apart_px = np.linalg.norm(outlines[:, None] - inner[:, None], axis=3).min(axis=2)
            if apart_px.max(axis=1).min() > _SAME * _perimeters_px(inner[None])[0]:
                outlines = np.concatenate([outlines, inner[None]])
                found.append(RejectedCandidate(inner, NO_CODE))
    return found


def _quads_within(grey: NDArray[np.uint8], sheet: Array) -> Array:
    """Return the large quads (Q, 4, 2) px within a sheet (4, 2) px, clockwise."""
    side = _SHEET_PX
    square = np.array([[0, 0], [side, 0], [side, side], [0, side]], dtype=np.float32) - 0.5
    homography = cv2.getPerspectiveTransform(square, sheet.astype(np.float32))
    flags = cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP
    flat = cv2.warpPerspective(grey, homography, (side, side), None, flags, cv2.BORDER_REPLICATE)
    _, binary = cv2.threshold(flat, 0, 255, cv2.THRESH_BINARY | cv2.THRESH_OTSU)
    contours, _ = cv2.findContours(binary, cv2.RETR_LIST, cv2.CHAIN_APPROX_SIMPLE)
    found = []
    for contour in contours:
        share = cv2.contourArea(contour) / side**2
        if _LEAST_OF_SHEET < share < _MOST_OF_SHEET:
            length_px = cv2.arcLength(contour, True)
            polygon = cv2.approxPolyDP(contour, _POLYGON_TOLERANCE * length_px, True)[:, 0]
            if len(polygon) == 4 and cv2.isContourConvex(polygon):
                is_clockwise = cv2.contourArea(polygon, True) > 0.0
                found.append(polygon if is_clockwise else polygon[::-1])
    if not found:
        return np.empty((0, 4, 2))
    return np.asarray(cv2.perspectiveTransform(np.array(found, dtype=np.float64), homography))


def _minus_perimeter_px(candidate: RejectedCandidate) -> float:
    return -cv2.arcLength(candidate.outline.astype(np.float32), True)


def _perimeters_px(quads: Array) -> Array:
    """Return the perimeters (Q,) px of quads (Q, 4, 2)."""
    perimeters_px: Array = np.linalg.norm(np.roll(quads, -1, axis=1) - quads, axis=2).sum(axis=1)
    return perimeters_px


@dataclass(frozen=True, slots=True, eq=False)
class _Code:
    """A code that was read: index of the quad, its corners (4, 2) in the marker's order, id."""

    index: int
    corners: Array
    marker_id: int
    inverted: bool


def _reason(grey: NDArray[np.uint8], board: Charuco | MarkerBoard, code: _Code) -> str:
    reason = polarity_reason(board, code.marker_id, code.inverted)
    if reason:
        return reason
    width = _clearest_width(grey, board, code)
    if width == board.border_bits:
        at = code.corners[None], np.array([code.marker_id])
        relative, _ = relative_levels(grey, board.dictionary, *at, board.border_bits)
        # The quad may lie within the border.
        dark = (dark_sides(relative)[0] >= 3).tolist()
        width += dark.index(False) if False in dark else 0
    if width == board.border_bits:
        return ''
    return wrong_border(board, code.marker_id, cells_text(width))


def _clearest_width(grey: NDArray[np.uint8], board: Charuco | MarkerBoard, code: _Code) -> int:
    """Return the width of the border with which the whole area of the cells is read best."""
    # Widths of 2 and 3 cells place the centres of a small code's cells within the same cells.
    least, best = np.inf, board.border_bits
    for bits in (board.border_bits, *BORDERS):
        black = marker_cells(board.dictionary, code.marker_id, bits) ^ code.inverted
        white = ~black.repeat(_SAMPLES_PER_CELL, 0).repeat(_SAMPLES_PER_CELL, 1)
        levels = cell_levels(grey, code.corners[None], len(white), 0)[0]
        # Relative to the best fit of two levels to black and white.
        dark, bright = levels[~white].mean(), levels[white].mean()
        misfit = np.mean((levels - np.where(white, bright, dark)) ** 2)
        if misfit < _CLEARER * least:
            least, best = misfit, bits
    return best


def _codes_in(
    grey: NDArray[np.uint8], board: Charuco | MarkerBoard, quads: Array, bits: int
) -> Iterator[_Code]:
    """Yield the codes of the board's dictionary within a border of ``bits`` in quads (Q, 4, 2)."""
    size = code_cells(board.dictionary)
    n = size + 2 * bits
    large = np.flatnonzero(_perimeters_px(quads) > 4.0 * _MIN_CELL_PX * n)
    if not len(large):
        return
    levels = cell_levels(grey, quads[large], n, 0)
    low, high = levels.min(axis=(1, 2)), levels.max(axis=(1, 2))
    bright = levels > 0.5 * (low + high)[:, None, None]
    border = np.ones((n, n), dtype=bool)
    border[bits:-bits, bits:-bits] = False
    in_border = bright[:, border].mean(axis=1)
    inverted = in_border > 0.5
    uniform = np.minimum(in_border, 1.0 - in_border) <= _MISREAD_IN_BORDER
    read = np.flatnonzero(uniform & (high - low > _MIN_CONTRAST))
    if not len(read):
        return
    codes = bright[read, bits:-bits, bits:-bits] ^ inverted[read, None, None]
    # The sum over products of 1 and -1 is the number of equal cells less that of others.
    signs = np.where(codes.reshape(len(read), -1), np.float32(1.0), np.float32(-1.0))
    misread = 0.5 * (size * size - signs @ _signs_of(board.dictionary).T)
    # Of equal codes, which ARUCO_ORIGINAL has, the board's comes first.
    misread.reshape(len(read), -1, 4)[:, list(board.marker_ids)] -= 0.5
    best = misread.argmin(axis=1)
    good = misread[np.arange(len(read)), best] <= _MISREAD_IN_CODE * size * size
    for m, code in zip(read[good].tolist(), best[good].tolist(), strict=True):
        # Turned counter-clockwise by n quarters, its top left corner is the n-th from the end.
        corners = np.roll(quads[large[m]], code % 4, axis=0)
        yield _Code(int(large[m]), corners, code // 4, bool(inverted[m]))


@lru_cache(maxsize=8)
def _signs_of(dictionary: str) -> NDArray[np.float32]:
    """Return a dictionary's codes in each orientation, (4 M, size²): 1 where white, else -1."""
    white = ~np.array(
        [marker_cells(dictionary, n)[1:-1, 1:-1] for n in range(dictionary_size(dictionary))]
    )
    turned = np.stack([np.rot90(white, turns, axes=(1, 2)) for turns in range(4)], axis=1)
    signs = np.where(turned.reshape(4 * len(white), -1), np.float32(1.0), np.float32(-1.0))
    signs.flags.writeable = False  # shared through the cache
    return signs
