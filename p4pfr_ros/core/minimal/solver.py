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
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from .cone import board_weights, depth_cone
from .pose import board_duals, place_centroid, polish, pose_from_root, scale_image, unscale
from .roots import feasible_roots, MAX_ROOTS, STACK_SHAPE
from .sextic import factors
from .solution import G, H, ROW_SIZE, Solution, solution_from_row
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
from ..jit import jit, kernel

# Upper bound of k r². A lens with k > 0 folds at r = 1/√k: a point projects to the nearer of two
# pixels, and a solution with the farther one satisfies the equations, but not the projection.
UNFOLDED = 1.0

# A solution with a larger residual, as ``polish`` measures it, is rejected.
_MAX_RESIDUAL = 1e-9


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
    image = as_image_points(image_points, 'image_points', 4)
    board = as_board_points(board_points, 'board_points', 4)
    rows = np.empty((MAX_ROOTS, ROW_SIZE))
    count = _solve_one(image, board, rows)
    return [solution_from_row(row, (0.0, 0.0)) for row in rows[:count]]


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
    rows = np.empty((n, MAX_ROOTS, ROW_SIZE))
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
        rows[..., H] * rows[..., G],
        rows[..., :TRANSLATION].reshape(n, MAX_ROOTS, 3, 3),
        rows[..., TRANSLATION:G],
    )


class Workspace(NamedTuple):
    """Workspace of one solve, allocated once: the kernels allocate nothing."""

    sample_image: Array
    sample_board: Array
    image: Array
    radius: Array
    board: Array
    duals: Array
    weights: Array
    plane: Array
    rays: Array
    roots: Array
    stack: Array
    system: Array
    trial: Array


@jit
def workspace() -> Workspace:
    """Allocate the workspace of ``solve_minimal``."""
    return Workspace(
        np.empty((4, 2)),
        np.empty((4, 2)),
        np.empty((4, 2)),
        np.empty(4),
        np.empty((4, 2)),
        np.empty((4, 2)),
        np.empty(4),
        np.empty((4, 4)),
        np.empty((2, 4)),
        np.empty(MAX_ROOTS),
        np.empty(STACK_SHAPE),
        np.empty((8, 9)),
        np.empty(ROW_SIZE),
    )


@jit
def _solve_one(image: Array, board: Array, rows: Array) -> int:
    return solve_minimal(image, board, UNFOLDED, rows, workspace())


@jit
def _solve_all(image: Array, board: Array, rows: Array, count: Ints) -> None:
    _solve_each(image, board, rows, count, workspace())


@kernel
def _solve_each(image: Array, board: Array, rows: Array, count: Ints, work: Workspace) -> None:
    for i in range(len(count)):
        count[i] = solve_minimal(image[i], board[i], UNFOLDED, rows[i], work)
        for s in range(count[i], MAX_ROOTS):
            for j in range(ROW_SIZE):
                rows[i, s, j] = math.nan


@kernel
def solve_minimal(
    image: Array, board: Array, max_bend: float, rows: Array, work: Workspace
) -> int:
    """
    Write the solutions of one problem to ``rows`` and return their number.

    max_bend bounds k r² at the farthest point (k and r in the same unit); infinity: no bound.

    rows (6, ROW_SIZE), see ``solution``; rows past the number are undefined.
    """
    scale_px = scale_image(image, work.image, work.radius)
    if not (scale_px > 0.0 and board_weights(board, work.weights)):
        return 0
    if not depth_cone(work.image, work.radius, work.weights, work.plane, work.rays):
        return 0
    size = board_duals(board, work.board, work.duals)
    f = factors(work.image, work.weights, work.rays, work.duals)
    count = 0
    for i in range(feasible_roots(f, max_bend, work.roots, work.stack)):
        row = rows[count]
        tau = work.roots[i]
        if not pose_from_root(f, tau, row):
            continue
        place_centroid(work.rays, tau, work.image, row)
        if polish(row, work.image, work.board, work.system, work.trial) > _MAX_RESIDUAL:
            continue
        if not row[G] > 0.0:
            continue
        unscale(row, board, scale_px, size)
        count += 1
    return count
