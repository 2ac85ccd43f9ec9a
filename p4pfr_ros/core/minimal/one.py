# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""The solver for one problem: the formulas in their order, and the reference of ``lanes``."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from .cone import board_weights, depth_cone
from .four import Points
from .pose import (
    Frame,
    is_accurate,
    polish,
    pose_from_root,
    scale_board,
    scale_image,
    unscale,
)
from .roots import feasible_roots, MAX_ROOTS, STACK_SHAPE
from .sextic import factors
from .solution import G, load_row, ROW_SIZE, store_row
from ..geometry import Array
from ..jit import jit, kernel

# Upper bound of k r². A lens with k > 0 folds at r = 1/√k: a point projects to the nearer of two
# pixels, and a solution with the farther one satisfies the equations, but not the projection.
UNFOLDED = 1.0

# A solution with a larger residual, as ``polish`` measures it, is rejected.
MAX_RESIDUAL = 1e-9


class Workspace(NamedTuple):
    """Workspace of one solve, allocated once: the kernels allocate nothing."""

    roots: Array
    stack: Array
    system: Array
    trial: Array


@jit
def workspace() -> Workspace:
    """Allocate the workspace of ``solve_minimal``."""
    return Workspace(
        np.empty(MAX_ROOTS), np.empty(STACK_SHAPE), np.empty((8, 9)), np.empty(ROW_SIZE)
    )


@kernel
def solve_minimal(
    image_points: Points, board_points: Points, max_bend: float, rows: Array, work: Workspace
) -> int:
    """
    Write the solutions of one problem to ``rows`` and return their number.

    max_bend bounds k r² at the farthest point (k and r in the same unit); infinity: no bound.

    rows (6, ROW_SIZE), see ``solution``; rows past the number are undefined.
    """
    scale_px, image, radius = scale_image(image_points)
    has_weights, weights = board_weights(board_points)
    if not (scale_px > 0.0 and has_weights):
        return 0
    cone = depth_cone(image, radius, weights)
    if not cone.opens:
        return 0
    board = scale_board(board_points)
    f = factors(image, weights, cone, board.duals)
    count = 0
    for i in range(feasible_roots(f, max_bend, work.roots, work.stack)):
        has_pose, row = pose_from_root(f, work.roots[i], cone, image)
        if has_pose and is_accurate(row, image, board.points):
            store_row(unscale(row, scale_px, board.frame), rows[count])
            count += 1
        elif has_pose:
            store_row(row, rows[count])
            count += refine(rows[count], image, board.points, scale_px, board.frame, work)
    return count


@kernel
def refine(
    row: Array, image: Points, board: Points, scale_px: float, frame: Frame, work: Workspace
) -> int:
    """Refine and unscale a solution of the scaled problem, in place; return 0 if it is none."""
    residual = polish(row, image, board, work.system, work.trial)
    if not (residual <= MAX_RESIDUAL and row[G] > 0.0):
        return 0
    store_row(unscale(load_row(row), scale_px, frame), row)
    return 1
