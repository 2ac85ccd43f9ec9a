# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""
Least squares of the full model: Levenberg-Marquardt that measures the noise as it goes.

The prior on the bends depends on the focal length, and the weight of the priors on the noise: both
follow each step. Starts that are far from the optimum compete with fisheyes.

This module stands alone because it knows nothing of the result: ``full_fit`` makes that.
"""

from __future__ import annotations

import math
from typing import NamedTuple

from .full_model import (
    add_priors,
    BEND,
    BENDS,
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
from ..jit import jit, kernel
from ..linalg import copy_row, rotate, solve_in_place
from ..model.lens import CX, CY, POSE_COLUMNS
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
_TOLERANCE = 0.04
_QUICKLY = 0.1
_SMALL_GAIN, _NO_GAIN = 0.1, 1e-5

# A descent to a target gives up if a step goes less than this share of the way.
_ROUGHLY = 0.3

# Points beyond this many standard deviations of a coordinate are outliers of a gate that follows
# the noise.
GATE_SIGMAS = 4.0

# A gate that follows the noise grows at most to this multiple (squares): many outliers would
# otherwise pass for noise, and open it for more.
_WIDEST_GATE = 4.0

# Lower limit of the measured noise, px. The corners of photographs share errors (blur, sampling)
# that their residuals do not show.
SMALLEST_SIGMA_PX = 0.1

# Where points are off by little more than the threshold, or a fit does not converge, starts with
# the lenses of fisheyes are tried, with a wide limit: this multiple of the threshold (squares).
WIDE = 100.0
START_STEPS = 8
_HALF_FOVS_RAD = (0.5, 0.8, 1.1, 1.4)
_MOST_CLOSE_OUTLIERS = 0.02


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

    A pixel's ray goes through its point if  ρ (f + f b₁ τ² + f b₂ τ⁴ + ...) = r (Z + t_z),
    τ = r/R: it is linear in f, f bᵢ and t_z, and steps along that valley can be long.
    """
    share = 1.0 + trial[LENS + LOG_FOCAL] - state[LENS + LOG_FOCAL]
    if not 0.1 < share < 10.0:
        return False
    trial[LENS + LOG_FOCAL] = state[LENS + LOG_FOCAL] + math.log(share)
    for i in range(LENS + BEND, LENS + BEND + BENDS):
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
    if not gate.follows:
        return gate.limit
    return min(max(gate.limit, GATE_SIGMAS**2 * variance), _WIDEST_GATE * gate.limit)


@kernel
def _tolerance(cost: float, target: float) -> float:
    """Return the gain of chi-square below which a descent may end."""
    return _TOLERANCE if target == 0.0 else max(_TOLERANCE, _ROUGHLY * (cost - target))


@jit
def improve_start(
    state: Array, problem: FullProblem, noise: Noise, threshold2: float, work: FullWork
) -> None:
    """Replace the state by the best of those to which it and equidistant lenses lead."""
    gate = Gate(WIDE * threshold2, False)
    start, other = state.copy(), state.copy()
    cost = math.inf
    for i in range(len(_HALF_FOVS_RAD) + 1):
        copy_row(start, other)
        set_usual_bends(other, problem)
        if i > 0:
            _set_equidistant(other, problem, _HALF_FOVS_RAD[i - 1])
        lower = descend(other, problem, noise, gate, START_STEPS, 0.0, work).cost
        if lower < cost:
            cost = lower
            copy_row(other, state)
    set_usual_bends(state, problem)


@kernel
def slightly_off(squares: Array, threshold2: float) -> bool:
    """
    Return whether some points are beyond the threshold by so little that the lens may be wrong.

    Few outliers of a search are that close to their places.
    """
    count = 0
    for square in squares:
        if threshold2 <= square < WIDE * threshold2:
            count += 1
    return count >= 2 and count > _MOST_CLOSE_OUTLIERS * len(squares)


@jit
def _set_equidistant(state: Array, problem: FullProblem, half_fov_rad: float) -> None:
    """
    Replace the lens by an equidistant one, and turn and move the board to the same place in it.

    Its ray has the depth  r / tan(r) = 1 - r²/3 - r⁴/45 - 2 r⁶/945 - ...,  r its angle.
    """
    mx = my = 0.0
    for i in range(len(problem.image)):
        mx += (problem.image[i, 0] - state[LENS + CX]) / len(problem.image)
        my += (problem.image[i, 1] - state[LENS + CY]) / len(problem.image)
    radius_px = math.sqrt(mx * mx + my * my) + 1e-6 * problem.corner_px
    focal_px = problem.corner_px / half_fov_rad
    tx, ty, tz = state[TRANSLATION], state[TRANSLATION + 1], state[TRANSLATION + 2]
    distance = math.sqrt(tx * tx + ty * ty + tz * tz)
    ax, ay, az = tx / distance, ty / distance, tz / distance
    angle = radius_px / focal_px
    sine = math.sin(angle)
    bx, by, bz = mx / radius_px * sine, my / radius_px * sine, math.cos(angle)
    # The size across the ray stays the same.
    sine_before = math.sqrt(ax * ax + ay * ay)
    at_axis = focal_px * math.exp(-state[LENS + LOG_FOCAL])
    distance *= sine_before / sine if sine_before > 0.05 and sine > 0.05 else at_axis
    # The rotation that maps a to b: for ``rotate``, twice the tangent of half the angle.
    scale = 2.0 / max(1.0 + ax * bx + ay * by + az * bz, 0.1)
    wx, wy, wz = ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx
    before = state.copy()
    rotate(before, scale * wx, scale * wy, scale * wz, state)
    state[TRANSLATION], state[TRANSLATION + 1] = distance * bx, distance * by
    state[TRANSLATION + 2] = distance * bz
    square = half_fov_rad * half_fov_rad
    state[LENS + LOG_FOCAL] = math.log(focal_px)
    state[LENS + BEND] = -square / 3.0
    state[LENS + BEND + 1] = -square * square / 45.0
    state[LENS + BEND + 2] = -2.0 * square * square * square / 945.0
    state[LENS + BEND + 3] = 0.0
    set_usual_bends(state, problem)
