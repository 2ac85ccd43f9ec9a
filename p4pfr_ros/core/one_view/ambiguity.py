# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""
Alternatives: other local optima, and other focal lengths, that explain a view as well.

A small or far board has a second pose that explains its image nearly as well: mirroring its normal
in the line of sight does not change a weak perspective view. With a free camera the minimal
problem has up to six solutions, and a few more points need not distinguish them.
"""

from __future__ import annotations

import math

import numpy as np

from .free_camera import Prior
from .least_squares import (
    count_within,
    hypotheses,
    least_squares_work,
    minimise,
    plausible,
    POSE,
    Problem,
    truncated_cost,
)
from .ransac import draw_sample, first_state, RansacWork, smallest_triangles
from ..geometry import Array, TRANSLATION
from ..jit import jit
from ..linalg import copy_row
from ..minimal.solution import G, H, ROW_SIZE

# Largest number of alternatives.
MAX_OTHERS = 6

# Optima with rotations closer than this, rad, are the same; starts closer than the second angle
# lead to the same optimum.
_SAME_RAD = 0.02
_SAME_START_RAD = 0.2

# A few steps mostly show whether a start leads to another optimum.
_WIDE = 100.0
_FIRST_STEPS = 6
_FIRST_TOLERANCE = 1e-2
_PROMISING = 10.0
_LAST_STEPS = 100
_LAST_TOLERANCE = 1e-12

_SAMPLES = 8
_NO_ROWS = np.empty((0, ROW_SIZE))

# A start with more than this share of the inliers beyond the wide limit is not refined.
_MOST_BEYOND = 0.5

# An observable focal length must be distinguishable from its half and its double.
_FOCAL_FACTOR = 2.0

# Weight of a prior that holds the focal length within about a pixel.
_HOLDING_WEIGHT = 1.0

_HELD_STEPS = 30
_HELD_TOLERANCE = 1e-4


@jit
def other_optima(
    problem: Problem,
    best: Array,
    cost: float,
    limit: float,
    excess: float,
    others: Array,
    costs: Array,
    work: RansacWork,
) -> int:
    """
    Write the other optima to ``others`` (MAX_OTHERS, ROW_SIZE), and return their number.

    They cost at most ``excess`` (px²) more than the best; their costs, of which one may even be
    lower, go to costs (MAX_OTHERS,), px².
    """
    _mirror(best, work.local)
    count = _try_local_row(problem, best, cost, limit, excess, others, costs, 0, work)
    if problem.unknowns == POSE or len(problem.image) == 4:
        return count
    state = first_state(0)
    smallest = smallest_triangles(problem.board, limit)
    for _ in range(_SAMPLES):
        state = draw_sample(problem.image, problem.board, smallest, state, work.chosen)
        for s in range(hypotheses(problem, work.chosen, work.rows, work.solver)):
            copy_row(work.rows[s], work.local)
            if _is_new(work.local, best, others, count, _SAME_START_RAD):
                count = _try_local_row(
                    problem, best, cost, limit, excess, others, costs, count, work
                )
    return count


@jit
def _try_local_row(
    problem: Problem,
    best: Array,
    cost: float,
    limit: float,
    excess: float,
    others: Array,
    costs: Array,
    count: int,
    work: RansacWork,
) -> int:
    """Refine ``work.local``; append it to others if it is a new optimum and within the excess."""
    local = work.local
    if count == MAX_OTHERS:
        return count
    wide = _WIDE * limit
    # Outliers of the best row, at most cost / limit, are outliers of the others, too.
    outliers = min(cost / limit, 1.0 * len(problem.image))
    hopeless = wide * (outliers + _MOST_BEYOND * (len(problem.image) - outliers))
    if truncated_cost(local, problem, wide, hopeless) > hopeless:
        return count
    if 2 * count_within(local, problem, limit) < len(problem.image) - outliers:
        minimise(local, problem, wide, _FIRST_STEPS, _FIRST_TOLERANCE, work.refine)
    refined_cost = minimise(local, problem, limit, _FIRST_STEPS, _FIRST_TOLERANCE, work.refine)
    if refined_cost > cost + _PROMISING * excess or not _is_new(
        local, best, others, count, _SAME_RAD
    ):
        return count
    refined_cost = minimise(local, problem, limit, _LAST_STEPS, _LAST_TOLERANCE, work.refine)
    if (
        refined_cost <= cost + excess
        and plausible(local, problem)
        and _is_new(local, best, others, count, _SAME_RAD)
    ):
        copy_row(local, others[count])
        costs[count] = refined_cost
        count += 1
    return count


@jit
def _is_new(row: Array, best: Array, others: Array, count: int, angle_rad: float) -> bool:
    """Return whether a rotation differs from the best and from all others by the angle."""
    # |A - B|² = 8 sin²(angle / 2)
    least = 8.0 * math.sin(0.5 * angle_rad) ** 2
    new = _squared_chord(row, best) > least
    for i in range(count):
        new = new and _squared_chord(row, others[i]) > least
    return new


@jit
def same_optimum(row: Array, other: Array) -> bool:
    """Return whether two refined rows are the same local optimum."""
    return not _is_new(row, other, _NO_ROWS, 0, _SAME_RAD)


@jit
def _squared_chord(a: Array, b: Array) -> float:
    total = 0.0
    for i in range(TRANSLATION):
        total += (a[i] - b[i]) * (a[i] - b[i])
    return total


@jit
def _mirror(row: Array, mirrored: Array) -> None:
    """Rotate the board so that its normal n is mirrored in the line of sight v."""
    copy_row(row, mirrored)
    x, y, z = row[TRANSLATION], row[TRANSLATION + 1], row[TRANSLATION + 2]
    length = math.sqrt(x * x + y * y + z * z)
    x, y, z = x / length, y / length, z / length
    along = row[2] * x + row[5] * y + row[8] * z
    # Half a turn about v maps n to the mirrored normal; half a turn about that normal undoes the
    # rotation within the plane.
    nx, ny, nz = 2.0 * along * x - row[2], 2.0 * along * y - row[5], 2.0 * along * z - row[8]
    _half_turn(mirrored, x, y, z)
    _half_turn(mirrored, nx, ny, nz)


@jit
def _half_turn(row: Array, x: float, y: float, z: float) -> None:
    """Rotate a rotation by π about a unit axis:  c -> 2 (a · c) a - c  for each column."""
    for j in range(3):
        twice = 2.0 * (x * row[j] + y * row[3 + j] + z * row[6 + j])
        row[j] = twice * x - row[j]
        row[3 + j] = twice * y - row[3 + j]
        row[6 + j] = twice * z - row[6 + j]


@jit
def another_focal_fits(row: Array, problem: Problem, limit: float, excess: float) -> bool:
    """
    Return whether half or twice the focal length raises the cost by less than ``excess``, px².

    All other unknowns are refitted by least squares. row: the estimate; limit: of inliers, px².

    Near fronto-parallel views the standard deviation misleads: the estimate rests on a tilt that
    is noise, and at that tilt the focal length seems determined.
    """
    cost = truncated_cost(row, problem, limit, math.inf)
    work = least_squares_work()
    fits = False
    for factor in (1.0 / _FOCAL_FACTOR, _FOCAL_FACTOR):
        prior = Prior(factor * row[G], _HOLDING_WEIGHT, problem.prior.k, problem.prior.k_weight)
        held = Problem(
            problem.image,
            problem.board,
            problem.unknowns,
            problem.gates,
            prior,
            problem.rays,
            problem.across,
            problem.squares,
        )
        # The size in the image and the bend stay the same: the distance scales with f, h with g.
        other = row.copy()
        other[G] *= factor
        other[H] *= factor
        other[TRANSLATION + 2] *= factor
        minimise(other, held, _WIDE * limit, _HELD_STEPS, _HELD_TOLERANCE, work)
        fits = (
            fits
            or minimise(other, held, limit, _HELD_STEPS, _HELD_TOLERANCE, work) - cost < excess
        )
    return fits
