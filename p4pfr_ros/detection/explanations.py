# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""
Why an image seems to show a board, and none of its markers is accepted.

OpenCV reports a quadrilateral as empty if its border or its colours are not as expected. Here each
is read again, with other borders and with colours exchanged: a wrong key of the board file is the
most frequent reason.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from p4pfr_ros.boards import Charuco, MarkerBoard
from p4pfr_ros.core.geometry import Array, Mask
from p4pfr_ros.detection.aruco import code_cells, marker_cells
from p4pfr_ros.detection.candidates import (
    best_widths,
    BoardMarkers,
    BORDERS,
    cells_text,
    polarity_reason,
    summary,
    wrong_border,
)
from p4pfr_ros.detection.cells import cell_levels, dark_sides, relative_levels

# Only the largest candidates are read, and only if they can be, in pixels per cell.
_MAX_READ = 100
_MIN_CELL_PX = 2.0
_MIN_CONTRAST = 20.0  # grey levels
# Cells of the border and of the code that may be misread, as shares of their number.
_MISREAD_IN_BORDER, _MISREAD_IN_CODE = 0.1, 0.05


def explained(
    grey: NDArray[np.uint8], board: Charuco | MarkerBoard, markers: BoardMarkers
) -> BoardMarkers:
    """Return the markers; if there are none, with the key of the board that is wrong."""
    if len(markers.indices) or markers.repeated or not markers.rejected:
        return markers
    quads = np.array([candidate.outline for candidate in markers.rejected])
    reasons: dict[int, str] = {}
    for bits in BORDERS:
        for code in _codes_in(grey, board, quads, bits):
            reason = _reason(grey, board, code)
            if reason:
                reasons.setdefault(code.index, reason)
    if not reasons:
        return markers
    first = [replace(markers.rejected[n], reason=reason) for n, reason in reasons.items()]
    others = [each for n, each in enumerate(markers.rejected) if n not in reasons]
    return replace(markers, reason=summary([], first), rejected=(*first, *others))


@dataclass(frozen=True, slots=True, eq=False)
class _Code:
    """A code of the board: index of the quad, its corners (4, 2) in the marker's order, id."""

    index: int
    corners: Array
    marker_id: int
    inverted: bool


def _reason(grey: NDArray[np.uint8], board: Charuco | MarkerBoard, code: _Code) -> str:
    reason = polarity_reason(board, code.marker_id, code.inverted)
    if reason:
        return reason
    at = code.corners[None], np.array([code.marker_id])
    relative, _ = relative_levels(grey, board.dictionary, *at, board.border_bits)
    width = int(best_widths(grey, board, *at, relative)[0])
    if width == board.border_bits:
        # The quad may lie within the border.
        dark = (dark_sides(relative)[0] >= 3).tolist()
        width += dark.index(False) if False in dark else 0
    if width == board.border_bits:
        return ''
    return wrong_border(board, code.marker_id, cells_text(width))


def _codes_in(
    grey: NDArray[np.uint8], board: Charuco | MarkerBoard, quads: Array, bits: int
) -> Iterator[_Code]:
    """Yield the codes of the board within a border of ``bits`` in quads (Q, 4, 2)."""
    size = code_cells(board.dictionary)
    n = size + 2 * bits
    perimeter_px = np.linalg.norm(np.roll(quads, -1, axis=1) - quads, axis=2).sum(axis=1)
    order = np.argsort(-perimeter_px)[:_MAX_READ]
    order = order[perimeter_px[order] > 4.0 * _MIN_CELL_PX * n]
    if not len(order):
        return
    levels = cell_levels(grey, quads[order], n, 0)
    low, high = levels.min(axis=(1, 2)), levels.max(axis=(1, 2))
    bright = levels > 0.5 * (low + high)[:, None, None]
    border = np.ones((n, n), dtype=bool)
    border[bits:-bits, bits:-bits] = False
    in_border = bright[:, border].mean(axis=1)
    inverted = in_border > 0.5
    uniform = np.minimum(in_border, 1.0 - in_border) <= _MISREAD_IN_BORDER
    codes = bright[:, bits:-bits, bits:-bits] ^ inverted[:, None, None]
    known = _codes_of(board, size)
    for m in np.flatnonzero(uniform & (high - low > _MIN_CONTRAST)).tolist():
        misread = (codes[m].ravel() != known).sum(axis=1)
        best = int(misread.argmin())
        if misread[best] <= _MISREAD_IN_CODE * size * size:
            # Turned counter-clockwise by n quarters, its top left corner is the n-th from the end.
            corners = np.roll(quads[order[m]], best % 4, axis=0)
            yield _Code(int(order[m]), corners, board.marker_ids[best // 4], bool(inverted[m]))


def _codes_of(board: Charuco | MarkerBoard, size: int) -> Mask:
    """Return the codes of the board's markers in each orientation, (4 M, size²), True: white."""
    turned = [
        np.rot90(~marker_cells(board.dictionary, marker_id)[1:-1, 1:-1], turns).ravel()
        for marker_id in board.marker_ids
        for turns in range(4)
    ]
    return np.array(turned).reshape(-1, size * size)
