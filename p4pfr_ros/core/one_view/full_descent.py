# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""
Least squares of the full model: Levenberg-Marquardt that measures the noise as it goes.

The prior on the bends depends on the focal length, and the weight of the priors on the noise: both
follow each step.

This module stands alone because it knows no starts, and nothing of the result: ``full_fit`` does.
"""

from __future__ import annotations

import math
from typing import NamedTuple

from .full_model import (
    add_priors,
    BEND,
    FullProblem,
    FullWork,
    LENS,
    LOG_FOCAL,
    normal_equations,
    PARAMETERS,
    prior_chi2,
    set_usual_bends,
)
from ..geometry import Array, POSE_SIZE, TRANSLATION
from ..jit import kernel
from ..linalg import copy_row, rotate, solve_in_place
from ..model.lens import POSE_COLUMNS
from ..model.uncertainty import noise_variance

# Damping, relative to the diagonal. Along f, t_z and the bends the problem is ill-conditioned:
# there even little damping would make least squares creep.
FIRST_DAMPING = 1e-8
_SMALLEST_DAMPING = 1e-10
_DAMPED = 1e-4
_LARGEST_DAMPING = 1e8

# The damping falls after a step that lowers chi-square by this share of what was expected.
_AS_EXPECTED = 0.8

# Converged: the next step would lower chi-square by less than the first, and by a small share of
# the step before. In a curved valley many small gains may follow each other.
_TOLERANCE = 0.01
_QUICKLY = 0.1
_SMALL_GAIN, _NO_GAIN = 0.1, 1e-5

# A descent to a target gives up if a step goes less than this share of the way.
_ROUGHLY = 0.3

# Points beyond this many standard deviations of a coordinate are outliers of a gate that follows
# the noise.
GATE_SIGMAS = 4.0

# Lower limit of the measured noise, px. The corners of photographs share errors (blur, sampling)
# that their residuals do not show.
SMALLEST_SIGMA_PX = 0.1


class Noise(NamedTuple):
    """
    Variance of a coordinate, px², and how it is known.

    measured: it follows from the residuals; determined: number of parameters that the points
    determine, to count degrees of freedom.
    """

    variance: float
    measured: bool
    determined: float


class Gate(NamedTuple):
    """Squared errors beyond ``limit``, px², are outliers; ``follows``: it grows with the noise."""

    limit: float
    follows: bool


class Descent(NamedTuple):
    """Chi-square, noise variance (px²), inliers, sum of their squares (px²), and the outcome."""

    cost: float
    variance: float
    inliers: int
    total: float
    converged: bool


@kernel
def step(state: Array, problem: FullProblem, damping: float, work: FullWork) -> float:
    """
    Write the state after one damped step to work.trial.

    Return by how much a quadratic cost would fall, px²; a negative number if there is no step.
    """
    active, system, trial = problem.active, work.system, work.trial
    m = len(active)
    for a in range(m):
        for b in range(m):
            system[a, b] = work.normal[active[a], active[b]]
        system[a, a] *= 1.0 + damping
        system[a, m] = work.normal[active[a], PARAMETERS]
    if not solve_in_place(system, m):
        return -1.0
    gain = 0.0
    for a in range(m):
        gain += system[a, m] * work.normal[active[a], PARAMETERS]
    copy_row(state, trial)
    for a in range(POSE_COLUMNS, m):
        trial[active[a] + POSE_SIZE - POSE_COLUMNS] += system[a, m]
    rotate(state, system[0, m], system[1, m], system[2, m], trial)
    for i in range(3):
        trial[TRANSLATION + i] += system[3 + i, m]
    return gain if _straighten(state, trial) else -1.0


@kernel
def _straighten(state: Array, trial: Array) -> bool:
    """
    Move a step of log f and the bends onto a straight line of f and f bᵢ; False if f is not > 0.

    A pixel's ray goes through its point if  ρ (f + f b₁ τ² + f b₂ τ⁴ + f b₃ τ⁶) = r (Z + t_z),
    τ = r/R: it is linear in f, f bᵢ and t_z, and steps along that valley can be long.
    """
    share = 1.0 + trial[LENS + LOG_FOCAL] - state[LENS + LOG_FOCAL]
    if not 0.1 < share < 10.0:
        return False
    trial[LENS + LOG_FOCAL] = state[LENS + LOG_FOCAL] + math.log(share)
    for i in range(LENS + BEND, LENS + BEND + 3):
        trial[i] = state[i] + (trial[i] - state[i]) / share
    return True


@kernel
def chi2_of(
    state: Array, problem: FullProblem, variance: float, limit: float, work: FullWork
) -> float:
    """Return chi-square of squared errors, each truncated at the limit, and of the priors."""
    total = 0.0
    for i in range(len(work.squares)):
        total += min(work.squares[i], limit)
    return total / variance + prior_chi2(state, problem)


@kernel
def _measured(noise: Noise, count: int, total: float, limit: float) -> float:
    """Return the variance of the noise, px², measured if it is to be."""
    dof = 2.0 * count - noise.determined
    if not noise.measured or not dof >= 1.0:
        return noise.variance
    return max(noise_variance(total, int(dof), limit), SMALLEST_SIGMA_PX**2)


@kernel
def descend(
    state: Array,
    problem: FullProblem,
    noise: Noise,
    gate: Gate,
    max_steps: int,
    target: float,
    work: FullWork,
) -> Descent:
    """
    Minimise the truncated chi-square in place by Levenberg-Marquardt.

    It ends after max_steps, at a chi-square below the target (0: none), or when it has converged;
    work.points and work.squares are those of the state. work.trial is one step further.
    """
    variance = noise.variance
    limit = _limit(gate, variance)
    count, total = normal_equations(state, problem, limit, work)
    variance = _measured(noise, count, total, limit)
    cost = chi2_of(state, problem, variance, limit, work)
    damping, converged, before = FIRST_DAMPING, False, _SMALL_GAIN
    for _ in range(max_steps):
        if count < 4 or cost < target or damping > _LARGEST_DAMPING:
            break
        add_priors(state, problem, variance, work)
        gain = step(state, problem, damping, work) / variance
        if 0.0 <= gain <= _tolerance(cost, target) and damping <= _DAMPED:
            converged = gain <= max(_QUICKLY * before, _NO_GAIN)
            if converged:
                break
        lower = math.inf
        if gain >= 0.0:
            count, total = normal_equations(work.trial, problem, limit, work)
            lower = chi2_of(work.trial, problem, variance, limit, work)
        if not lower < cost:
            count, total = normal_equations(state, problem, limit, work)
            damping = max(10.0 * damping, _DAMPED)
            continue
        copy_row(work.trial, state)
        if cost - lower > _AS_EXPECTED * gain:
            damping = max(0.1 * damping, _SMALLEST_DAMPING)
        before, variance = gain, _measured(noise, count, total, limit)
        limit = _limit(gate, variance)
        set_usual_bends(state, problem)
        cost = chi2_of(state, problem, variance, limit, work)
    return Descent(cost, variance, count, total, converged)


@kernel
def _limit(gate: Gate, variance: float) -> float:
    """Return the squared error beyond which a point is an outlier, px²."""
    return max(gate.limit, GATE_SIGMAS**2 * variance) if gate.follows else gate.limit


@kernel
def _tolerance(cost: float, target: float) -> float:
    """Return the gain of chi-square below which a descent may end."""
    return _TOLERANCE if target == 0.0 else max(_TOLERANCE, _ROUGHLY * (cost - target))
