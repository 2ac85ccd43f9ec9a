# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""
Detection of circle grids: a lattice of dark ellipses that has the board's columns and rows.

The board must end where the lattice ends, as a part of a larger grid looks like a board. Of the
turns that fit alike, the upright one is taken. Then the centres are measured.

This module stands alone, as each finder of a family of boards does.
"""

from __future__ import annotations

from typing import NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray
from p4pfr_ros.boards import CircleGrid
from p4pfr_ros.core.geometry import Array, Ints, Mask
from p4pfr_ros.detection.candidates import RejectedCandidate
from p4pfr_ros.detection.circle_centres import (
    LensMiddle,
    measure_centres,
    MeasuredGrid,
    share_of_circles,
)
from p4pfr_ros.detection.circle_lattice import circle_lattices
from p4pfr_ros.detection.ellipse_blobs import Blobs, find_blobs

# Smallest fraction of the circles that must be found; the others may be covered. On each side of
# the board at least half of them, or the board could lie one circle farther.
_MIN_FOUND_FRACTION = 0.75
_MIN_FOUND_ON_SIDE = 0.5
# A lattice begins with so many of the board's circles, in squares of four.
_MIN_IN_SQUARES = 0.25
# A second board of at least this fraction of the area makes it unclear which one is meant.
_MIN_AREA_OF_SECOND = 0.5
# What is named as visible instead has so many circles a side; of its circles and of those of the
# lattice at least this fraction.
_LEAST_SIDE, _MIN_FULL = 3, 0.9

_NOTHING = np.empty(0, dtype=np.int64), np.empty((0, 2))


def find_circle_grid(
    grey: NDArray[np.uint8], board: CircleGrid, lens: LensMiddle
) -> tuple[Ints, Array, str, tuple[RejectedCandidate, ...]]:
    """
    Find a grid's circles in an image (h, w), or a part of one; lens: the middle of the whole one.

    Of two grids the larger one is meant; of two about equally large ones, none.

    Returns
    -------
    Ids (N,) (indices in the board's points) and the images of the centres (N, 2) px, empty if the
    grid is not found; then also the reason, and the circles that were found. The reason names the
    size of a grid that is visible instead. Circles that cannot be measured, such as half covered
    ones, are left out.

    """
    name = f'{board.columns}x{board.rows} circles'
    points = len(board.points)
    blobs = find_blobs(grey, grey.size / points)
    at_least = max(4, int(np.ceil(_MIN_IN_SQUARES * points)))
    lattices = circle_lattices(blobs, 2.0 * board.nearest_m / board.diameter_m, at_least)
    grids = [_board_in_lattice(lattice, board, blobs) for lattice in lattices]
    candidates = [each for each in grids if each is not None]
    found = _distinct_grids(grey, board, candidates, lens)
    if len(found) == 1:
        return *found[0], '', ()
    if found:
        reason = f'{len(found)} grids of {name} found, of about the same size'
        return *_NOTHING, reason, _rejected(blobs, 'circle of one of several equal grids')
    count = len(blobs.middles)
    seen = f'{count} dark circles' if blobs.are_all else f'the {count} largest dark circles'
    reason = f'no grid of {name} found among {seen}'
    why = 'not a whole circle on white' if candidates else 'circle, but no grid'
    hint = '' if candidates else _hint(lattices, board)
    return *_NOTHING, reason + hint, _rejected(blobs, why)


def _hint(lattices: list[Ints], board: CircleGrid) -> str:
    """Return what the largest lattice (n, m) of circles shows instead of the board, if any."""
    if not lattices:
        return ''
    for asymmetric in (board.asymmetric, not board.asymmetric):
        size = (_asymmetric_size if asymmetric else _symmetric_size)(lattices[0] >= 0)
        if size is None:
            continue
        columns, rows = size
        if not asymmetric and (columns < rows) != (board.columns < board.rows):
            columns, rows = rows, columns
        if (asymmetric, columns, rows) == (board.asymmetric, board.columns, board.rows):
            continue
        layout = 'an asymmetric' if asymmetric else 'a symmetric'
        note = '' if asymmetric == board.asymmetric else f', in {layout} grid'
        return f': {columns}x{rows} circles are visible{note}'
    return ''


def _symmetric_size(is_found: Mask) -> tuple[int, int] | None:
    """Return the columns and rows of a symmetric grid that a lattice (n, m) is."""
    own = _without_ragged_sides(is_found, np.ones_like(is_found))
    return None if own is None else own.shape


def _asymmetric_size(is_found: Mask) -> tuple[int, int] | None:
    """Return the columns and rows of an asymmetric grid that a lattice (n, m) is."""
    first, second = np.argwhere(is_found).T
    for x, y in ((first - second, first + second), (first + second, second - first)):
        x, y = x - x.min(), y - y.min()
        turned = np.zeros((x.max() + 1, y.max() + 1), dtype=bool)
        turned[x, y] = True
        # Of the cells turned by an eighth of a turn, every second one.
        is_own = np.indices(turned.shape).sum(axis=0) % 2 == (x[0] + y[0]) % 2
        own = _without_ragged_sides(turned, is_own)
        # The first row begins, and each second one ends, at the side.
        if own is not None and own.shape[0] % 2 == 0 and (own[0, 0] or own[-1, -1]):
            return own.shape[0] // 2, own.shape[1]
    return None


def _without_ragged_sides(is_found: Mask, own: Mask) -> Mask | None:
    """
    Return a lattice's own cells without outer lines of which less than a half was found.

    is_found, own (n, m): where circles are, and where they should be. None: it has gaps, or less
    circles than a grid.
    """
    found, is_ragged = is_found, True
    while is_ragged:
        is_ragged = False
        for _ in range(4):  # each side in turn becomes the first line
            found, own = np.rot90(found), np.rot90(own)
            while len(found) and found[0].sum() < _MIN_FOUND_ON_SIDE * own[0].sum():
                found, own, is_ragged = found[1:], own[1:], True
    count = found.sum()
    if min(found.shape) < _LEAST_SIDE or count < _MIN_FULL * max(own.sum(), is_found.sum()):
        return None
    return own


def _rejected(blobs: Blobs, reason: str) -> tuple[RejectedCandidate, ...]:
    corners = 0.5 * np.array([(-1.0, -1.0), (1.0, -1.0), (1.0, 1.0), (-1.0, 1.0)])
    return tuple(
        RejectedCandidate(middle + diameter_px * corners, reason)
        for middle, diameter_px in zip(blobs.middles, blobs.diameters_px, strict=True)
    )


class _Candidate(NamedTuple):
    """Ids (n,) of a board's points and about where they are, (n, 2) px."""

    ids: Ints
    middles: Array

    def area_px2(self) -> float:
        """Return the area that the circles span."""
        return float(cv2.contourArea(cv2.convexHull(self.middles.astype(np.float32))))


def _distinct_grids(
    grey: NDArray[np.uint8], board: CircleGrid, candidates: list[_Candidate], lens: LensMiddle
) -> list[tuple[Ints, Array]]:
    """Return the ids and centres of the largest grid, and of others about as large."""
    found: list[tuple[Ints, Array]] = []
    least_px2 = 0.0
    for each in sorted(candidates, key=_Candidate.area_px2, reverse=True):
        if each.area_px2() < least_px2:
            break
        measured = measure_centres(grey, board, each.ids, each.middles, lens)
        if measured is not None and not _continues(grey, board, measured):
            least_px2 = max(least_px2, _MIN_AREA_OF_SECOND * each.area_px2())
            found.append((measured.ids, measured.centres))
    return found


def _continues(grey: NDArray[np.uint8], board: CircleGrid, grid: MeasuredGrid) -> bool:
    """Return whether circles that the search missed continue the grid at one of its sides."""
    for _, outside in _sides(board):
        steps = _steps(board, *outside) * (1.0, -1.0)
        points = board.points[0] + board.spacing_m * steps
        if share_of_circles(grey, board, points, grid) >= _MIN_FOUND_ON_SIDE:
            return True
    return False


def _steps(board: CircleGrid, row: Ints, column: Ints) -> Ints:
    """Return how many spacings (N, 2) to the right and down circles are from the first one."""
    x = 2 * column + row % 2 if board.asymmetric else column
    return np.column_stack([x, row])


def _cells(board: CircleGrid, row: Ints, column: Ints) -> Ints:
    """Return the cells (N, 2) of circles in the square lattice of nearest neighbours."""
    steps = _steps(board, row, column)
    if not board.asymmetric:
        return steps
    # The nearest neighbours are diagonal ones.
    x, y = steps.T
    return np.column_stack([x + y, y - x]) // 2


_Line = tuple[Ints, Ints]  # rows (n,) and columns (n,)


def _sides(board: CircleGrid) -> list[tuple[_Line, _Line]]:
    """
    Return for each side the rows and columns of the outermost circles, and those one step farther.

    The left and right sides of an asymmetric grid are two each, in its even and in its odd rows:
    turned by half a turn, it fits with one of them one circle off.
    """
    columns, rows = np.arange(board.columns), np.arange(board.rows)
    lines = [(np.full_like(columns, at), columns) for at in (0, -1, board.rows - 1, board.rows)]
    for own in (rows[::2], rows[1::2]) if board.asymmetric else (rows,):
        lines += [(own, np.full_like(own, at)) for at in (0, -1, board.columns - 1, board.columns)]
    return list(zip(lines[::2], lines[1::2], strict=True))


def _board_in_lattice(lattice: Ints, board: CircleGrid, blobs: Blobs) -> _Candidate | None:
    """Return the circles of a board in a lattice (n, m) of indices; None without one."""
    own = _cells(board, *np.divmod(np.arange(len(board.points)), board.columns))
    sides = [
        (_cells(board, *outermost), _cells(board, *outside))
        for outermost, outside in _sides(board)
    ]
    # Two lines on all sides for the cells beyond the board's.
    margin = int(np.ptp(own, axis=0).max()) + 3
    wider = np.pad(lattice, margin, constant_values=-1)
    fits = []
    for _ in range(4):  # quarter turns
        own = _turned(own)
        sides = [(_turned(outermost), _turned(outside)) for outermost, outside in sides]
        for corner in _places(wider >= 0, own, sides):
            members = wider[tuple((corner + own).T)]
            ids = np.flatnonzero(members >= 0)
            fits.append(_Candidate(ids, blobs.middles[members[ids]]))
    most = max((len(each.ids) for each in fits), default=0)
    alike = [each for each in fits if len(each.ids) == most]
    return max(alike, key=lambda each: _upward_px(each, board), default=None)


def _turned(cells: Ints) -> Ints:
    """Return cells (..., 2) turned by a quarter turn."""
    return np.stack([-cells[..., 1], cells[..., 0]], axis=-1)


def _places(is_found: Mask, own: Ints, sides: list[tuple[Ints, Ints]]) -> Ints:
    """Return where (K, 2) a board's cells are found in a lattice, which ends at its sides."""
    low = own.min(axis=0)
    template = np.zeros(own.max(axis=0) - low + 1, dtype=np.float32)
    template[tuple((own - low).T)] = 1.0
    count = cv2.filter2D(
        is_found.astype(np.float32),
        -1,
        template,
        anchor=(0, 0),
        borderType=cv2.BORDER_CONSTANT,
    )
    places: Ints = np.argwhere(count > _MIN_FOUND_FRACTION * len(own) - 0.1) - low
    for outermost, outside in sides:
        on_side, beyond = (_count_in(is_found, places, cells) for cells in (outermost, outside))
        # A single ellipse may lie there by chance, and be a half of a short line.
        good = on_side >= _MIN_FOUND_ON_SIDE * len(outermost)
        good &= beyond < max(_MIN_FOUND_ON_SIDE * len(outside), 2)
        places = places[good]
    return places


def _count_in(is_found: Mask, places: Ints, cells: Ints) -> Ints:
    """Return how many of some cells (n, 2) are found at each of some places (K, 2), (K,)."""
    at = places[:, None] + cells
    return np.asarray(is_found[at[..., 0], at[..., 1]].sum(axis=1))


def _upward_px(candidate: _Candidate, board: CircleGrid) -> float:
    """Return how far the board's y axis points up in the image: pixels, weighted by rows."""
    row = candidate.ids // board.columns
    return float(np.sum((row - row.mean()) * candidate.middles[:, 1]))
