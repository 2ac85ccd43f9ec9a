# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""
Marker candidates: which of OpenCV's belong to a board, and why the others do not.

OpenCV reports a marker where the cells inside a quadrilateral spell a code. That also happens
where black and white are exchanged, and on the inner cells of a marker whose black border is
wider than expected: the quadrilateral then lies within the border. The cells around it tell.
"""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from p4pfr_ros.boards import Charuco, MarkerBoard
from p4pfr_ros.core.geometry import Array, Ints, Mask
from p4pfr_ros.detection.aruco import detect_markers
from p4pfr_ros.detection.cells import (
    dark_sides,
    expected_cells,
    relative_levels,
    RINGS,
)

# Borders that are tried.
BORDERS = (1, 2, 3)
# A marker whose cells are at most this far, in mean square, from black and white has no doubtful
# border; another width must be as much clearer.
_CLEAR, _MUCH_CLEARER = 0.02, 0.5
_MIN_CONTRAST = 20.0  # grey levels
# The reason of a quadrilateral that shows no code of the dictionary.
NO_CODE = 'no code'
NOT_ON_BOARD = 'not on the board'
# Cells of the border and of the code that may be misread, as shares of their number.
# Where a certain marker is expected, more may be: chance spells one code less often than any.
_MISREAD_IN_BORDER, _MISREAD_WHERE_EXPECTED = 0.1, 0.12


@dataclass(frozen=True, slots=True, eq=False)
class RejectedCandidate:
    """
    Something in an image that looked like a part of the board, and why it is not.

    Parameters
    ----------
    outline : (n, 2) array
        Its corners, pixels.
    reason
        A few words.

    """

    outline: Array
    reason: str


@dataclass(frozen=True, slots=True, eq=False)
class BoardMarkers:
    """
    The markers of a board that were found in an image.

    Parameters
    ----------
    corners : (M, 4, 2) array
        Pixels, clockwise from each marker's own top left.
    indices : (M,) array
        Indices in the board's ``marker_ids``, in ascending order.
    inverted : (M,) array
        Whether each is white on black.
    repeated
        The ids that were detected more than once.
    reason
        Why candidates are not among them, the most frequent cause; empty if there is none.
    rejected
        The candidates that are not among them.

    """

    corners: Array
    indices: Ints
    inverted: Mask
    repeated: tuple[int, ...]
    reason: str
    rejected: tuple[RejectedCandidate, ...]


def find_board_markers(
    grey: NDArray[np.uint8], board: Charuco | MarkerBoard, min_marker_px: float
) -> BoardMarkers:
    """
    Find a board's markers in an image (h, w).

    An id that is detected more than once is ambiguous and left out; two such ids mean two boards,
    and nothing is reported, because every other marker may belong to either.

    The borders of a board whose marker corners will be refined are not checked yet: `rechecked`
    does that at the refined corners.
    """
    # All squares of a ChArUco board have the same colours. If both are asked for at once, OpenCV
    # may report the inner outline of a wide border.
    one_by_one = isinstance(board, Charuco) and board.inverted == 'any'
    for with_inverted in (False, True) if one_by_one else (board.inverted is not False,):
        markers = _found(grey, board, min_marker_px, with_inverted=with_inverted)
        if len(markers.indices):
            break
    return markers


def _found(
    grey: NDArray[np.uint8],
    board: Charuco | MarkerBoard,
    min_marker_px: float,
    *,
    with_inverted: bool,
) -> BoardMarkers:
    """Find a board's markers of one colour or of both."""
    corners, ids, quads = detect_markers(
        grey,
        board.dictionary,
        board.border_bits,
        ids=board.marker_ids,
        with_inverted=with_inverted,
        min_marker_px=min_marker_px,
    )
    index_of = {marker_id: index for index, marker_id in enumerate(board.marker_ids)}
    if isinstance(board, Charuco) or board.inverted is not False:
        borders = isinstance(board, Charuco)
        inverted, reasons = _inspected(grey, board, corners, ids, borders=borders)
    else:
        inverted, reasons = np.zeros(len(ids), dtype=bool), [''] * len(ids)
    twice = _repeated(ids, reasons)
    accepted = np.array([not reason for reason in reasons], dtype=bool)
    # One repeated id may be a copy of a marker. Several are two boards. A board with most of its
    # borders too wide has no marker whose border is right.
    if len(twice) > 1 or _are_mostly_wide(reasons):
        accepted[:] = False
    wrong = [RejectedCandidate(*each) for each in zip(corners, reasons, strict=True) if each[1]]
    empty = (RejectedCandidate(quad, NO_CODE) for quad in quads)
    indices = np.array([index_of[marker_id] for marker_id in ids.tolist()], dtype=np.int64)
    order = np.flatnonzero(accepted)[np.argsort(indices[accepted], kind='stable')]
    return BoardMarkers(
        corners[order],
        indices[order],
        inverted[order],
        tuple(twice),
        summary(twice, wrong),
        (*wrong, *empty),
    )


def rechecked(
    grey: NDArray[np.uint8],
    board: MarkerBoard,
    markers: BoardMarkers,
    refined: Array,
    failures: list[str],
    *,
    doubtful: Mask,
) -> BoardMarkers:
    """
    Return the markers with refined corners, without those that read otherwise there.

    failures (M,) say why a marker could not be refined, where the refined corners are NaN; a
    wrong border is the better reason. doubtful (M,) are those that were not clearly read there.
    """
    all_ids = np.array(board.marker_ids)[markers.indices]
    corners = np.where(np.isfinite(refined), refined, markers.corners)
    reasons = [
        f'marker {marker_id}: {failure}' if failure else ''
        for marker_id, failure in zip(all_ids.tolist(), failures, strict=True)
    ]
    unclear = np.flatnonzero(doubtful)
    _, better = _inspected(grey, board, corners[unclear], all_ids[unclear], borders=True)
    for n, reason in zip(unclear.tolist(), better, strict=True):
        reasons[n] = reason or reasons[n]
    wrong = [RejectedCandidate(*each) for each in zip(corners, reasons, strict=True) if each[1]]
    accepted = np.array([not reason for reason in reasons], dtype=bool)
    if _are_mostly_wide(reasons):
        accepted[:] = False
    return replace(
        markers,
        corners=corners[accepted],
        indices=markers.indices[accepted],
        inverted=markers.inverted[accepted],
        reason=markers.reason or summary([], wrong),
        rejected=(*wrong, *markers.rejected),
    )


def _are_mostly_wide(reasons: list[str]) -> bool:
    """Return whether at least as many markers have a wrong border as have no reason."""
    wide = sum('border_bits' in reason for reason in reasons)
    return 0 < wide >= reasons.count('')


def _repeated(ids: Ints, reasons: list[str]) -> list[int]:
    """Return the ids that occur more than once among the markers without a reason; add theirs."""
    counts = Counter(n for n, reason in zip(ids.tolist(), reasons, strict=True) if not reason)
    twice = sorted(marker_id for marker_id, count in counts.items() if count > 1)
    for index, marker_id in enumerate(ids.tolist()):
        if not reasons[index] and marker_id in twice:
            reasons[index] = f'marker {marker_id}: detected more than once'
    return twice


def summary(twice: list[int], wrong: list[RejectedCandidate]) -> str:
    """Return the most frequent reason as a sentence; '' if nothing was rejected."""
    if len(twice) == 1:
        return f'marker {twice[0]} detected more than once: two equal boards in the image?'
    if twice:
        return (
            f'two equal boards in the image: {len(twice)} markers, {twice[0]} to {twice[-1]}, '
            'detected more than once'
        )
    if not wrong:
        return ''
    causes = Counter(each.reason.partition(': ')[2] for each in wrong)
    cause, count = causes.most_common(1)[0]
    first = next(each.reason for each in wrong if each.reason.endswith(cause))
    return first if count == 1 else f'{first} (and {count - 1} more like it)'


def _inspected(
    grey: NDArray[np.uint8],
    board: Charuco | MarkerBoard,
    corners: Array,
    ids: Ints,
    *,
    borders: bool,
) -> tuple[Mask, list[str]]:
    """Return whether each marker (M,) is inverted, and why it is rejected ('' if it is not)."""
    if not len(ids):
        return np.zeros(0, dtype=bool), []
    relative, contrast = relative_levels(grey, board.dictionary, corners, ids, board.border_bits)
    inverted = contrast < 0.0
    reasons = [
        polarity_reason(board, marker_id, is_inverted)
        for marker_id, is_inverted in zip(ids.tolist(), inverted.tolist(), strict=True)
    ]
    if borders:
        width = best_widths(grey, board, corners, ids, relative).tolist()
        dark = dark_sides(relative).tolist()
        for m, marker_id in enumerate(ids.tolist()):
            reasons[m] = reasons[m] or _border_reason(board, marker_id, width[m], dark[m])
    return inverted, reasons


def best_widths(
    grey: NDArray[np.uint8],
    board: Charuco | MarkerBoard,
    corners: Array,
    ids: Ints,
    relative: Array,
) -> Ints:
    """Return the width of the border (M,) with which each marker is read best, in cells."""
    # OpenCV tolerates misread cells, in the border too: enough to read a width that is not there.
    # Cells that are read at their boundaries are grey.
    least = _greyness(board, ids, relative, board.border_bits)
    best = np.full(len(ids), board.border_bits)
    doubtful = np.flatnonzero(least > _CLEAR)
    for bits in (*BORDERS, board.border_bits + 1) if len(doubtful) else ():
        chosen = corners[doubtful], ids[doubtful]
        levels, _ = relative_levels(grey, board.dictionary, *chosen, bits)
        greyness = _greyness(board, chosen[1], levels, bits)
        better = greyness < _MUCH_CLEARER * least[doubtful]
        best[doubtful[better]] = bits
        least[doubtful[better]] = greyness[better]
    return best


def _greyness(board: Charuco | MarkerBoard, ids: Ints, relative: Array, bits: int) -> Array:
    """Return the mean square (M,) by which cells differ from black and white as expected."""
    inside = relative[:, RINGS:-RINGS, RINGS:-RINGS]
    white = ~expected_cells(board.dictionary, ids, bits)
    greyness: Array = np.mean((inside - white) ** 2, axis=(1, 2))
    return greyness


def are_legible(
    grey: NDArray[np.uint8], board: MarkerBoard, corners: Array, indices: Ints
) -> Mask:
    """Return whether quads (M, 4, 2) show the markers with these indices on the board (M,)."""
    ids = np.array(board.marker_ids)[indices]
    bits = board.border_bits
    relative, contrast = relative_levels(grey, board.dictionary, corners, ids, bits)
    inside = relative[:, RINGS:-RINGS, RINGS:-RINGS]
    misread = (inside < 0.5) != expected_cells(board.dictionary, ids, bits)
    code = misread[:, bits:-bits, bits:-bits].mean(axis=(1, 2))
    legible: Mask = (
        (np.abs(contrast) > _MIN_CONTRAST)
        & (code <= _MISREAD_WHERE_EXPECTED)
        & (misread.mean(axis=(1, 2)) <= _MISREAD_IN_BORDER)
        & (dark_sides(relative)[:, 0] == 0)
    )
    if board.inverted != 'any':
        legible &= (contrast < 0.0) == board.inverted
    return legible


def polarity_reason(board: Charuco | MarkerBoard, marker_id: int, is_inverted: bool) -> str:
    """Return the reason if a marker has other colours than the board, else ''."""
    if board.inverted in ('any', is_inverted):
        return ''
    colours = 'white on black' if is_inverted else 'black on white'
    shown = str(board.inverted).lower()
    return f'marker {marker_id}: {colours}, but inverted is {shown}'


def _border_reason(
    board: Charuco | MarkerBoard, marker_id: int, width: int, dark: list[int]
) -> str:
    """Return the reason if a marker reads best with another width, or dark cells are around it."""
    if width != board.border_bits:
        return wrong_border(board, marker_id, cells_text(width))
    # Dark cells all around, and a bright ring further out. Dark cells without a bright ring are
    # a narrow margin on a dark wall: the fit of the edges decides.
    if dark[0] >= 3 and min(dark[1:]) <= 1:
        return wrong_border(board, marker_id, f'more than {cells_text(board.border_bits)}')
    return ''


def wrong_border(board: Charuco | MarkerBoard, marker_id: int, width: str) -> str:
    """Return the reason that names the border of a marker and that of the board."""
    return f'marker {marker_id}: a black border of {width}, but border_bits is {board.border_bits}'


def cells_text(count: int) -> str:
    """Return '1 cell', '2 cells', ..."""
    return f'{count} cell{"s" if count > 1 else ""}'
