# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""
Planar P4Pfr: pose, focal length and radial distortion from four points of a plane.

The problem is Oskarsson's (arXiv:1805.10705). The derivation by way of the depths is this
project's own: ``cone`` (the possible depths), ``sextic`` and ``roots`` (the depths that fit),
``pose`` (the pose of each). docs/derivation.md has all of it.

Unobservable for any method: a plane parallel to the image, a square centred on the axis and tilted
about its own side or diagonal, and k if all four points have one distance from the centre.
"""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, fields
import math

import numpy as np
from numpy.typing import ArrayLike

from .block import BLOCK, block_work, padded, put_sample
from .four import points_of
from .lanes import solve_block
from .one import solve_minimal, UNFOLDED, workspace
from .solution import G, H, MAX_SOLUTIONS, ROW_SIZE, Solution, solutions_from_rows
from ..geometry import (
    Array,
    as_board_points,
    as_image_points,
    as_points,
    fields_equal,
    Ints,
    read_only,
    TRANSLATION,
)
from ..jit import jit

_DOUBLE = np.dtype(np.float64)

# The number of solutions of a problem with a number that is not finite.
_NOT_FINITE = -1


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class SolutionBatch:
    """
    The solutions of n problems; read-only arrays.

    count (n,), focal_px (n, 6), k (n, 6) dimensionless, rotation (n, 6, 3, 3) and translation
    (n, 6, 3) in board units, ``camera_from_board``; NaN from count on.
    """

    count: Ints
    focal_px: Array
    k: Array
    rotation: Array
    translation: Array

    def __post_init__(self) -> None:
        for field in fields(self):
            read_only(getattr(self, field.name))

    def __eq__(self, other: object) -> bool:
        return fields_equal(self, other)

    __hash__ = None  # type: ignore[assignment]

    def __repr__(self) -> str:
        return f'SolutionBatch({len(self.count)} problems, {int(self.count.sum())} solutions)'

    def __len__(self) -> int:
        return len(self.count)


def solve_p4pfr(image_points: ArrayLike, board_points: ArrayLike) -> list[Solution]:
    """
    Find pose, focal length and radial distortion from four points of a plane.

    Parameters
    ----------
    image_points : (4, 2) array
        Pixels relative to the distortion centre, x right, y down.
    board_points : (4, 2) array
        The same points on the board's plane Z = 0, in any unit; not all on a line.

    Returns
    -------
    At most six solutions, translation in the board's unit, centre (0, 0). Each reprojects the four
    points, with all points in front of the camera. Empty if the points have no solution or do not
    determine it, which is not an error.

    Raises
    ------
    ValueError
        A wrong shape, or a number that is not finite.

    References
    ----------
    Oskarsson, "A fast minimal solver for absolute camera pose with unknown focal length and
    radial distortion from four planar points", arXiv:1805.10705.

    """
    problem, rows = np.empty((2, 4, 2)), np.empty((MAX_SOLUTIONS, ROW_SIZE))
    count = _NOT_FINITE
    if _is_usual(image_points) and _is_usual(board_points):
        problem[0], problem[1] = image_points, board_points
        count = _solve_one(problem, rows)
    if count == _NOT_FINITE:
        problem[0] = as_image_points(image_points, 'image_points', 4)
        problem[1] = as_board_points(board_points, 'board_points', 4)
        count = _solve_one(problem, rows)
    return solutions_from_rows(rows[:count], (0.0, 0.0))


def _is_usual(points: ArrayLike) -> bool:
    """Return whether the points need no conversion, only a check that they are finite."""
    return type(points) is np.ndarray and points.shape == (4, 2) and points.dtype is _DOUBLE


def solve_p4pfr_batch(
    image_points: ArrayLike, board_points: ArrayLike, *, workers: int = 1
) -> SolutionBatch:
    """
    Solve n problems at once: ``solve_p4pfr`` for (n, 4, 2) image and board points.

    ``workers`` threads share the problems; the kernels release the GIL.

    Raises
    ------
    ValueError
        A wrong shape, a number that is not finite, or fewer than one worker.

    """
    if workers < 1:
        raise ValueError(f'workers must be at least 1, got {workers}')
    image = as_points(image_points, 'image_points', (None, 4, 2))
    board = as_points(board_points, 'board_points', (len(image), 4, 2))
    n = len(image)
    rows = np.empty((n, MAX_SOLUTIONS, ROW_SIZE))
    count = np.empty(n, dtype=np.int64)
    if workers == 1:
        _solve_all(image, board, rows, count)
    else:
        shares = [np.array_split(array, workers) for array in (image, board, rows, count)]
        with ThreadPoolExecutor(workers) as pool:
            list(pool.map(_solve_all, *shares))
    return SolutionBatch(
        count,
        rows[..., G],
        rows[..., H],
        rows[..., :TRANSLATION].reshape(n, MAX_SOLUTIONS, 3, 3),
        rows[..., TRANSLATION:G],
    )


@jit
def _solve_one(problem: Array, rows: Array) -> int:
    """Solve image points problem[0] and board points problem[1]; check that they are finite."""
    finite = True
    for i in range(4):
        for j in range(2):
            finite = finite and abs(problem[0, i, j]) < math.inf > abs(problem[1, i, j])
    if not finite:
        return _NOT_FINITE
    image, board = points_of(problem[0]), points_of(problem[1])
    return solve_minimal(image, board, UNFOLDED, rows, workspace())


@jit
def _solve_all(image: Array, board: Array, rows: Array, count: Ints) -> None:
    """Solve all problems, block by block; replace h by k; fill rows past each count with NaN."""
    block = block_work()
    n = len(count)
    for start in range(0, n, BLOCK):
        stop = min(start + BLOCK, n)
        size = stop - start
        # The last problem fills lanes that are left.
        for at in range(padded(size)):
            i = start + min(at, size - 1)
            put_sample(points_of(image[i]), points_of(board[i]), at, block)
        solve_block(size, UNFOLDED, rows[start:stop], count[start:stop], block)
        for i in range(start, stop):
            for s in range(count[i]):
                rows[i, s, H] *= rows[i, s, G]
            for s in range(count[i], MAX_SOLUTIONS):
                for j in range(ROW_SIZE):
                    rows[i, s, j] = math.nan
