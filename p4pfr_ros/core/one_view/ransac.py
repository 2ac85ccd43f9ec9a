# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""
The robust loop: LO-MSAC, in one compiled function.

Draw four points, solve, score by the truncated squared error (MSAC; Torr and Zisserman 2000),
refine each new best by least squares over the same truncated error (LO; Chum, Matas and Kittler
2003), and stop when a better sample is no longer likely.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from .least_squares import least_squares_room, LeastSquaresRoom, minimise, truncated_cost
from .problem import count_within, hypotheses, plausible, Problem
from .sampling import draw_sample, first_state, samples_needed, smallest_triangles
from ..geometry import Array, Ints
from ..jit import jit
from ..minimal.roots import MAX_ROOTS
from ..minimal.solution import ROW_SIZE
from ..minimal.solver import Workspace, workspace

# A new best hypothesis is refined in few steps, at first with a wide gate: four noisy points
# make a model that misses many of its inliers.
_WIDE = 100.0
_WIDE_STEPS = 3
_LOCAL_STEPS = 6
_LOCAL_TOLERANCE = 1e-3

# Where all of a view's points agree, with so many coordinates to spare, few samples do.
_MANY = 16
_FEW_SAMPLES = 3


class Search(NamedTuple):
    """How long to look, and how far from a model a point may be."""

    limit: float  # px², the square of the inliers' threshold
    confidence: float
    min_iterations: int
    max_iterations: int
    seed: int


class RansacRoom(NamedTuple):
    """Room for the loop, made once a call."""

    chosen: Ints
    rows: Array
    local: Array
    solver: Workspace
    refine: LeastSquaresRoom


@jit
def ransac_room() -> RansacRoom:
    """Make the room; inside compiled code that costs less than handing it over."""
    return RansacRoom(
        np.empty(4, dtype=np.int64),
        np.empty((MAX_ROOTS, ROW_SIZE)),
        np.empty(ROW_SIZE),
        workspace(),
        least_squares_room(),
    )


@jit
def search_best(problem: Problem, search: Search, best: Array) -> tuple[int, float]:
    """
    Find the model of least truncated cost; write it to ``best`` (ROW_SIZE,).

    Returned are the number of samples and the cost in px², infinite where none had a solution.
    """
    room = ransac_room()
    cost = math.inf
    state = first_state(search.seed)
    smallest = smallest_triangles(problem.board, search.limit)
    needed = math.inf
    at_least = search.min_iterations
    iteration = 0
    while iteration < search.max_iterations:
        if iteration >= min(at_least, search.min_iterations) and iteration >= needed:
            break
        iteration += 1
        state = draw_sample(problem.image, problem.board, smallest, state, room.chosen)
        for s in range(hypotheses(problem, room.chosen, room.rows, room.solver)):
            row = room.rows[s]
            score = truncated_cost(row, problem, search.limit, cost)
            if not score < cost:
                continue
            best[:] = row
            cost = _local_optimum(score, problem, search.limit, best, room)
            inliers = count_within(best, problem, search.limit)
            if inliers == len(problem.image) and 2 * inliers >= problem.unknowns + _MANY:
                at_least = _FEW_SAMPLES
            needed = samples_needed(inliers, len(problem.image), search.confidence)
    return iteration, cost


@jit
def _local_optimum(
    cost: float, problem: Problem, limit: float, best: Array, room: RansacRoom
) -> float:
    """Refine ``best`` in place where that lowers its cost; return the cost."""
    local = room.local
    local[:] = best
    minimise(local, problem, _WIDE * limit, _WIDE_STEPS, _LOCAL_TOLERANCE, room.refine)
    lower = minimise(local, problem, limit, _LOCAL_STEPS, _LOCAL_TOLERANCE, room.refine)
    if lower < cost and plausible(local, problem):
        best[:] = local
        return lower
    return cost
