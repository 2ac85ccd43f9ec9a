# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""
The full fit of one view: the maximum of the posterior, with the covariance that follows.

``full_model`` has the parameters. The prior on the bends depends on the focal length, and the
noise on the fit, so rounds of least squares alternate with measuring both.

This module stands alone because it is the fit; ``full_estimate`` makes a result of it.
"""

from __future__ import annotations

import math

import numpy as np

from .full_model import (
    BEND,
    chi2,
    DEVIATION_COLUMN,
    FullProblem,
    FullWork,
    LENS,
    LENS_COLUMN,
    lens_of,
    LOG_FOCAL,
    normal_equations,
    PARAMETERS,
    prior_chi2,
    squared_error,
    STATE_SIZE,
)
from ..geometry import Array, POSE_SIZE, TRANSLATION
from ..jit import jit, kernel
from ..linalg import invert_information, rotate, solve_in_place
from ..model.lens import CX, CY, FOCAL, K, POSE_COLUMNS
from ..model.uncertainty import (
    COV_FOCAL,
    COV_K,
    COVARIANCE_SIZE,
    noise_variance,
    pose_to_public,
    posterior_variance,
)

_FIRST_DAMPING = 1e-4
_SMALLEST_DAMPING = 1e-12
_LARGEST_DAMPING = 1e8

# Each round measures the noise and fits, until the noise changes by less than this share; then the
# last one fits to the end.
_ROUNDS = 10
_SAME_NOISE = 0.02
_STEPS, _TOLERANCE = 20, 1e-3
_LAST_STEPS, _LAST_TOLERANCE = 100, 1e-9

# Points beyond this many standard deviations of a coordinate are outliers in the rounds before
# the last, if that is more than the threshold: a start may be far from its optimum.
_GATE_SIGMAS = 4.0

# Standard deviations of k, k2 and k3 of real lenses (an equidistant one has about -1/3, -1/45 and
# -2/945), and of the bends of lenses so long that this would allow hardly any.
_TERM_SPREADS = (0.4, 0.03, 0.003)
_BEND_SPREADS = (0.2, 0.1, 0.02)

# Starts are first improved with a wide limit, this multiple of the threshold (both squared).
_WIDE = 100.0
_START_ROUNDS, _START_STEPS = 3, 10
_CONVERGED = 1e-4

# Information that holds a logarithm of the focal length.
_HELD = 1e10

# Lower limit of the measured noise, px. The corners of photographs share errors (blur, sampling)
# that their residuals do not show.
_SMALLEST_SIGMA_PX = 0.1


@kernel
def _step(state: Array, problem: FullProblem, damping: float, work: FullWork) -> bool:
    """Write the state after one damped step to work.trial; return False if there is none."""
    active, system, trial = problem.active, work.system, work.trial
    m = len(active)
    for a in range(m):
        for b in range(m):
            system[a, b] = work.normal[active[a], active[b]]
        system[a, a] *= 1.0 + damping
        system[a, m] = work.normal[active[a], PARAMETERS]
    if not solve_in_place(system, m):
        return False
    for i in range(STATE_SIZE):
        trial[i] = state[i]
    for a in range(POSE_COLUMNS, m):
        trial[active[a] + POSE_SIZE - POSE_COLUMNS] += system[a, m]
    rotate(state, system[0, m], system[1, m], system[2, m], trial)
    for i in range(3):
        trial[TRANSLATION + i] += system[3 + i, m]
    return bool(abs(trial[LENS + LOG_FOCAL]) < 100.0)


@kernel
def minimise_full(
    state: Array,
    problem: FullProblem,
    variance: float,
    limit: float,
    max_steps: int,
    tolerance: float,
    work: FullWork,
) -> float:
    """Minimise the truncated chi-square in place by Levenberg-Marquardt; return it."""
    cost = chi2(state, problem, variance, limit, math.inf, work.lens)
    damping = _FIRST_DAMPING
    moved = True
    for _ in range(max_steps):
        if moved and normal_equations(state, problem, variance, limit, work) < 4:
            break
        moved = False
        lower = math.inf
        if _step(state, problem, damping, work):
            lower = chi2(work.trial, problem, variance, limit, cost, work.lens)
        if lower < cost:
            gain = cost - lower
            for i in range(STATE_SIZE):
                state[i] = work.trial[i]
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


@kernel
def _set_usual_bends(state: Array, problem: FullProblem) -> None:
    """Set the prior on the bends to that of real lenses with the state's focal length."""
    if not problem.usual > 0.0:
        return
    log_unit = 2.0 * (math.log(problem.corner_px) - state[LENS + LOG_FOCAL])
    unit = math.exp(min(max(log_unit, -50.0), 50.0))
    power = 1.0
    for i in range(3):
        power *= unit
        spread2 = (_TERM_SPREADS[i] * power) ** 2 + _BEND_SPREADS[i] ** 2
        problem.information[BEND + i, BEND + i] = 1.0 / (problem.usual**2 * spread2)


@kernel
def _relax_lens(
    state: Array, problem: FullProblem, limit: float, sigma_px: float, work: FullWork
) -> bool:
    """
    Write the state with the best lens and distance for its rotation, tx and ty to work.trial.

    With τ = r/R, the ray of a pixel goes through its point if
        ρ (1 + b₁ τ² + b₂ τ⁴ + b₃ τ⁶) f = r (Z + t_z),
    which is linear in f, f b₁, f b₂, f b₃ and t_z: in one step they go as far as least squares
    would creep in hundreds, since a change of f must move t_z and all bends along.
    """
    system, trial = work.system, work.trial
    for a in range(5):
        for b in range(6):
            system[a, b] = 0.0
    lens_of(state, problem.corner_px, work.lens)
    by = work.covariance[0]  # scratch
    for i in range(len(problem.image)):
        if not squared_error(state, work.lens, problem, i) < limit:
            continue
        _relaxing_row(state, problem, i, by)
        for a in range(5):
            for b in range(6):
                system[a, b] += by[a] * by[b]
    focal_px = math.exp(state[LENS + LOG_FOCAL])
    for i in range(3):
        information = problem.information[BEND + i, BEND + i]
        system[1 + i, 1 + i] += information * (sigma_px / focal_px) ** 2
    if not solve_in_place(system, 5) or not system[0, 5] > 0.0:
        return False
    for i in range(STATE_SIZE):
        trial[i] = state[i]
    trial[TRANSLATION + 2] = system[4, 5]
    trial[LENS + LOG_FOCAL] = math.log(system[0, 5])
    for i in range(3):
        trial[LENS + BEND + i] = system[1 + i, 5] / system[0, 5]
    return True


@kernel
def _relaxing_row(state: Array, problem: FullProblem, i: int, by: Array) -> None:
    """Write the coefficients of f, f b₁, f b₂, f b₃ and t_z, and the right side, for point i."""
    x, y = problem.board[i, 0], problem.board[i, 1]
    z = state[6] * x + state[7] * y
    px = state[0] * x + state[1] * y + state[TRANSLATION]
    py = state[3] * x + state[4] * y + state[TRANSLATION + 1]
    dx = problem.image[i, 0] - state[LENS + CX]
    dy = problem.image[i, 1] - state[LENS + CY]
    r = math.sqrt(dx * dx + dy * dy)
    # Errors in pixels, for the distance of the start.
    weight = 1.0 / max(abs(z + state[TRANSLATION + 2]), 1e-3)
    t2 = (r / problem.corner_px) ** 2
    by[0] = weight * math.sqrt(px * px + py * py)
    by[1] = by[0] * t2
    by[2] = by[1] * t2
    by[3] = by[2] * t2
    by[4] = -weight * r
    by[5] = weight * r * z


@jit
def _improve_start(
    state: Array, problem: FullProblem, threshold2: float, variance: float, work: FullWork
) -> None:
    """Replace the state by a better one if relaxing its lens leads to one."""
    limit = _WIDE * threshold2
    _set_usual_bends(state, problem)
    other = state.copy()
    cost = minimise_full(state, problem, variance, limit, _START_STEPS, _TOLERANCE, work)
    lower = minimise_full(state, problem, variance, limit, 1, _TOLERANCE, work)
    if cost - lower <= _CONVERGED * cost:
        return
    cost = lower
    for _ in range(_START_ROUNDS):
        _set_usual_bends(other, problem)
        if not _relax_lens(other, problem, limit, math.sqrt(variance), work):
            break
        other[:] = work.trial
        lower = minimise_full(other, problem, variance, limit, _START_STEPS, _TOLERANCE, work)
        if lower < cost:
            cost = lower
            state[:] = other
    _set_usual_bends(state, problem)


@jit
def fit_full(
    state: Array,
    problem: FullProblem,
    threshold2: float,
    sigma_px: float,
    start_variance: float,
    work: FullWork,
) -> tuple[float, float, float, int, float]:
    """
    Fit the state in place. sigma_px 0: the noise is measured.

    Return chi-square of the priors, the noise variance (px²), its degrees of freedom (0: given),
    the number of inliers and the sum of their squared errors. work.covariance, over the active
    columns, and work.squares are those of the result.
    """
    measured = sigma_px == 0.0
    variance = start_variance if measured else sigma_px * sigma_px
    variance = max(variance, _SMALLEST_SIGMA_PX**2) if measured else variance
    dof, before = 0.0, 0.0
    if problem.usual > 0.0:
        _improve_start(state, problem, threshold2, variance, work)
    for _ in range(_ROUNDS):
        _set_usual_bends(state, problem)
        limit = max(threshold2, _GATE_SIGMAS**2 * variance)
        minimise_full(state, problem, variance, limit, _STEPS, _TOLERANCE, work)
        if not measured:
            break
        before = variance
        variance, dof = _noise(state, problem, before, limit, work)
        if abs(variance - before) <= _SAME_NOISE * before:
            break
    minimise_full(state, problem, variance, threshold2, _LAST_STEPS, _LAST_TOLERANCE, work)
    if measured:
        variance, dof = _noise(state, problem, variance, threshold2, work)
    count, total = _inliers(state, problem, threshold2, work)
    widened = posterior_variance(variance, int(dof), threshold2)
    _determined(state, problem, widened, threshold2, work)
    return prior_chi2(state, problem), variance, dof, count, total


@kernel
def _inliers(
    state: Array, problem: FullProblem, limit: float, work: FullWork
) -> tuple[int, float]:
    """Write the squared errors; return the number and the sum of those below the limit, px²."""
    lens_of(state, problem.corner_px, work.lens)
    count, total = 0, 0.0
    for i in range(len(problem.image)):
        square = squared_error(state, work.lens, problem, i)
        work.squares[i] = square
        if square < limit:
            count += 1
            total += square
    return count, total


@jit
def _noise(
    state: Array, problem: FullProblem, variance: float, limit: float, work: FullWork
) -> tuple[float, float]:
    """Return the noise variance, px², from the inliers, and its degrees of freedom."""
    count, total = _inliers(state, problem, limit, work)
    dof = 2.0 * count - _determined(state, problem, variance, limit, work)
    if not dof >= 1.0:
        return variance, 0.0
    return max(noise_variance(total, int(dof), limit), _SMALLEST_SIGMA_PX**2), dof


@jit
def _determined(
    state: Array, problem: FullProblem, variance: float, limit: float, work: FullWork
) -> float:
    """
    Write the covariance of the active columns; return how many parameters the points determine.

    With the information A of the points and P of the priors that is the trace of (A + P)⁻¹ A.
    """
    normal_equations(state, problem, variance, limit, work)
    active = problem.active
    m = len(active)
    information = np.empty((m, m))
    for a in range(m):
        for b in range(m):
            information[a, b] = work.normal[active[a], active[b]]
    invert_information(information, m, work.system, work.covariance)
    determined = float(m)
    for a in range(POSE_COLUMNS, m):
        for b in range(POSE_COLUMNS, m):
            determined -= work.covariance[a, b] * _prior_entry(problem, active[a], active[b])
    return determined


@jit
def other_focal_excess(
    state: Array,
    problem: FullProblem,
    factor: float,
    variance: float,
    limit: float,
    steps: int,
    work: FullWork,
) -> float:
    """
    Return by how much chi-square grows with another focal length, all else fitted again.

    Near fronto-parallel views the standard deviation misleads: the estimate rests on a tilt that
    is noise, and at that tilt the focal length seems determined.
    """
    cost = chi2(state, problem, variance, limit, math.inf, work.lens)
    other = state.copy()
    # The size in the image stays the same.
    other[LENS + LOG_FOCAL] += math.log(factor)
    other[TRANSLATION + 2] *= factor
    mean, information = problem.mean.copy(), problem.information.copy()
    information[LOG_FOCAL, :] = 0.0
    information[:, LOG_FOCAL] = 0.0
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
    minimise_full(other, held, variance, limit, steps, _TOLERANCE, work)
    return chi2(other, problem, variance, limit, math.inf, work.lens) - cost


@jit
def public_covariance(
    state: Array,
    problem: FullProblem,
    board_scale: tuple[float, float, float],
    work: FullWork,
    covariance: Array,
) -> None:
    """Write the (8, 8) covariance of x, y, z, rotation x, y, z, focal_px, k."""
    lens_of(state, problem.corner_px, work.lens)
    unit = (work.lens[FOCAL] / problem.corner_px) ** 2
    m, n = len(problem.active), COVARIANCE_SIZE
    columns, vector = np.zeros((n, m)), np.empty(n)
    for a in range(m):
        vector[:] = 0.0
        parameter = problem.active[a]
        if parameter < POSE_COLUMNS:
            vector[parameter] = 1.0
            pose_to_public(vector, state, board_scale)
        elif parameter == LENS_COLUMN + LOG_FOCAL:
            vector[COV_FOCAL], vector[COV_K] = work.lens[FOCAL], 2.0 * work.lens[K]
        elif parameter == LENS_COLUMN + BEND:
            vector[COV_K] = unit
        columns[:, a] = vector
    for i in range(n):
        for j in range(i + 1):
            total = 0.0
            for a in range(m):
                for b in range(m):
                    total += columns[i, a] * work.covariance[a, b] * columns[j, b]
            covariance[i, j] = covariance[j, i] = total


@kernel
def _prior_entry(problem: FullProblem, a: int, b: int) -> float:
    if a < DEVIATION_COLUMN and b < DEVIATION_COLUMN:
        entry: float = problem.information[a - LENS_COLUMN, b - LENS_COLUMN]
        return entry
    return 1.0 if a == b else 0.0
