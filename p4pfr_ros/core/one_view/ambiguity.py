# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""
Other local optima that explain a view as well: the flip, and other roots of the samples.

A small or far board has a second pose that explains its picture nearly as well: mirroring its
normal in the line of sight changes a weak perspective view not at all. With a free camera the
minimal problem has up to six solutions, and a few points more need not tell them apart.
"""

from __future__ import annotations

import math

import numpy as np

from .least_squares import minimise, truncated_cost
from .problem import hypotheses, plausible, POSE, Problem
from .ransac import RansacRoom
from .sampling import draw_sample, first_state, smallest_triangles
from ..geometry import Array
from ..jit import jit
from ..minimal.solution import ROW_SIZE, TRANSLATION

# At most so many alternatives are told.
MAX_OTHERS = 6

# Poses closer than this are the same optimum; starts closer than that lead there. Radians.
_SAME_RAD = 0.02
_SAME_START_RAD = 0.2

# Whether a start leads anywhere else is mostly clear after few steps.
_WIDE = 100.0
_FIRST_STEPS = 6
_FIRST_TOLERANCE = 1e-2
_PROMISING = 10.0
_LAST_STEPS = 100
_LAST_TOLERANCE = 1e-12

_SAMPLES = 8
_NO_ROWS = np.empty((0, ROW_SIZE))

# A start whose points are mostly this far off is not worth a step.
_HALF = 0.5


@jit
def other_optima(
    problem: Problem,
    best: Array,
    cost: float,
    limit: float,
    excess: float,
    others: Array,
    costs: Array,
    room: RansacRoom,
) -> int:
    """
    Write to ``others`` (MAX_OTHERS, ROW_SIZE) what costs at most the excess (px²) more.

    costs (MAX_OTHERS,) px² is theirs: a lower one than the best's is found now and then.
    Returned is their number.
    """
    _mirror(best, room.local)
    count = _consider(problem, best, cost, limit, excess, others, costs, 0, room)
    if problem.unknowns == POSE or len(problem.image) == 4:
        return count
    state = first_state(0)
    smallest = smallest_triangles(problem.board, limit)
    for _ in range(_SAMPLES):
        state = draw_sample(problem.image, problem.board, smallest, state, room.chosen)
        for s in range(hypotheses(problem, room.chosen, room.rows, room.solver)):
            room.local[:] = room.rows[s]
            if _is_new(room.local, best, others, count, _SAME_START_RAD):
                count = _consider(problem, best, cost, limit, excess, others, costs, count, room)
    return count


@jit
def _consider(
    problem: Problem,
    best: Array,
    cost: float,
    limit: float,
    excess: float,
    others: Array,
    costs: Array,
    count: int,
    room: RansacRoom,
) -> int:
    """Refine the room's local row and keep it if it is another optimum, and good enough."""
    local = room.local
    if count == MAX_OTHERS:
        return count
    wide = _WIDE * limit
    hopeless = _HALF * wide * len(problem.image)
    if truncated_cost(local, problem, wide, hopeless) > hopeless:
        return count
    minimise(local, problem, wide, _FIRST_STEPS, _FIRST_TOLERANCE, room.refine)
    found = minimise(local, problem, limit, _FIRST_STEPS, _FIRST_TOLERANCE, room.refine)
    if found > cost + _PROMISING * excess or not _is_new(local, best, others, count, _SAME_RAD):
        return count
    found = minimise(local, problem, limit, _LAST_STEPS, _LAST_TOLERANCE, room.refine)
    if (
        found <= cost + excess
        and plausible(local, problem)
        and _is_new(local, best, others, count, _SAME_RAD)
    ):
        others[count] = local
        costs[count] = found
        count += 1
    return count


@jit
def _is_new(row: Array, best: Array, others: Array, count: int, angle_rad: float) -> bool:
    """Say whether a rotation differs from the best and from all others by an angle."""
    # |A - B|² = 8 sin²(angle / 2)
    least = 8.0 * math.sin(0.5 * angle_rad) ** 2
    new = _squared_chord(row, best) > least
    for i in range(count):
        new = new and _squared_chord(row, others[i]) > least
    return new


@jit
def same_optimum(row: Array, other: Array) -> bool:
    """Say whether two refined rows are the same local optimum."""
    return not _is_new(row, other, _NO_ROWS, 0, _SAME_RAD)


@jit
def _squared_chord(a: Array, b: Array) -> float:
    total = 0.0
    for i in range(TRANSLATION):
        total += (a[i] - b[i]) * (a[i] - b[i])
    return total


@jit
def _mirror(row: Array, mirrored: Array) -> None:
    """Turn the board so that its normal n is mirrored in the line of sight v."""
    mirrored[:] = row
    x, y, z = row[TRANSLATION], row[TRANSLATION + 1], row[TRANSLATION + 2]
    length = math.sqrt(x * x + y * y + z * z)
    x, y, z = x / length, y / length, z / length
    along = row[2] * x + row[5] * y + row[8] * z
    # Half a turn about v takes n to the mirrored normal; half a turn about that keeps it, and
    # undoes the turn within the plane.
    nx, ny, nz = 2.0 * along * x - row[2], 2.0 * along * y - row[5], 2.0 * along * z - row[8]
    _half_turn(mirrored, x, y, z)
    _half_turn(mirrored, nx, ny, nz)


@jit
def _half_turn(row: Array, x: float, y: float, z: float) -> None:
    """Turn a rotation by π about a unit axis:  c -> 2 (a · c) a - c  for each column."""
    for j in range(3):
        twice = 2.0 * (x * row[j] + y * row[3 + j] + z * row[6 + j])
        row[j] = twice * x - row[j]
        row[3 + j] = twice * y - row[3 + j]
        row[6 + j] = twice * z - row[6 + j]
