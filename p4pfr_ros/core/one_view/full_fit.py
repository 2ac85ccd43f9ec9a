# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""
The full fit of one view: the maximum of the posterior, with the covariance that follows.

``full_model`` has the parameters, ``full_descent`` the least squares. Here are the starts and
the end of a fit.

This module stands alone because it is compiled; ``full_estimate`` makes a result of it.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from .full_descent import (
    chi2_of,
    descend,
    Descent,
    FIRST_DAMPING,
    Gate,
    GATE_SIGMAS,
    improve_start,
    Noise,
    slightly_off,
    SMALLEST_SIGMA_PX,
    step,
)
from .full_model import (
    add_priors,
    BEND,
    DEVIATION,
    DEVIATION_COLUMN,
    DEVIATIONS,
    farthest_px,
    full_work,
    FullProblem,
    FullWork,
    half_field,
    LENS,
    lens_chi2,
    LENS_COLUMN,
    lens_of,
    LOG_FOCAL,
    prior_chi2,
    set_usual_bends,
    state_from,
    STRETCH,
    write_squares,
)
from ..geometry import Array, POSE_SIZE, TRANSLATION
from ..jit import jit, kernel
from ..linalg import copy_row, invert_information
from ..model.lens import ASPECT, FOCAL, K, POSE_COLUMNS
from ..model.uncertainty import (
    COV_FOCAL,
    COV_K,
    COVARIANCE_SIZE,
    noise_variance,
    pose_to_public,
    posterior_variance,
)

_STEPS, _LAST_STEPS = 8, 60

# The fit ends when the measured variance of the noise changes by less than this share.
_ROUNDS = 6
_SAME_NOISE = 0.05

# Of the prior's variance: with less that the points take away they say nothing.
_LEAST_SHARE = 1e-4

# How often a known camera's view gets larger deviations, and how much larger in all.
_WIDENINGS = 4
_LARGEST_GROWTH = 10.0


class Rules(NamedTuple):
    """
    What counts in a fit.

    threshold2: points with larger squared errors, px², are outliers; sigma_px: of a coordinate, 0:
    measured; widens: the sizes of the deviations grow where the view asks for more; inlier2:
    points with smaller ones are inliers of the result.
    """

    threshold2: float
    sigma_px: float
    widens: bool
    inlier2: float


class FullFit(NamedTuple):
    """
    The numbers of a fit.

    prior_chi2: deviation from the priors, lens_chi2: of the lens alone, in variances.
    variance: of the noise, px²; dof: degrees of freedom with which it was measured, 0: given.
    corner_rad, seen_rad: angle to the axis at the image's corner and at the farthest point that
    was seen; seen_bend: bend there.
    inliers: their number, and total: the sum of their squared errors, px².
    bend_share: variance of the first bend over that of its prior.
    aspect_chi2: how much the points contradict the prior on the aspect ratio, in variances.
    focal_by_center, focal_by_lens, focal_by_others: shares of the focal length's variance that are
    from the priors on the centre, the bends, and the other deviations.
    """

    prior_chi2: float
    lens_chi2: float
    variance: float
    dof: float
    corner_rad: float
    seen_rad: float
    seen_bend: float
    inliers: int
    total: float
    bend_share: float
    aspect_chi2: float
    focal_by_center: float
    focal_by_lens: float
    focal_by_others: float


@jit
def fit_view(
    start: Array,
    given: FullProblem,
    rules: Rules,
    board_scale: tuple[float, float, float],
    state: Array,
    lens: Array,
    squares: Array,
    covariance: Array,
) -> FullFit:
    """
    Fit a view from a start (22,): pose (12,) of the scaled board and lens (10,).

    Write the state (28,), the lens (10,), the squared errors (N,), px², and the covariance (8, 8)
    of x, y, z, rotation x, y, z, focal_px, k. board_scale: see ``Observation``.
    """
    problem = _own(given)
    work = full_work(len(problem.image))
    state_from(start, start[POSE_SIZE:], problem.corner_px, state)
    variance, dof = _fit_widened(state, problem, rules, work)
    lens_of(state, problem.corner_px, lens)
    copy_row(work.squares, squares)
    _public_covariance(state, problem, board_scale, work, covariance)
    corner_rad, _ = half_field(lens, problem.corner_px)
    seen_rad, seen_bend = half_field(lens, farthest_px(problem.image, lens))
    inliers, total = _inliers(squares, rules.inlier2)
    bend_share, by_center, by_lens, by_others = _prior_shares(problem, work)
    return FullFit(
        prior_chi2(state, problem),
        lens_chi2(state, problem),
        variance,
        dof,
        corner_rad,
        seen_rad,
        seen_bend,
        inliers,
        total,
        bend_share,
        _aspect_chi2(state, problem, work),
        by_center,
        by_lens,
        by_others,
    )


@kernel
def _inliers(squares: Array, limit: float) -> tuple[int, float]:
    """Return the number and the sum of the squares below a limit."""
    count, total = 0, 0.0
    for square in squares:
        if square < limit:
            count += 1
            total += square
    return count, total


@kernel
def _prior_shares(problem: FullProblem, work: FullWork) -> tuple[float, float, float, float]:
    """
    Return the last four numbers of ``FullFit``: what is from the priors.

    With the posterior covariance C, the prior P on a group of parameters gives the share
    (C P C)_ff of the variance C_ff of the logarithm of the focal length.
    """
    active, covariance = problem.active, work.covariance
    bend_share = by_center = by_lens = by_others = 0.0
    focal = -1
    for a in range(len(active)):
        if active[a] == LENS_COLUMN + LOG_FOCAL:
            focal = a
    for a in range(POSE_COLUMNS, len(active)):
        parameter = active[a]
        prior = _prior_entry(problem, parameter, parameter)
        if parameter == LENS_COLUMN + BEND:
            bend_share = covariance[a, a] * prior
        if focal < 0 or a == focal:
            continue
        share = covariance[focal, a] ** 2 * prior / covariance[focal, focal]
        if parameter >= DEVIATION_COLUMN:
            by_others += share
        elif parameter >= LENS_COLUMN + BEND:
            by_lens += share
        else:
            by_center += share
    return bend_share, by_center, by_lens, by_others


@kernel
def _aspect_chi2(state: Array, problem: FullProblem, work: FullWork) -> float:
    """Return χ² of the aspect ratio that the points alone ask for, against its prior."""
    # Prior N(m, s²) and points N(a, d²) give the mean  m + (a - m) s² / (s² + d²)  and the
    # variance V = s² d² / (s² + d²): ((mean - m) / s)² is the share 1 - V / s² of
    # (a - m)² / (s² + d²).
    active = problem.active
    for i in range(len(active)):
        if active[i] == LENS_COLUMN + ASPECT:
            prior = problem.information[ASPECT, ASPECT]
            pull = (state[LENS + ASPECT] - problem.mean[ASPECT]) ** 2 * prior
            chi2: float = pull / max(1.0 - work.covariance[i, i] * prior, _LEAST_SHARE)
            return chi2
    return 0.0


@jit
def _own(given: FullProblem) -> FullProblem:
    """Return the problem with copies of what a fit changes: priors on bends, sizes."""
    return FullProblem(
        given.image,
        given.board,
        given.corner_px,
        given.mean,
        given.information.copy(),
        given.usual,
        given.sizes.copy(),
        given.active,
    )


@jit
def _fit_widened(
    state: Array, problem: FullProblem, rules: Rules, work: FullWork
) -> tuple[float, float]:
    """
    Fit in place, with larger deviations while the fit asks for more than it was allowed.

    A view that deviates more than usual (a bent print, a faster motion) then has the covariance
    that its own misfit asks for.
    """
    variance, dof, grown, widened = SMALLEST_SIGMA_PX**2, 0.0, 1.0, 0
    while True:
        variance, dof = _fit(state, problem, rules, variance, work)
        if not rules.widens or widened == _WIDENINGS:
            break
        widened += 1
        total, count = 0.0, 0
        for i in range(DEVIATIONS):
            if problem.sizes[i] > 0.0:
                total += state[DEVIATION + i] ** 2
                count += 1
        growth = min(math.sqrt(total / max(count, 1)), _LARGEST_GROWTH / grown)
        if not growth > 1.0:
            break
        grown *= growth
        for i in range(DEVIATIONS):
            problem.sizes[i] *= growth
            state[DEVIATION + i] /= growth
    return variance, dof


@jit
def _fit(
    state: Array, problem: FullProblem, rules: Rules, start_variance: float, work: FullWork
) -> tuple[float, float]:
    """
    Fit the state in place; return the variance of the noise, px², and its degrees of freedom.

    work.covariance, over the active columns, and work.squares are those of the result.
    """
    threshold2, measured = rules.threshold2, rules.sigma_px == 0.0
    variance = max(start_variance, SMALLEST_SIGMA_PX**2) if measured else rules.sigma_px**2
    noise = Noise(variance, measured, POSE_COLUMNS + 0.4 * (len(problem.active) - POSE_COLUMNS))
    gate = Gate(threshold2, True)
    set_usual_bends(state, problem)
    found = descend(state, problem, noise, gate, _STEPS, 0.0, work)
    is_off = slightly_off(work.squares, threshold2)
    improves = problem.usual > 0.0 and (is_off or not found.converged)
    if improves:
        fixed = Noise(max(found.variance, 1.0) if is_off else found.variance, False, 0.0)
        _try_other_start(state, problem, fixed, noise, gate, work)
    if improves or not found.converged:
        found = descend(state, problem, noise, gate, _LAST_STEPS, 0.0, work)
    if _any_between(work.squares, threshold2, GATE_SIGMAS**2 * found.variance):
        noise = Noise(found.variance, measured, noise.determined)
        gate = Gate(threshold2, False)
        found = descend(state, problem, noise, gate, _LAST_STEPS, 0.0, work)
    return _finish(state, problem, found, noise, threshold2, work)


@jit
def _try_other_start(
    state: Array, problem: FullProblem, fixed: Noise, noise: Noise, gate: Gate, work: FullWork
) -> None:
    """Fit from another start, too; replace the state if that is better, outliers truncated."""
    other = state.copy()
    improve_start(other, problem, fixed, gate.limit, work)
    found = descend(other, problem, noise, gate, _LAST_STEPS, 0.0, work)
    before = descend(state, problem, noise, gate, _LAST_STEPS, 0.0, work)
    variance = min(found.variance, before.variance)
    cost = chi2_of(state, problem, variance, gate.limit, work)
    write_squares(other, problem, work)
    set_usual_bends(other, problem)
    if chi2_of(other, problem, variance, gate.limit, work) < cost:
        copy_row(other, state)
    set_usual_bends(state, problem)


@kernel
def _any_between(squares: Array, low: float, high: float) -> bool:
    """Return whether any square is as large as the first limit, but below the second."""
    found = False
    for square in squares:
        found = found or low <= square < high
    return found


@jit
def _finish(
    state: Array,
    problem: FullProblem,
    found: Descent,
    noise: Noise,
    threshold2: float,
    work: FullWork,
) -> tuple[float, float]:
    """Write covariance and squared errors, take the last step; return as `_fit` does."""
    variance, dof = found.variance, 0.0
    if noise.measured:
        dof = max(2.0 * found.inliers - noise.determined, 0.0)
    for _ in range(_ROUNDS):
        determined = _invert(
            state, problem, posterior_variance(variance, int(dof), threshold2), work
        )
        if not noise.measured:
            break
        dof = max(2.0 * found.inliers - determined, 0.0)
        if dof < 1.0:
            variance, dof = noise.variance, 0.0
            break
        before = variance
        variance = max(noise_variance(found.total, int(dof), threshold2), SMALLEST_SIGMA_PX**2)
        if abs(variance - before) <= _SAME_NOISE * before:
            break
    cost = chi2_of(state, problem, variance, threshold2, work)
    add_priors(state, problem, variance, work)
    if step(state, problem, FIRST_DAMPING, work) >= 0.0:
        write_squares(work.trial, problem, work)
        if chi2_of(work.trial, problem, variance, threshold2, work) < cost:
            copy_row(work.trial, state)
        else:
            write_squares(state, problem, work)
    return variance, dof


@kernel
def _invert(state: Array, problem: FullProblem, variance: float, work: FullWork) -> float:
    """
    Write the covariance of the active columns; return how many parameters the points determine.

    With the information A of the points and P of the priors that is the trace of (A + P)⁻¹ A.
    """
    add_priors(state, problem, variance, work)
    active, covariance = problem.active, work.covariance
    m = len(active)
    for a in range(m):
        for b in range(m):
            work.information[a, b] = work.normal[active[a], active[b]]
    invert_information(work.information, m, work.system, covariance)
    determined = float(m)
    for a in range(m):
        for b in range(m):
            covariance[a, b] *= variance
            if a >= POSE_COLUMNS and b >= POSE_COLUMNS:
                determined -= covariance[a, b] * _prior_entry(problem, active[a], active[b])
    return determined


@kernel
def _prior_entry(problem: FullProblem, a: int, b: int) -> float:
    if a < DEVIATION_COLUMN and b < DEVIATION_COLUMN:
        entry: float = problem.information[a - LENS_COLUMN, b - LENS_COLUMN]
        return entry
    return 1.0 if a == b else 0.0


@jit
def _public_covariance(
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
        for i in range(n):
            vector[i] = 0.0
        parameter = problem.active[a]
        if parameter < POSE_COLUMNS:
            vector[parameter] = 1.0
            pose_to_public(vector, state, board_scale)
        elif parameter == LENS_COLUMN + LOG_FOCAL:
            vector[COV_FOCAL], vector[COV_K] = work.lens[FOCAL], 2.0 * work.lens[K]
        elif parameter == LENS_COLUMN + BEND:
            vector[COV_K] = unit
        for i in range(n):
            columns[i, a] = vector[i]
    across = np.zeros((n, m))
    for i in range(n):
        for a in range(m):
            if columns[i, a] != 0.0:
                for b in range(m):
                    across[i, b] += columns[i, a] * work.covariance[a, b]
    for i in range(n):
        for j in range(i + 1):
            total = 0.0
            for b in range(m):
                total += across[i, b] * columns[j, b]
            covariance[i, j] = covariance[j, i] = total
    # A board that is printed larger by a share looks the same nearer by that share.
    _add_scale(state, problem.sizes[STRETCH], board_scale, covariance)


@kernel
def _add_scale(
    state: Array, sigma: float, board_scale: tuple[float, float, float], covariance: Array
) -> None:
    """Add the standard deviation of the board's scale (a share) to the covariance (8, 8)."""
    mean_x, mean_y, size = board_scale
    for i in range(3):
        first = size * state[TRANSLATION + i] - state[3 * i] * mean_x - state[3 * i + 1] * mean_y
        for j in range(3):
            second = (
                size * state[TRANSLATION + j] - state[3 * j] * mean_x - state[3 * j + 1] * mean_y
            )
            covariance[i, j] += sigma * sigma * first * second
