# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""From the best row to all that there is to say of it, in one compiled call."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from .ambiguity import MAX_OTHERS, other_optima
from .least_squares import minimise, normal_equations, truncated_cost
from .prior import prior_cost
from .problem import hypotheses, plausible, Problem, squared_errors
from .ransac import ransac_room, RansacRoom
from ..geometry import Array
from ..jit import jit
from ..minimal.solution import ROW_SIZE
from ..model.uncertainty import (
    covariance_from,
    DEFAULT_SIGMA_PX,
    largest_excess,
    noise_variance,
    posterior_variance,
)

# Twice the log of the likelihood ratio beyond which the worse optimum is out: one in a hundred.
MAX_RATIO = 9.21

STEPS = 100
_TOLERANCE = 1e-13

# Costs closer than rounding do not make another optimum the better one.
_BETTER = 1.0 - 1e-9


class Conclusion(NamedTuple):
    """
    Room for the answer.

    squares (N,) px² and covariance (8, 8) of the model; others (MAX_OTHERS, ROW_SIZE) and their
    costs (MAX_OTHERS,) px².
    """

    squares: Array
    covariance: Array
    others: Array
    costs: Array


class Summary(NamedTuple):
    """Inliers, the sum of their squared errors, a coordinate's variance (px²), other optima."""

    inliers: int
    total: float
    variance: float
    others: int


def conclusion_room(n: int) -> Conclusion:
    """Make the room for a view of n points."""
    return Conclusion(
        np.empty(n), np.empty((8, 8)), np.empty((MAX_OTHERS, ROW_SIZE)), np.empty(MAX_OTHERS)
    )


@jit
def inliers_of(row: Array, problem: Problem, limit: float, squares: Array) -> tuple[int, float]:
    """Write the squared errors; return the number of those below the limit, and their sum."""
    squared_errors(row, problem, squares)
    count = 0
    total = 0.0
    for square in squares:
        if square < limit:
            count += 1
            total += square
    return count, total


@jit
def measured_noise(
    problem: Problem, beforehand: float, inliers: tuple[int, float], limit: float, sigma_px: float
) -> tuple[float, int]:
    """
    Return the variance of the noise, px², and how many coordinates to spare measured it.

    beforehand: the prior's own squares, px². Zero coordinates: the noise was given (sigma_px > 0),
    or four points leave too few.
    """
    if sigma_px > 0.0:
        return sigma_px * sigma_px, 0
    count, total = inliers
    prior = problem.prior
    known = (1 if prior.focal_weight > 0.0 else 0) + (1 if prior.k_weight > 0.0 else 0)
    spare = 2 * count + known - problem.unknowns
    if len(problem.image) == 4 or spare <= 0:
        return DEFAULT_SIGMA_PX * DEFAULT_SIGMA_PX, 0
    return noise_variance(total + beforehand, spare, limit), spare


@jit
def conclude(
    row: Array,
    problem: Problem,
    limit: float,
    sigma_px: float,
    board: tuple[float, float, float],
    seek: bool,
    steps: int,
    found: Conclusion,
) -> tuple[int, float, float, int]:
    """
    Refine ``row`` in place, in so many steps at most, and fill the conclusion.

    sigma_px 0: the noise is measured.

    Returned is what ``Summary`` holds; the number of other optima only where they are sought.
    """
    room = ransac_room()
    cost, count, total, variance, spare = _refined(
        row, problem, limit, sigma_px, board, steps, found, room
    )
    others = 0
    if seek:
        excess = largest_excess(variance, spare, MAX_RATIO)
        others = other_optima(problem, row, cost, limit, excess, found.others, found.costs, room)
        if _exchanged(row, cost, others, found, room):
            _, count, total, variance, _ = _refined(
                row, problem, limit, sigma_px, board, steps, found, room
            )
    return count, total, variance, others


@jit
def _refined(
    row: Array,
    problem: Problem,
    limit: float,
    sigma_px: float,
    board: tuple[float, float, float],
    steps: int,
    found: Conclusion,
    room: RansacRoom,
) -> tuple[float, int, float, float, int]:
    """Return the cost, the inliers' number and sum, and the noise with what measured it."""
    room.local[:] = row
    cost = minimise(room.local, problem, limit, steps, _TOLERANCE, room.refine)
    if plausible(room.local, problem):
        row[:] = room.local
    else:
        cost = truncated_cost(row, problem, limit, math.inf)
    count, total = inliers_of(row, problem, limit, found.squares)
    variance, spare = measured_noise(
        problem, prior_cost(row, problem.prior), (count, total), limit, sigma_px
    )
    normal_equations(row, problem, limit, room.refine)
    widened = posterior_variance(variance, spare, limit)
    system = room.refine.system
    covariance_from(
        room.refine.normal, problem.unknowns, widened, row, board, system, found.covariance
    )
    return cost, count, total, variance, spare


@jit
def _exchanged(row: Array, cost: float, others: int, found: Conclusion, room: RansacRoom) -> bool:
    """Exchange the row with the best of the others, if that is better; say whether."""
    best = -1
    for i in range(others):
        if found.costs[i] < cost * _BETTER:
            cost = found.costs[i]
            best = i
    if best >= 0:
        room.local[:] = row
        row[:] = found.others[best]
        found.others[best] = room.local
    return best >= 0


@jit
def refine_wide(row: Array, problem: Problem, wide: float, limit: float) -> None:
    """Refine a row that is some way off, first with a wide limit."""
    room = ransac_room().refine
    minimise(row, problem, wide, STEPS, _TOLERANCE, room)
    minimise(row, problem, limit, STEPS, _TOLERANCE, room)


@jit
def solve_four(problem: Problem, rows: Array) -> int:
    """Write the solutions of a view of exactly four points; return their number."""
    return hypotheses(problem, np.arange(4), rows, ransac_room().solver)


@jit
def refine_all(rows: Array, count: int, problem: Problem, costs: Array) -> None:
    """Refine each row over all points, none taken for an outlier; write the costs (count,)."""
    room = ransac_room()
    for s in range(count):
        costs[s] = minimise(rows[s], problem, math.inf, STEPS, _TOLERANCE, room.refine)
