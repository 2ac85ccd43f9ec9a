# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""
Detection of chessboards: corners from the lattice of saddles, ordered as printed, then refined.

This module stands alone, as each finder of a family of boards does.
"""

from __future__ import annotations

from collections.abc import Iterator

import cv2
import numpy as np
from numpy.typing import NDArray
from p4pfr_ros.boards import Chessboard
from p4pfr_ros.core.geometry import Array, Ints, Mask
from p4pfr_ros.detection.candidates import RejectedCandidate
from p4pfr_ros.detection.saddle_lattice import find_saddles, lattices
from p4pfr_ros.detection.saddles import refine_saddles

# The search begins in an image of at most this width or height. Larger ones follow, for small
# squares, and then one of half the size, for large or blurred squares.
_FIRST_SIDE_PX, _SMALLEST_SIDE_PX = 800, 120
# Number of saddles that are tried: so many per corner of the board, and some for the rest of the
# image; then, in an image with more, four times as many.
_SADDLES_PER_CORNER, _MORE_SADDLES = 3, 100
_FEW_AND_MANY = (1, 4)
_MOST_SADDLES = 4000
# Smallest fraction of the corners that must be saddles; the others may be covered. On each side of
# the board at least half of them, or the board could lie one square farther.
_MIN_FOUND_FRACTION = 0.75
_MIN_FOUND_ON_SIDE = 0.5
# Patches of neighbouring corners must not overlap, so the radius is below half a square.
_RADIUS_IN_SQUARES = 0.45
# Largest second difference of corners along a line, in squares. Measured: 0.16 on photographs, 0.6
# with the widest lens or a blurred board; 0.98 and more with a misplaced corner.
_MAX_SECOND_DIFFERENCE = 0.75
# Largest misfit of a corner: so much of its contrast, and of the board's median.
_LEAST_MISFIT, _MISFIT_IN_MEDIANS = 0.1, 3.0
# A board with a smaller fraction of its corners refined is a false positive.
_MIN_REFINED_FRACTION = 0.5

# A board has so many corners a side.
_LEAST_SIDE = 3

# A second board of at least this fraction of the area makes it unclear which one is meant.
_MIN_AREA_OF_SECOND = 0.5

_NOTHING = np.empty(0, dtype=np.int64), np.empty((0, 2))


def find_chessboard(
    grey: NDArray[np.uint8], board: Chessboard
) -> tuple[Ints, Array, str, tuple[RejectedCandidate, ...]]:
    """
    Find a chessboard's inner corners in an image (h, w).

    Of two boards the larger one is meant, such as the board itself in front of a screen that
    shows it; of two about equally large ones, none.

    Returns
    -------
    Ids (N,) (indices in the board's points) and corners (N, 2) px, empty if the board is not
    found, and then the reason and the candidates. The reason names the size of a board that is
    visible instead: columns and rows may be wrong in the board file. Corners that cannot be
    fitted, such as covered ones, are left out.

    """
    name = f'{board.columns}x{board.rows} chessboard'
    best = _NOTHING
    tried: list[Array] = []
    seen: list[Array] = []
    for grids in _search(grey, board.columns, board.rows, seen):
        found = _distinct_boards(grey, grids)
        if len(found) > 1:
            reason = f'{len(found)} {name}s found, of about the same size'
            return *_NOTHING, reason, _rejected(grids, 'one of several equal boards')
        tried += grids
        # Corners that are missing at this size of the image may be found at the next one.
        best = max(best, *found, key=lambda each: len(each[0])) if found else best
        if len(best[0]) == board.columns * board.rows:
            break
    if len(best[0]):
        return *best, '', ()
    hint, others = _hint(seen, board)
    return *best, f'no {name} found{hint}', (*others, *_rejected(tried, 'its corners do not fit'))


def _hint(
    lattices_seen: list[Array], board: Chessboard
) -> tuple[str, tuple[RejectedCandidate, ...]]:
    """Return what the largest lattice (n, m, 2) px shows instead of the board, and its outline."""
    grids = [_without_ragged_sides(lattice) for lattice in lattices_seen]
    grid = max(grids, key=lambda each: each.size, default=np.empty((0, 0, 2)))
    least, (n, m) = min(board.columns, board.rows) - 1, grid.shape[:2]
    is_board = min(n, m) >= max(least, _LEAST_SIDE) and is_smooth(grid)
    sides, expected = sorted((n, m)), sorted((board.columns, board.rows))
    if not is_board or sides == expected:
        return '', ()
    columns, rows = sides if board.columns < board.rows else sides[::-1]
    counted = [side + 1 for side in sides] == expected
    note = ' (columns and rows count inner corners, not squares)' if counted else ''
    outline = np.concatenate([np.rot90(grid, turns)[0, :-1] for turns in range(4)])
    outline = outline[np.isfinite(outline[:, 0])]
    size = f'{columns}x{rows} inner corners'
    return f': {size} are visible{note}', (RejectedCandidate(outline, size),)


def _without_ragged_sides(grid: Array) -> Array:
    """Return a lattice (n, m, 2) without outer lines of which less than a half was found."""
    is_ragged = True
    while is_ragged and min(grid.shape[:2]) > 0:
        is_ragged = False
        for _ in range(4):  # each side in turn becomes the first line
            grid = np.rot90(grid)
            while grid.size and np.isfinite(grid[0, :, 0]).mean() < _MIN_FOUND_ON_SIDE:
                grid, is_ragged = grid[1:], True
    return grid


def _rejected(grids: list[Array], reason: str) -> tuple[RejectedCandidate, ...]:
    """Return the outlines of candidates, of those whose outermost corners are known."""
    outlines = [grid[[0, 0, -1, -1], [0, -1, -1, 0]] for grid in grids]
    return tuple(RejectedCandidate(o, reason) for o in outlines if np.isfinite(o).all())


def _distinct_boards(grey: NDArray[np.uint8], grids: list[Array]) -> list[tuple[Ints, Array]]:
    """Return the ids and corners of the largest board, and of others about as large."""
    found: list[tuple[Ints, Array]] = []
    least_px2 = 0.0
    for grid in sorted(grids, key=_area_px2, reverse=True):
        if _area_px2(grid) < least_px2:
            break
        ids, points = _refined(grey, grid)
        if len(ids):
            least_px2 = max(least_px2, _MIN_AREA_OF_SECOND * _area_px2(grid))
            found.append((ids, points))
    return found


def _search(
    grey: NDArray[np.uint8], columns: int, rows: int, seen: list[Array]
) -> Iterator[list[Array]]:
    """
    Yield candidates for the corners (rows, columns, 2) px, accurate to a pixel or so.

    The largest lattice of each search (n, m, 2), with NaN where there is no corner, is appended
    to ``seen``. It may be that of a board with a line less.
    """
    corners = columns * rows
    at_least = int(np.ceil(_MIN_FOUND_FRACTION * (columns - 1) * (rows - 1)))
    for scale, image in _sizes(grey):
        for factor in _FEW_AND_MANY:
            at_most = min(factor * (_SADDLES_PER_CORNER * corners + _MORE_SADDLES), _MOST_SADDLES)
            saddles = find_saddles(image, at_most)
            found = [_lattice(saddles, *each) for each in lattices(saddles, at_least)]
            found = [scale * lattice + 0.5 * (scale - 1.0) for lattice in found]
            seen += found[:1]
            grids = [_board_in_lattice(lattice, columns, rows) for lattice in found]
            yield [grid for grid in grids if grid is not None]
            if len(saddles) < at_most:
                break


def _refined(grey: NDArray[np.uint8], coarse: Array) -> tuple[Ints, Array]:
    """Return the ids and fitted corners of a candidate (rows, columns, 2); none if it is false."""
    grid = _fitted(grey, order_as_printed(grey, coarse))
    unknown = np.isnan(grid[..., 0])
    if unknown.mean() > 1.0 - _MIN_REFINED_FRACTION:
        return _NOTHING
    if unknown.any():
        # Their neighbours are known to a fraction of a pixel now.
        again = _fitted(grey, _filled(grid))
        grid = np.where(unknown[..., None], again, grid)
    ids = np.flatnonzero(np.isfinite(grid[..., 0]))
    return (ids, grid.reshape(-1, 2)[ids]) if is_smooth(grid) else _NOTHING


def _fitted(grey: NDArray[np.uint8], grid: Array) -> Array:
    """Return the fitted corners (rows, columns, 2); NaN where there is none."""
    along, across = np.gradient(grid, axis=1), np.gradient(grid, axis=0)
    sides = along.reshape(-1, 2), across.reshape(-1, 2)
    saddles = refine_saddles(grey, grid.reshape(-1, 2), *sides, _RADIUS_IN_SQUARES)
    # Noise and blur are much the same all over a board; a fit elsewhere has a larger misfit.
    largest = _LEAST_MISFIT + _MISFIT_IN_MEDIANS * np.median(saddles.misfit)
    good = saddles.good & (saddles.misfit < largest)
    fitted: Array = np.where(good[:, None], saddles.points, np.nan).reshape(grid.shape)
    return fitted


def _area_px2(grid: Array) -> float:
    """Return the area of the quadrilateral between a grid's outer corners."""
    first, second = grid[-1, -1] - grid[0, 0], grid[-1, 0] - grid[0, -1]
    return 0.5 * abs(float(first[0] * second[1] - first[1] * second[0]))


def _sizes(grey: NDArray[np.uint8]) -> Iterator[tuple[float, NDArray[np.uint8]]]:
    """Yield the image at several sizes, the most promising first, and pixels per its pixel."""
    images = [grey]
    while max(images[-1].shape) > _FIRST_SIDE_PX:
        images.append(_half(images[-1]))
    first = len(images) - 1
    if min(images[-1].shape) >= 2 * _SMALLEST_SIDE_PX:
        images.append(_half(images[-1]))
    for level in (*range(first, -1, -1), *range(first + 1, len(images))):
        yield 2.0**level, images[level]


def _half(image: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """Return the means of 2x2 pixels."""
    height, width = image.shape
    even = image[: height // 2 * 2, : width // 2 * 2]
    halved = cv2.resize(even, (width // 2, height // 2), interpolation=cv2.INTER_AREA)
    return np.asarray(halved, dtype=np.uint8)


def _lattice(saddles: Array, members: Ints, cells: Ints) -> Array:
    """Return the points of a lattice by their cells: (n, m, 2), NaN where there is none."""
    lattice = np.full((*(cells.max(axis=0) + 1), 2), np.nan)
    lattice[cells[:, 0], cells[:, 1]] = saddles[members, :2]
    return lattice


def _board_in_lattice(lattice: Array, columns: int, rows: int) -> Array | None:
    """Return the corners (rows, columns, 2) of a board in a lattice; None without one."""
    for turned in (lattice, lattice.swapaxes(0, 1))[: 2 if columns != rows else 1]:
        # One more line on each side shows whether the lattice continues there.
        wider = np.full((turned.shape[0] + 2 * rows, turned.shape[1] + 2 * columns, 2), np.nan)
        wider[rows:-rows, columns:-columns] = turned
        is_found = np.isfinite(wider[..., 0])
        count = _window_sums(is_found, rows, columns)
        top, left = np.unravel_index(np.argmax(count), count.shape)
        if count[top, left] < _MIN_FOUND_FRACTION * rows * columns:
            continue
        around = is_found[top - 1 : top + rows + 1, left - 1 : left + columns + 1]
        if _has_own_sides(around):
            return _filled(wider[top : top + rows, left : left + columns])
    return None


def _window_sums(counted: Mask, rows: int, columns: int) -> Ints:
    """Return the number of true elements in each window of so many rows and columns."""
    sums = np.zeros((counted.shape[0] + 1, counted.shape[1] + 1), np.int64)
    sums[1:, 1:] = np.cumsum(np.cumsum(counted, axis=0), axis=1)
    windows: Ints = (
        sums[rows:, columns:] - sums[:-rows, columns:] - sums[rows:, :-columns]
    ) + sums[:-rows, :-columns]
    return windows


def _has_own_sides(around: Mask) -> bool:
    """Return whether a board's outermost lines are found, and not the next ones."""
    for side in (around, around[::-1], around.T, around.T[::-1]):
        outside, outermost = side[0, 1:-1], side[1, 1:-1]
        if outermost.mean() < _MIN_FOUND_ON_SIDE or outside.mean() >= _MIN_FOUND_ON_SIDE:
            return False
    return True


def _filled(grid: Array) -> Array:
    """Fill unknown corners (NaN) from their neighbours along the lines."""
    while np.isnan(grid).any():
        padded = np.pad(grid, ((2, 2), (2, 2), (0, 0)), constant_values=np.nan)
        guesses = []
        for lines in (padded, padded.swapaxes(0, 1)):
            before2, before, after, after2 = lines[:-4], lines[1:-3], lines[3:-1], lines[4:]
            for guess in (0.5 * (before + after), 2.0 * before - before2, 2.0 * after - after2):
                inner = guess[:, 2:-2]
                guesses.append(inner if lines is padded else inner.swapaxes(0, 1))
        known = np.isfinite(guesses)
        total = np.where(known, guesses, 0.0).sum(axis=0)
        count = known.sum(axis=0)
        estimate = np.where(count > 0, total / np.maximum(count, 1), np.nan)
        filled = np.where(np.isnan(grid), estimate, grid)
        if np.isnan(filled).sum() == np.isnan(grid).sum():
            break
        grid = filled
    return grid


def is_smooth(grid: Array) -> bool:
    """Return whether the lines of corners are as smooth as a lens leaves them; NaN is unknown."""
    spacing_px = _spacing_px(grid)
    in_rows = np.linalg.norm(np.diff(grid, 2, axis=1), axis=2) / spacing_px[:, 1:-1]
    in_columns = np.linalg.norm(np.diff(grid, 2, axis=0), axis=2) / spacing_px[1:-1]
    return not bool(
        (in_rows >= _MAX_SECOND_DIFFERENCE).any() or (in_columns >= _MAX_SECOND_DIFFERENCE).any()
    )


def order_as_printed(grey: NDArray[np.uint8], grid: Array) -> Array:
    """Reorder the corners (rows, columns, 2) to begin at the board's own top left."""
    along, down = np.gradient(grid, axis=1), np.gradient(grid, axis=0)
    if np.sum(along[..., 0] * down[..., 1] - along[..., 1] * down[..., 0]) < 0.0:
        grid = grid[:, ::-1]  # mirrored
    quarter_turns = [0, 1, 2, 3] if grid.shape[0] == grid.shape[1] else [0, 2]
    candidates = [np.rot90(grid, turns) for turns in quarter_turns]
    # All candidates remain if the colours do not decide, or are not those that we print.
    matching = [each for each in candidates if _begins_with_black(grey, each)] or candidates
    return max(matching, key=_upward_px)


def _begins_with_black(grey: NDArray[np.uint8], grid: Array) -> bool:
    """Return whether the board's top left square is black, from the squares between corners."""
    centres = 0.25 * (grid[:-1, :-1] + grid[1:, :-1] + grid[:-1, 1:] + grid[1:, 1:])
    x, y = np.rint(centres).astype(np.int64).reshape(-1, 2).T
    levels = grey[np.clip(y, 0, grey.shape[0] - 1), np.clip(x, 0, grey.shape[1] - 1)]
    row, column = np.indices(centres.shape[:2]).reshape(2, -1)
    # The square between the first four corners has the colour of the board's top left square.
    like_first = (row + column) % 2 == 0
    return bool(levels[like_first].mean() < levels[~like_first].mean())


def _upward_px(grid: Array) -> float:
    """Return how far the board's y axis points up in the image, pixels summed over columns."""
    return float(np.sum(grid[-1, :, 1] - grid[0, :, 1]))


def _spacing_px(grid: Array) -> Array:
    """Return the distance (rows, columns) px from each corner to its nearest neighbour."""
    spacing_px = np.full(grid.shape[:2], np.inf)
    for points, nearest_px in ((grid, spacing_px), (grid.swapaxes(0, 1), spacing_px.T)):
        step_px = np.linalg.norm(np.diff(points, axis=0), axis=2)
        for ends in (nearest_px[1:], nearest_px[:-1]):
            np.fmin(ends, step_px, out=ends)  # a step to an unknown corner is NaN: ignored
    return spacing_px
