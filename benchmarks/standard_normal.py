# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""
The instances of the paper's residual figure, solved: board and image points standard normal.

No camera produced these points, so k r² has any size and sign, and 1 + k r² can be near zero.
"""

from __future__ import annotations

from dataclasses import dataclass
import math

import numpy as np
from p4pfr_ros.core.geometry import Array, Ints
from p4pfr_ros.core.jit import jit
from p4pfr_ros.core.minimal.cone import board_weights, depth_cone
from p4pfr_ros.core.minimal.pose import board_duals, pose_from_root, scale_image
from p4pfr_ros.core.minimal.roots import feasible_roots, MAX_ROOTS
from p4pfr_ros.core.minimal.sextic import factors
from p4pfr_ros.core.minimal.solution import ROW_SIZE
from p4pfr_ros.core.minimal.solver import solve_minimal, Workspace, workspace


@dataclass(frozen=True, slots=True, eq=False)
class Solved:
    """
    All s solutions with positive depths.

    image and board (s, 4, 2): points of the instance; rows (s, 14): solutions of the solver;
    depths (s, 4): the λ at the sextic's root, before the rotation was computed.
    """

    image: Array
    board: Array
    rows: Array
    depths: Array


def draw(n: int, seed: int) -> tuple[Array, Array]:
    """Return image and board points, (n, 4, 2) each."""
    rng = np.random.default_rng(seed)
    return rng.standard_normal((n, 4, 2)), rng.standard_normal((n, 4, 2))


def solve(image: Array, board: Array) -> Solved:
    """Solve n instances, including the far branch of a fold: the equations hold there too."""
    n = len(image)
    rows = np.empty((n, MAX_ROOTS, ROW_SIZE))
    depths = np.empty((n, MAX_ROOTS, 4))
    count = np.zeros((n, 2), dtype=np.int64)
    _solve_all(image, board, rows, depths, count, workspace())
    # Roots and solutions are matched by their order, so there must be as many of both.
    paired = count[:, 0] == count[:, 1]
    if not paired.all():
        raise RuntimeError(f'{np.sum(~paired)} instances have roots without a solution')
    filled = np.arange(MAX_ROOTS) < count[:, :1]
    instance = np.nonzero(filled)[0]
    return Solved(image[instance], board[instance], rows[filled], depths[filled])


@jit
def _solve_all(
    image: Array, board: Array, rows: Array, depths: Array, count: Ints, room: Workspace
) -> None:
    for i in range(len(image)):
        count[i, 0] = _depths(image[i], board[i], rows[i, 0], depths[i], room)
        count[i, 1] = solve_minimal(image[i], board[i], math.inf, rows[i], room)


@jit
def _depths(image: Array, board: Array, row: Array, depths: Array, room: Workspace) -> int:
    """Run ``solve_minimal`` up to the roots, and write their λ."""
    if not (scale_image(image, room.image, room.radius) > 0.0):
        return 0
    if not board_weights(board, room.weights):
        return 0
    if not depth_cone(room.image, room.radius, room.weights, room.plane, room.rays):
        return 0
    board_duals(board, room.board, room.duals)
    f = factors(room.image, room.weights, room.rays, room.duals)
    count = 0
    for i in range(feasible_roots(f, math.inf, room.roots, room.stack)):
        tau = room.roots[i]
        if pose_from_root(f, tau, row):
            for p in range(4):
                depths[count, p] = (1.0 - tau) * room.rays[0, p] + tau * room.rays[1, p]
            count += 1
    return count
