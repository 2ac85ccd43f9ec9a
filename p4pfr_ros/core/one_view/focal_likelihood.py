# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""
How likely another focal length is, all else fitted again.

This module stands alone because it is compiled; ``full_estimate`` decides what follows.
"""

from __future__ import annotations

import math

from .full_descent import chi2_of, descend, Gate, Noise, START_STEPS, WIDE
from .full_model import full_work, FullProblem, LENS, LOG_FOCAL, set_usual_bends, write_squares
from ..geometry import Array, TRANSLATION
from ..jit import jit

# With another focal length: number of steps, and the information that holds its logarithm.
_HELD_STEPS = 8
_HOPELESS = 20.0
_HELD = 1e10


@jit
def other_focal_excess(
    state: Array,
    problem: FullProblem,
    factor: float,
    variance: float,
    limit: float,
    enough: float,
) -> float:
    """
    Return by how much chi-square grows with another focal length, all else fitted again.

    A value well beyond ``enough``, or well below, is rough.

    Near fronto-parallel views the standard deviation misleads: the estimate rests on a tilt that
    is noise, and at that tilt the focal length seems determined.
    """
    work = full_work(len(problem.image))
    write_squares(state, problem, work)
    cost = chi2_of(state, problem, variance, limit, work)
    other = state.copy()
    # The size in the image stays the same.
    other[LENS + LOG_FOCAL] += math.log(factor)
    other[TRANSLATION + 2] *= factor
    mean, information = problem.mean.copy(), problem.information.copy()
    for i in range(len(mean)):
        information[LOG_FOCAL, i] = information[i, LOG_FOCAL] = 0.0
    mean[LOG_FOCAL], information[LOG_FOCAL, LOG_FOCAL] = other[LENS + LOG_FOCAL], _HELD
    held = FullProblem(
        problem.image,
        problem.board,
        problem.corner_px,
        mean,
        information,
        problem.usual,
        problem.sizes,
        problem.active,
    )
    set_usual_bends(other, held)
    noise, target = Noise(variance, False, 0.0), cost + 0.5 * enough
    descend(other, held, noise, Gate(WIDE * limit, False), START_STEPS, target, work)
    excess = chi2_of(other, problem, variance, limit, work) - cost
    if excess > _HOPELESS * enough:
        return excess
    descend(other, held, noise, Gate(limit, False), _HELD_STEPS, target, work)
    write_squares(other, problem, work)
    return chi2_of(other, problem, variance, limit, work) - cost
