# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""
Bundle adjustment: Levenberg-Marquardt over lens, board shapes and the poses of all views.

Lens (10) and shapes (8 for each board) are the common parameters. A pose belongs to one view, so
JᵀJ is an arrow: a 6x6 block for each pose, a border for the common parameters. Each view has one
block of 25 columns, pose, lens, its board's shape, and the residual: [C B; Bᵀ A] by pose and
common parameters, with the gradients c and a. Eliminating the pose by the first row leaves the
Schur complement  A - Bᵀ C⁻¹ B,  the view's information about lens and shape when its pose is
unknown, and the gradient  a - Bᵀ C⁻¹ c.  The time is linear in the number of points.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from ..geometry import Array, Ints, POSE_SIZE, TRANSLATION
from ..jit import jit, kernel, vectorised_kernel
from ..linalg import copy_row, rotate, solve_in_place
from ..model.board_shape import SHAPE_SIZE, SKEW, STRETCH, WARP
from ..model.lens import (
    CX,
    CY,
    FOCAL,
    LENS_END,
    LENS_SIZE,
    linearise_rotated,
    offset_px,
    POSE_COLUMNS,
)
from ..model.prior import WeightedPrior

# The common parameters of one view: lens and shape. Columns of a point: pose, these, residual.
VIEW_COMMON = LENS_SIZE + SHAPE_SIZE
RESIDUAL = POSE_COLUMNS + VIEW_COMMON
COLUMNS = RESIDUAL + 1
# Padded, so that loops over columns have a constant length and are vectorised.
WIDTH = 32
# Rows of derivatives that are added to a block together.
_ROWS = 8

_FIRST_DAMPING = 1e-6
_SMALLEST_DAMPING = 1e-12
_LARGEST_DAMPING = 1e8

# Relative ridge on the diagonal of C, so that it can be inverted if a pose is barely determined.
_RIDGE = 1e-13


class StackedViews(NamedTuple):
    """
    The points of all views, one after the other.

    image (M, 2) px from the middle of the image, board (M, 2) scaled; basis (M, 8) of the board's
    shape, scaled alike, zero for a board that is taken as flat; starts (V + 1,): view v has the
    points from starts[v] to starts[v + 1]; boards (V,): the place of each view's board.
    """

    image: Array
    board: Array
    basis: Array
    starts: Ints
    boards: Ints


class AdjustmentWork(NamedTuple):
    """
    Workspace for V views and C common parameters.

    blocks (V, 25, 32): JᵀJ and Jᵀr of each view; solved (V, 6, 25): C⁻¹ [B c], which gives the
    step of its pose from that of the common parameters; of_view (V, 18, 19): each view's equations
    of the common parameters; reduced (C, C + 1): their sum, and the prior.
    """

    blocks: Array
    solved: Array
    of_view: Array
    reduced: Array
    system: Array
    rows: Array
    poses: Array
    common: Array
    common_step: Array
    step: Array


def adjustment_work(views: int, common: int) -> AdjustmentWork:
    """Allocate the workspace for a number of views and common parameters."""
    return AdjustmentWork(
        np.zeros((views, COLUMNS, WIDTH)),
        np.empty((views, POSE_COLUMNS, COLUMNS)),
        np.empty((views, VIEW_COMMON, VIEW_COMMON + 1)),
        np.empty((common, common + 1)),
        np.empty((common, common + 1)),
        np.zeros((_ROWS, WIDTH)),
        np.empty((views, POSE_SIZE)),
        np.empty(common),
        np.empty(common),
        np.empty(POSE_COLUMNS),
    )


@jit
def adjust(
    stacked: StackedViews,
    poses: Array,
    common: Array,
    free: Ints,
    prior: WeightedPrior,
    limit: float,
    max_steps: int,
    tolerance: float,
    work: AdjustmentWork,
) -> float:
    """
    Minimise the truncated cost over poses (V, 12) and common parameters, in place; return it, px².

    free: the places of the common parameters that are estimated. It ends when another step would
    lower the cost of the points by less than a share of it, the tolerance. ``work`` holds the
    blocks and equations at the result.
    """
    of_points = fill_blocks(stacked, poses, common, limit, work)
    cost = of_points + _prior_cost(common, prior)
    damping = _FIRST_DAMPING
    for _ in range(max_steps):
        common_equations(stacked.boards, common, prior, damping, work)
        gain = _step(stacked.boards, poses, common, free, damping, work)
        if 0.0 <= gain <= tolerance * of_points:
            break
        lower = trial = math.inf
        if gain >= 0.0:
            trial = fill_blocks(stacked, work.poses, work.common, limit, work)
            lower = trial + _prior_cost(work.common, prior)
        if lower < cost:
            for v in range(len(poses)):
                copy_row(work.poses[v], poses[v])
            copy_row(work.common, common)
            cost, of_points = lower, trial
            damping = max(0.1 * damping, _SMALLEST_DAMPING)
            continue
        fill_blocks(stacked, poses, common, limit, work)
        damping = max(10.0 * damping, 1e-6)
        if damping > _LARGEST_DAMPING:
            break
    common_equations(stacked.boards, common, prior, 0.0, work)
    return cost


@jit
def fill_blocks(
    stacked: StackedViews, poses: Array, common: Array, limit: float, work: AdjustmentWork
) -> float:
    """Write each view's normal equations to ``work``; return the truncated cost, px²."""
    cost = 0.0
    for v in range(len(poses)):
        cost += view_block(stacked, v, poses[v], common, limit, work.rows, work.blocks[v])
    return cost


@kernel
def _prior_cost(common: Array, prior: WeightedPrior) -> float:
    cost = 0.0
    for a in range(len(common)):
        d = common[a] - prior.reference[a]
        along = 0.0
        for b in range(len(common)):
            along += prior.information[a, b] * (common[b] - prior.reference[b])
        cost += d * (along - 2.0 * prior.gradient[a])
    return cost


@jit
def common_equations(
    boards: Ints, common: Array, prior: WeightedPrior, damping: float, work: AdjustmentWork
) -> None:
    """Write the (C, C + 1) equations of the common parameters to work.reduced."""
    reduced, n = work.reduced, len(common)
    for a in range(n):
        gradient = prior.gradient[a]
        for b in range(n):
            reduced[a, b] = prior.information[a, b]
            gradient -= prior.information[a, b] * (common[b] - prior.reference[b])
        reduced[a, n] = gradient
    for v in range(len(boards)):
        reduce_view(work.blocks[v], damping, work.solved[v], work.of_view[v])
        shift = SHAPE_SIZE * boards[v]
        for a in range(VIEW_COMMON):
            row = a if a < LENS_SIZE else a + shift
            for b in range(VIEW_COMMON):
                reduced[row, b if b < LENS_SIZE else b + shift] += work.of_view[v, a, b]
            reduced[row, n] += work.of_view[v, a, VIEW_COMMON]


@jit
def _step(
    boards: Ints, poses: Array, common: Array, free: Ints, damping: float, work: AdjustmentWork
) -> float:
    """
    Write the common parameters and poses after one damped step to ``work``.

    Return by how much a quadratic cost would fall, px²; a negative number if there is no step.
    """
    m, n, system = len(free), len(common), work.system
    for a in range(m):
        for b in range(m):
            system[a, b] = work.reduced[free[a], free[b]]
        system[a, a] *= 1.0 + damping
        system[a, m] = work.reduced[free[a], n]
    if not solve_in_place(system, m):
        return -1.0
    gain = 0.0
    for a in range(n):
        work.common_step[a] = 0.0
    for a in range(m):
        gain += system[a, m] * work.reduced[free[a], n]
        work.common_step[free[a]] = system[a, m]
    for a in range(n):
        work.common[a] = common[a] + work.common_step[a]
    step = work.step
    for v in range(len(poses)):
        gain += pose_step(work.blocks[v], work.solved[v], boards[v], work.common_step, step)
        rotate(poses[v], step[0], step[1], step[2], work.poses[v])
        for i in range(3):
            work.poses[v, TRANSLATION + i] = poses[v, TRANSLATION + i] + step[3 + i]
    return gain if work.common[FOCAL] > 0.0 else -1.0


@kernel
def pose_step(block: Array, solved: Array, board: int, common_step: Array, step: Array) -> float:
    """
    Write the pose's step (6,) that follows from the common one:  -C⁻¹ (c + B δ).

    Return by how much the cost falls if the pose alone is moved, px²:  cᵀ C⁻¹ c.
    """
    shift = SHAPE_SIZE * board
    gain = 0.0
    for i in range(POSE_COLUMNS):
        total = solved[i, RESIDUAL]
        gain += total * block[i, RESIDUAL]
        for a in range(VIEW_COMMON):
            at = a if a < LENS_SIZE else a + shift
            total += solved[i, POSE_COLUMNS + a] * common_step[at]
        step[i] = -total
    return gain


@kernel
def _on_the_board(
    stacked: StackedViews, i: int, pose: Array, common: Array, at: int
) -> tuple[float, float, float]:
    """Return Q = R X of point i, with X on the board of the shape at ``at``."""
    basis = stacked.basis
    a, b = common[at + STRETCH], common[at + SKEW]
    bx = stacked.board[i, 0] + a * basis[i, 0] + b * basis[i, 1]
    by = stacked.board[i, 1] + b * basis[i, 0] - a * basis[i, 1]
    bz = 0.0
    for j in range(WARP, SHAPE_SIZE):
        bz += common[at + j] * basis[i, j]
    return (
        pose[0] * bx + pose[1] * by + pose[2] * bz,
        pose[3] * bx + pose[4] * by + pose[5] * bz,
        pose[6] * bx + pose[7] * by + pose[8] * bz,
    )


@kernel
def squared_error(stacked: StackedViews, i: int, pose: Array, common: Array, board: int) -> float:
    """Return the squared reprojection error of point i, px²; infinite if it is not visible."""
    at = LENS_SIZE + SHAPE_SIZE * board
    qx, qy, qz = _on_the_board(stacked, i, pose, common, at)
    x, y, z = qx + pose[TRANSLATION], qy + pose[TRANSLATION + 1], qz + pose[TRANSLATION + 2]
    u, v = stacked.image[i, 0], stacked.image[i, 1]
    dx, dy = offset_px(x, y, z, common, u, v)
    ex, ey = common[CX] + dx - u, common[CY] + dy - v
    error: float = ex * ex + ey * ey
    return error if error < math.inf else math.inf


@kernel
def _linearise(
    stacked: StackedViews, i: int, pose: Array, common: Array, board: int, rows: Array
) -> None:
    """Write the (2, 25) derivatives and residual of point i, px; NaN if it is not visible."""
    at = LENS_SIZE + SHAPE_SIZE * board
    qx, qy, qz = _on_the_board(stacked, i, pose, common, at)
    u, v = stacked.image[i, 0], stacked.image[i, 1]
    dx, dy = linearise_rotated(qx, qy, qz, pose, common, u, v, rows)
    basis = stacked.basis
    x, y = basis[i, 0], basis[i, 1]
    for j in range(2):
        # Derivatives by the board's own x, y and z:  a · R.
        a, b, c = rows[j, 3], rows[j, 4], rows[j, 5]
        by_x = a * pose[0] + b * pose[3] + c * pose[6]
        by_y = a * pose[1] + b * pose[4] + c * pose[7]
        by_z = a * pose[2] + b * pose[5] + c * pose[8]
        rows[j, LENS_END + STRETCH] = by_x * x - by_y * y
        rows[j, LENS_END + SKEW] = by_x * y + by_y * x
        for m in range(WARP, SHAPE_SIZE):
            rows[j, LENS_END + m] = by_z * basis[i, m]
    rows[0, RESIDUAL], rows[1, RESIDUAL] = common[CX] + dx - u, common[CY] + dy - v


@kernel
def view_block(
    stacked: StackedViews,
    v: int,
    pose: Array,
    common: Array,
    limit: float,
    rows: Array,
    block: Array,
) -> float:
    """Write JᵀJ and Jᵀr of the view's points within the limit; return the truncated cost, px²."""
    for a in range(COLUMNS):
        for b in range(WIDTH):
            block[a, b] = 0.0
    cost, row = 0.0, 0
    for i in range(stacked.starts[v], stacked.starts[v + 1]):
        _linearise(stacked, i, pose, common, stacked.boards[v], rows[row : row + 2])
        square = rows[row, RESIDUAL] ** 2 + rows[row + 1, RESIDUAL] ** 2
        # Written so that NaN is not within.
        if not square < limit:
            cost += limit
            continue
        cost += square
        row += 2
        if row == _ROWS:
            _add_rows(rows, block)
            row = 0
    for j in range(row, _ROWS):
        for a in range(COLUMNS):
            rows[j, a] = 0.0
    if row > 0:
        _add_rows(rows, block)
    for a in range(COLUMNS):
        for b in range(a):
            block[a, b] = block[b, a]
    return cost


@vectorised_kernel
def _add_rows(rows: Array, block: Array) -> None:
    """Add JᵀJ and Jᵀr of eight rows to the upper triangle, and to some of the lower."""
    for a in range(8):
        for b in range(WIDTH):
            block[a, b] += _product(rows, a, b)
    for a in range(8, 16):
        for b in range(8, WIDTH):
            block[a, b] += _product(rows, a, b)
    for a in range(16, COLUMNS):
        for b in range(16, WIDTH):
            block[a, b] += _product(rows, a, b)


@kernel
def _product(rows: Array, a: int, b: int) -> float:
    product: float = (
        (rows[0, a] * rows[0, b] + rows[1, a] * rows[1, b])
        + (rows[2, a] * rows[2, b] + rows[3, a] * rows[3, b])
        + (rows[4, a] * rows[4, b] + rows[5, a] * rows[5, b])
        + (rows[6, a] * rows[6, b] + rows[7, a] * rows[7, b])
    )
    return product


@jit
def squared_errors(stacked: StackedViews, poses: Array, common: Array, squares: Array) -> None:
    """Write the squared errors (M,), px²; infinite for points that are not visible."""
    for v in range(len(poses)):
        for i in range(stacked.starts[v], stacked.starts[v + 1]):
            squares[i] = squared_error(stacked, i, poses[v], common, stacked.boards[v])


@kernel
def reduce_view(block: Array, damping: float, solved: Array, equations: Array) -> None:
    """
    Write a view's information about the common parameters, and its negative gradient, (18, 19).

    C⁻¹ [B c] is written to solved (6, 25), in the columns of the common parameters and the
    residual, with C damped by a share of its diagonal.
    """
    n = POSE_COLUMNS
    _factor(block, damping, solved)
    for column in range(n, COLUMNS):
        for i in range(n):
            total = block[i, column]
            for j in range(i):
                total -= solved[i, j] * solved[j, column]
            solved[i, column] = total / solved[i, i]
    # So far L⁻¹ [B c]; the products are BᵀC⁻¹B and BᵀC⁻¹c.
    for a in range(VIEW_COMMON):
        for b in range(VIEW_COMMON + 1):
            total = block[n + a, n + b]
            for i in range(n):
                total -= solved[i, n + a] * solved[i, n + b]
            equations[a, b] = total if b < VIEW_COMMON else -total
    for column in range(n, COLUMNS):
        for i in range(n - 1, -1, -1):
            total = solved[i, column]
            for j in range(i + 1, n):
                total -= solved[j, i] * solved[j, column]
            solved[i, column] = total / solved[i, i]


@kernel
def _factor(block: Array, damping: float, factor: Array) -> None:
    """Write the Cholesky factor L of the damped C to the left of factor."""
    for i in range(POSE_COLUMNS):
        for j in range(i + 1):
            total = block[i, j]
            if i == j:
                total *= 1.0 + damping + _RIDGE
            for m in range(j):
                total -= factor[i, m] * factor[j, m]
            if i == j:
                # Without points C is zero: a huge pivot leaves the pose where it is.
                factor[i, i] = math.sqrt(total) if total > 0.0 else 1e100
            else:
                factor[i, j] = total / factor[j, j]
