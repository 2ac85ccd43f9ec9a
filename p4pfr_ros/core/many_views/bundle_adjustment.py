# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""
Bundle adjustment: Levenberg-Marquardt over one lens and the poses of all views.

A pose belongs to one view and the lens to all, so JᵀJ is an arrow: a 6x6 block for each pose, a
border of six columns for the lens. Each view has one (13, 13) block, with Jᵀr in the last column:
[C B; Bᵀ A] by pose and lens, with the gradients c and a. Eliminating the pose by the first row
leaves the Schur complement  A - Bᵀ C⁻¹ B,  the view's information about the lens when its pose is
unknown, and the gradient  a - Bᵀ C⁻¹ c.  The time is linear in the number of points.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from ..geometry import Array, Ints, POSE_SIZE, TRANSLATION
from ..jit import jit, kernel
from ..linalg import rotate, solve_in_place
from ..model.lens import (
    COLUMNS,
    FOCAL,
    K,
    LENS_SIZE,
    linearise,
    POSE_COLUMNS,
    RESIDUAL,
    squared_error,
)
from ..model.prior import WeightedPrior

_FIRST_DAMPING = 1e-6
_SMALLEST_DAMPING = 1e-12
_LARGEST_DAMPING = 1e8

# Relative ridge on the diagonal of C, so that it can be inverted if a pose is barely determined.
_RIDGE = 1e-13


class AdjustmentWork(NamedTuple):
    """
    Workspace for V views.

    blocks (V, 13, 13): JᵀJ and Jᵀr of each view; solved (V, 6, 13): C⁻¹ [B c], which gives the
    step of its pose from that of the lens; reduced (6, 7): the equations of the lens.
    """

    blocks: Array
    solved: Array
    poses: Array
    lens: Array
    reduced: Array
    system: Array
    jacobian: Array
    lens_step: Array
    step: Array


def adjustment_work(views: int) -> AdjustmentWork:
    """Allocate the workspace for a number of views."""
    return AdjustmentWork(
        np.empty((views, COLUMNS, COLUMNS)),
        np.empty((views, POSE_COLUMNS, COLUMNS)),
        np.empty((views, POSE_SIZE)),
        np.empty(LENS_SIZE),
        np.empty((LENS_SIZE, LENS_SIZE + 1)),
        np.empty((LENS_SIZE, LENS_SIZE + 1)),
        np.empty((2, COLUMNS)),
        np.empty(LENS_SIZE),
        np.empty(POSE_COLUMNS),
    )


@jit
def adjust(
    stacked: StackedViews,
    poses: Array,
    lens: Array,
    order: int,
    prior: WeightedPrior,
    limit: float,
    max_steps: int,
    tolerance: float,
    work: AdjustmentWork,
) -> float:
    """
    Minimise the truncated cost over poses (V, 12) and lens (6,), in place; return it, px².

    order: number of free terms of k, k2, k3. The prior is weighted by the noise variance, so that
    its squared residuals are in px², too. ``work`` ends with the blocks of the last linearisation,
    which are those of the result within the tolerance.
    """
    cost = _cost(stacked, poses, lens, prior, limit, math.inf)
    damping = _FIRST_DAMPING
    moved = True
    for _ in range(max_steps):
        if moved:
            fill_blocks(stacked, poses, lens, limit, work)
        moved = False
        lower = math.inf
        if _step(poses, lens, order, prior, damping, work):
            lower = _cost(stacked, work.poses, work.lens, prior, limit, cost)
        if lower < cost:
            gain = cost - lower
            poses[:] = work.poses
            lens[:] = work.lens
            moved = True
            cost = lower
            damping = max(0.1 * damping, _SMALLEST_DAMPING)
            if gain <= tolerance * cost:
                break
        else:
            damping *= 10.0
            if damping > _LARGEST_DAMPING:
                break
    return cost


@jit
def fill_blocks(
    stacked: StackedViews, poses: Array, lens: Array, limit: float, work: AdjustmentWork
) -> int:
    """Write each view's normal equations to ``work``; return the number of their points."""
    count = 0
    for v in range(len(poses)):
        count += view_block(stacked, v, poses[v], lens, limit, work.jacobian, work.blocks[v])
    return count


@jit
def _cost(
    stacked: StackedViews,
    poses: Array,
    lens: Array,
    prior: WeightedPrior,
    limit: float,
    enough: float,
) -> float:
    prior_squares = 0.0
    for a in range(LENS_SIZE):
        for b in range(LENS_SIZE):
            product = (lens[a] - prior.mean[a]) * (lens[b] - prior.mean[b])
            prior_squares += prior.information[a, b] * product
    return prior_squares + truncated_cost(stacked, poses, lens, limit, enough - prior_squares)


@jit
def lens_equations(
    views: int, lens: Array, prior: WeightedPrior, damping: float, work: AdjustmentWork
) -> bool:
    """Write the (6, 7) equations of the lens to work.reduced; False if a block is singular."""
    reduced = work.reduced
    for a in range(LENS_SIZE):
        gradient = 0.0
        for b in range(LENS_SIZE):
            reduced[a, b] = prior.information[a, b]
            gradient -= prior.information[a, b] * (lens[b] - prior.mean[b])
        reduced[a, LENS_SIZE] = gradient
    determined = True
    for v in range(views):
        determined = determined and reduce_view(work.blocks[v], damping, work.solved[v], reduced)
    return determined


@jit
def _step(
    poses: Array,
    lens: Array,
    order: int,
    prior: WeightedPrior,
    damping: float,
    work: AdjustmentWork,
) -> bool:
    """Write lens and poses after one damped step to ``work``; return False if there is none."""
    if not lens_equations(len(poses), lens, prior, damping, work):
        return False
    free = K + order
    for a in range(free):
        for b in range(free):
            work.system[a, b] = work.reduced[a, b]
        work.system[a, a] *= 1.0 + damping
        work.system[a, free] = work.reduced[a, LENS_SIZE]
    if not solve_in_place(work.system, free):
        return False
    for a in range(LENS_SIZE):
        work.lens_step[a] = work.system[a, free] if a < free else 0.0
        work.lens[a] = lens[a] + work.lens_step[a]
    for v in range(len(poses)):
        step = work.step
        pose_step(work.solved[v], work.lens_step, step)
        rotate(poses[v], step[0], step[1], step[2], work.poses[v])
        for i in range(3):
            work.poses[v, TRANSLATION + i] = poses[v, TRANSLATION + i] + step[3 + i]
    return bool(work.lens[FOCAL] > 0.0)


@jit
def view_equations(views: int, work: AdjustmentWork, equations: Array) -> None:
    """Write each view's equations (V, 6, 7) of the lens, its pose eliminated."""
    for v in range(views):
        equations[v] = 0.0
        reduce_view(work.blocks[v], 0.0, work.solved[v], equations[v])


class StackedViews(NamedTuple):
    """
    The points of all views, one after the other.

    image (M, 2) px from the middle of the image, board (M, 2) scaled, and starts (V + 1,): view v
    has the points from starts[v] to starts[v + 1].
    """

    image: Array
    board: Array
    starts: Ints


@kernel
def view_cost(stacked: StackedViews, v: int, pose: Array, lens: Array, limit: float) -> float:
    """Sum a view's squared errors, each truncated at limit, px²."""
    image, board = stacked.image, stacked.board
    total = 0.0
    for i in range(stacked.starts[v], stacked.starts[v + 1]):
        error = squared_error(pose, lens, board[i, 0], board[i, 1], image[i, 0], image[i, 1])
        total += min(error, limit)
    return total


@kernel
def view_block(
    stacked: StackedViews,
    v: int,
    pose: Array,
    lens: Array,
    limit: float,
    jacobian: Array,
    block: Array,
) -> int:
    """Write JᵀJ and Jᵀr of the view's points within the limit; return their number."""
    image, board = stacked.image, stacked.board
    for a in range(COLUMNS):
        for b in range(COLUMNS):
            block[a, b] = 0.0
    count = 0
    for i in range(stacked.starts[v], stacked.starts[v + 1]):
        linearise(pose, lens, board[i, 0], board[i, 1], image[i, 0], image[i, 1], jacobian)
        first, second = jacobian[0, RESIDUAL], jacobian[1, RESIDUAL]
        # Written so that NaN is not within.
        if not first * first + second * second < limit:
            continue
        count += 1
        for a in range(COLUMNS):
            for b in range(a, COLUMNS):
                block[a, b] += jacobian[0, a] * jacobian[0, b] + jacobian[1, a] * jacobian[1, b]
    for a in range(COLUMNS):
        for b in range(a):
            block[a, b] = block[b, a]
    return count


@jit
def squared_errors(stacked: StackedViews, poses: Array, lens: Array, squares: Array) -> None:
    """Write the squared errors (M,), px²; infinite for points that are not visible."""
    for v in range(len(poses)):
        for i in range(stacked.starts[v], stacked.starts[v + 1]):
            x, y = stacked.board[i, 0], stacked.board[i, 1]
            squares[i] = squared_error(
                poses[v], lens, x, y, stacked.image[i, 0], stacked.image[i, 1]
            )


@jit
def truncated_cost(
    stacked: StackedViews, poses: Array, lens: Array, limit: float, enough: float
) -> float:
    """Sum the squared errors of all views, each truncated at limit; infinite beyond enough."""
    total = 0.0
    for v in range(len(poses)):
        total += view_cost(stacked, v, poses[v], lens, limit)
        if not total <= enough:
            return math.inf
    return total


@kernel
def reduce_view(block: Array, damping: float, solved: Array, reduced: Array) -> bool:
    """
    Add a view's information about the lens, and its negative gradient, to reduced (6, 7).

    C⁻¹ [B c] is written to solved (6, 13), in the columns of the lens and the residual, with C
    damped by a share of its diagonal. Return False if C is singular.
    """
    n = POSE_COLUMNS
    if not _factor(block, damping, solved):
        return False
    for column in range(n, COLUMNS):
        for i in range(n):
            total = block[i, column]
            for j in range(i):
                total -= solved[i, j] * solved[j, column]
            solved[i, column] = total / solved[i, i]
    # So far L⁻¹ [B c]; the products are BᵀC⁻¹B and BᵀC⁻¹c.
    for a in range(LENS_SIZE):
        for b in range(LENS_SIZE + 1):
            total = block[n + a, n + b]
            for i in range(n):
                total -= solved[i, n + a] * solved[i, n + b]
            reduced[a, b] += total if b < LENS_SIZE else -total
    for column in range(n, COLUMNS):
        for i in range(n - 1, -1, -1):
            total = solved[i, column]
            for j in range(i + 1, n):
                total -= solved[j, i] * solved[j, column]
            solved[i, column] = total / solved[i, i]
    return True


@kernel
def _factor(block: Array, damping: float, factor: Array) -> bool:
    """Write the Cholesky factor L of the damped C to the left of factor."""
    for i in range(POSE_COLUMNS):
        for j in range(i + 1):
            total = block[i, j]
            if i == j:
                total *= 1.0 + damping + _RIDGE
            for m in range(j):
                total -= factor[i, m] * factor[j, m]
            if i == j:
                if not total > 0.0:
                    return False
                factor[i, i] = math.sqrt(total)
            else:
                factor[i, j] = total / factor[j, j]
    return True


@kernel
def pose_step(solved: Array, lens_step: Array, step: Array) -> None:
    """Write the pose's step (6,) that follows from a step of the lens (6,):  -C⁻¹ (c + B δ)."""
    for i in range(POSE_COLUMNS):
        total = solved[i, RESIDUAL]
        for a in range(LENS_SIZE):
            total += solved[i, POSE_COLUMNS + a] * lens_step[a]
        step[i] = -total
