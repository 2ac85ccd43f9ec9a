# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""Levenberg-Marquardt over the truncated squared reprojection error of one view."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from .prior import add_prior, prior_cost
from .problem import add_points, POSE_AND_CAMERA, Problem, truncated_sum
from ..geometry import Array
from ..jit import jit
from ..linalg import rotate, solve_in_place
from ..minimal.solution import G, H, ROW_SIZE, TRANSLATION
from ..model.normal_equations import COLUMNS

# Damping, relative to the diagonal of JᵀJ.
_FIRST_DAMPING = 1e-4
_SMALLEST_DAMPING = 1e-12
_LARGEST_DAMPING = 1e8


class LeastSquaresRoom(NamedTuple):
    """Room to work in, made once."""

    normal: Array
    system: Array
    jacobian: Array
    trial: Array


@jit
def least_squares_room() -> LeastSquaresRoom:
    """Make the room that ``minimise`` works in."""
    size = (POSE_AND_CAMERA, COLUMNS)
    return LeastSquaresRoom(
        np.empty(size), np.empty(size), np.empty((2, COLUMNS)), np.empty(ROW_SIZE)
    )


@jit
def truncated_cost(row: Array, problem: Problem, limit: float, enough: float) -> float:
    """
    Sum the squared errors, each cut off at ``limit`` px², and the prior's, which is not.

    It stops where the sum passes enough.
    """
    beforehand = prior_cost(row, problem.prior)
    return beforehand + truncated_sum(row, problem, limit, enough - beforehand)


@jit
def normal_equations(row: Array, problem: Problem, limit: float, room: LeastSquaresRoom) -> int:
    """Write JᵀJ and -Jᵀr over the points within the limit to the room; return their number."""
    normal = room.normal
    normal[:, :] = 0.0
    count = add_points(row, problem, limit, room.jacobian, normal)
    add_prior(row, problem.prior, normal)
    for a in range(POSE_AND_CAMERA):
        for b in range(a):
            normal[a, b] = normal[b, a]
        normal[a, 8] = -normal[a, 8]
    return count


@jit
def minimise(
    row: Array,
    problem: Problem,
    limit: float,
    max_steps: int,
    tolerance: float,
    room: LeastSquaresRoom,
) -> float:
    """
    Lower the truncated cost from ``row`` on, in place; return the cost.

    It ends after max_steps trials, or where a step lowers the cost by no more than the share
    ``tolerance``, or where no step lowers it at all.
    """
    cost = truncated_cost(row, problem, limit, math.inf)
    damping = _FIRST_DAMPING
    moved = True
    for _ in range(max_steps):
        if moved and normal_equations(row, problem, limit, room) < 4:
            break
        moved = False
        lower = math.inf
        if _step(row, damping, problem.unknowns, room):
            lower = truncated_cost(room.trial, problem, limit, cost)
        if lower < cost:
            gain = cost - lower
            row[:] = room.trial
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
def _step(row: Array, damping: float, unknowns: int, room: LeastSquaresRoom) -> bool:
    """Write the row after one damped step to the room; False where there is none."""
    system, trial = room.system, room.trial
    for a in range(unknowns):
        for b in range(unknowns):
            system[a, b] = room.normal[a, b]
        system[a, a] *= 1.0 + damping
        system[a, unknowns] = room.normal[a, 8]
    if not solve_in_place(system, unknowns):
        return False
    rotate(row, system[0, unknowns], system[1, unknowns], system[2, unknowns], trial)
    for i in range(3):
        trial[TRANSLATION + i] = row[TRANSLATION + i] + system[3 + i, unknowns]
    trial[G] = row[G]
    trial[H] = row[H]
    if unknowns == POSE_AND_CAMERA:
        trial[G] += system[6, unknowns]
        trial[H] += system[7, unknowns]
    return bool(trial[G] > 0.0)
