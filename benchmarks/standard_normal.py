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
from p4pfr_ros.core.minimal.four import Points, points_of
from p4pfr_ros.core.minimal.one import solve_minimal, Workspace, workspace
from p4pfr_ros.core.minimal.pose import pose_from_root, scale_board, scale_image
from p4pfr_ros.core.minimal.roots import feasible_roots, MAX_ROOTS
from p4pfr_ros.core.minimal.sextic import factors
from p4pfr_ros.core.minimal.solution import ROW_SIZE


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
        points, board_points = points_of(image[i]), points_of(board[i])
        count[i, 0] = _depths(points, board_points, depths[i], room)
        count[i, 1] = solve_minimal(points, board_points, math.inf, rows[i], room)


@jit
def _depths(image_points: Points, board_points: Points, depths: Array, room: Workspace) -> int:
    """Run ``solve_minimal`` up to the roots, and write their λ."""
    scale_px, image, radius = scale_image(image_points)
    has_weights, weights = board_weights(board_points)
    cone = depth_cone(image, radius, weights)
    if not (scale_px > 0.0 and has_weights and cone.opens):
        return 0
    f = factors(image, weights, cone, scale_board(board_points).duals)
    count = 0
    for i in range(feasible_roots(f, math.inf, room.roots, room.stack)):
        tau = room.roots[i]
        if pose_from_root(f, tau, cone, image)[0]:
            for p in range(4):
                depths[count, p] = (1.0 - tau) * cone.a[p] + tau * cone.b[p]
            count += 1
    return count
