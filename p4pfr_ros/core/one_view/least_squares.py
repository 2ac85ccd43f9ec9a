# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""
Least squares of one view: the problem, Levenberg-Marquardt on its truncated error, the covariance.

The camera is unknown (``free_camera``) or known (``known_camera``). A number in the problem
selects between the two, since Numba cannot cache a function with functions as arguments.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from . import free_camera, known_camera
from .free_camera import add_prior, Gates, NO_PRIOR, Prior, prior_cost
from ..cameras.division import DivisionCamera
from ..geometry import Array, Ints, TRANSLATION
from ..jit import jit, kernel
from ..linalg import copy_row, invert_information, rotate, solve_in_place
from ..minimal.four import chosen_points
from ..minimal.one import Workspace
from ..minimal.solution import G, H, ROW_SIZE
from ..model.lens import lens_from_camera
from ..model.normal_equations import COLUMNS
from ..model.uncertainty import COV_FOCAL, COV_K, COVARIANCE_SIZE, pose_to_public

# Number of unknowns: pose and camera, or pose alone if the camera is known.
POSE_AND_CAMERA = 8
POSE = 6

# Points between two tests whether a sum is large enough: they fill the lanes of the machine.
_CHUNK = 32

# Damping, relative to the diagonal of JᵀJ.
_FIRST_DAMPING = 1e-4
_SMALLEST_DAMPING = 1e-12
_LARGEST_DAMPING = 1e8


class Problem(NamedTuple):
    """
    One view of a board.

    image (N, 2) px from the centre, board (N, 2) scaled; unknowns: POSE_AND_CAMERA or POSE. With
    a known camera, rays (N, 3) are ρ and across (N, 2, 3) is W of ``known_camera``.
    squares (N,) is workspace.
    """

    image: Array
    board: Array
    unknowns: int
    gates: Gates
    prior: Prior
    rays: Array
    across: Array
    squares: Array


def free_problem(image: Array, board: Array, gates: Gates, prior: Prior = NO_PRIOR) -> Problem:
    """Make the problem of pose and camera."""
    squares = np.empty(len(board))
    return Problem(image, board, POSE_AND_CAMERA, gates, prior, _NO_RAYS, _NO_ACROSS, squares)


def known_problem(image: Array, board: Array, gates: Gates, camera: DivisionCamera) -> Problem:
    """Make the problem of the pose alone."""
    rays, across = _rays_and_across(image, lens_from_camera(camera, camera.center_px))
    return Problem(image, board, POSE, gates, NO_PRIOR, rays, across, np.empty(len(board)))


@jit
def _rays_and_across(image: Array, lens: Array) -> tuple[Array, Array]:
    rays, across = np.empty((len(image), 3)), np.empty((len(image), 2, 3))
    known_camera.rays_and_across(image, lens, rays, across)
    return rays, across


_NO_RAYS = np.empty((0, 3))
_NO_ACROSS = np.empty((0, 2, 3))


@jit
def hypotheses(problem: Problem, chosen: Ints, rows: Array, work: Workspace) -> int:
    """Solve for the four chosen points; write the plausible solutions; return their number."""
    board = chosen_points(problem.board, chosen)
    if problem.unknowns == POSE:
        return known_camera.hypothesis(problem.rays, board, chosen, rows[0])
    image = chosen_points(problem.image, chosen)
    return free_camera.hypotheses(image, board, problem.gates, rows, work)


@jit
def plausible(row: Array, problem: Problem) -> bool:
    """Return whether the row's camera is within the gates; a known camera always is."""
    return problem.unknowns == POSE or free_camera.plausible(row, problem.gates)


@jit
def squared_errors(row: Array, problem: Problem, start: int, stop: int, squares: Array) -> None:
    """Write the squared reprojection errors, px²; infinite for points that are not visible."""
    board = problem.board
    if problem.unknowns == POSE:
        for i in range(start, stop):
            squares[i] = known_camera.squared_error(row, board, problem.rays, problem.across, i)
    else:
        free_camera.squared_errors(row, board, problem.image, start, stop, squares)


@jit
def truncated_sum(row: Array, problem: Problem, limit: float, enough: float) -> float:
    """Sum the squared errors, each truncated at limit, px²; stop if the sum exceeds enough."""
    total = 0.0
    squares, n = problem.squares, len(problem.board)
    for start in range(0, n, _CHUNK):
        stop = min(start + _CHUNK, n)
        squared_errors(row, problem, start, stop, squares)
        # In the order of the points, on every machine: rounding must not depend on its lanes.
        for i in range(start, stop):
            total += min(squares[i], limit)
        if total > enough:
            break
    return total


@jit
def linearise(row: Array, problem: Problem, i: int, jacobian: Array) -> None:
    """
    Write the (2, 9) derivatives and residual of point i, px; NaN if it is not visible.

    Columns: rotation (radians about the camera's axes), translation, g, h; then the residual.
    """
    if problem.unknowns == POSE:
        known_camera.linearise(row, problem.board, problem.rays, problem.across, i, jacobian)
    else:
        free_camera.linearise(row, problem.board, problem.image, i, jacobian)


@jit
def add_points(row: Array, problem: Problem, limit: float, jacobian: Array, normal: Array) -> int:
    """Add JᵀJ and Jᵀr (column 8) of the points within the limit; return their number."""
    board = problem.board
    if problem.unknowns == POSE:
        return known_camera.add_points(
            row, board, problem.rays, problem.across, limit, jacobian, normal
        )
    return free_camera.add_points(row, board, problem.image, limit, jacobian, normal)


@jit
def count_within(row: Array, problem: Problem, limit: float) -> int:
    """Return how many squared errors are below the limit, px²."""
    squares, n = problem.squares, len(problem.board)
    squared_errors(row, problem, 0, n, squares)
    count = 0
    for i in range(n):
        count += 1 if squares[i] < limit else 0
    return count


class LeastSquaresWork(NamedTuple):
    """Workspace, allocated once."""

    normal: Array
    system: Array
    jacobian: Array
    trial: Array


@jit
def least_squares_work() -> LeastSquaresWork:
    """Allocate the workspace of ``minimise``."""
    size = (POSE_AND_CAMERA, COLUMNS)
    return LeastSquaresWork(
        np.empty(size), np.empty(size), np.empty((2, COLUMNS)), np.empty(ROW_SIZE)
    )


@jit
def truncated_cost(row: Array, problem: Problem, limit: float, enough: float) -> float:
    """
    Sum the squared errors, each truncated at ``limit`` px², and those of the prior, which are not.

    Stop if the sum exceeds ``enough``.
    """
    prior_squares = prior_cost(row, problem.prior)
    return prior_squares + truncated_sum(row, problem, limit, enough - prior_squares)


@jit
def normal_equations(row: Array, problem: Problem, limit: float, work: LeastSquaresWork) -> int:
    """Write JᵀJ and -Jᵀr over the points within the limit to ``work``; return their number."""
    normal = work.normal
    for a in range(POSE_AND_CAMERA):
        for b in range(COLUMNS):
            normal[a, b] = 0.0
    count = add_points(row, problem, limit, work.jacobian, normal)
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
    work: LeastSquaresWork,
) -> float:
    """
    Minimise the truncated cost, in place from ``row``, by Levenberg-Marquardt; return the cost.

    It ends after max_steps trials, if a step lowers the cost by no more than the relative
    ``tolerance``, or if no step lowers it.
    """
    cost = truncated_cost(row, problem, limit, math.inf)
    damping = _FIRST_DAMPING
    moved = True
    for _ in range(max_steps):
        if moved and normal_equations(row, problem, limit, work) < 4:
            break
        moved = False
        lower = math.inf
        if _step(row, damping, problem.unknowns, work):
            lower = truncated_cost(work.trial, problem, limit, cost)
        if lower < cost:
            gain = cost - lower
            copy_row(work.trial, row)
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
def _step(row: Array, damping: float, unknowns: int, work: LeastSquaresWork) -> bool:
    """Write the row after one damped step to ``work``; return False if there is none."""
    system, trial = work.system, work.trial
    for a in range(unknowns):
        for b in range(unknowns):
            system[a, b] = work.normal[a, b]
        system[a, a] *= 1.0 + damping
        system[a, unknowns] = work.normal[a, 8]
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


@jit
def covariance_from(
    normal: Array,
    unknowns: int,
    variance: float,
    row: Array,
    board_scale: tuple[float, float, float],
    system: Array,
    covariance: Array,
) -> None:
    """
    Write the (8, 8) covariance of x, y, z, rotation x, y, z, focal_px, k.

    normal is JᵀJ by rotation, translation of the scaled board, g, h; with a known camera (six
    unknowns) the rows and columns of focal_px and k are zero. board_scale: see ``Observation``.
    """
    for a in range(COVARIANCE_SIZE):
        for b in range(COVARIANCE_SIZE):
            covariance[a, b] = 0.0
    invert_information(normal, unknowns, system, covariance)
    # T C Tᵀ = T (T C)ᵀ, as C is symmetric: rows are contiguous, columns are not.
    _rows_to_public(covariance, row, board_scale)
    for a in range(COVARIANCE_SIZE):
        for b in range(a):
            covariance[a, b], covariance[b, a] = covariance[b, a], covariance[a, b]
    _rows_to_public(covariance, row, board_scale)
    for a in range(COVARIANCE_SIZE):
        for b in range(a + 1):
            mean = 0.5 * variance * (covariance[a, b] + covariance[b, a])
            covariance[a, b] = covariance[b, a] = mean


@kernel
def _rows_to_public(matrix: Array, row: Array, board_scale: tuple[float, float, float]) -> None:
    """Convert rows, changes of (ω, t of the scaled board, g, h), to those of (t, ω, f, k)."""
    for i in range(COVARIANCE_SIZE):
        v = matrix[i]
        pose_to_public(v, row, board_scale)
        # k = g h.
        v[COV_K] = row[H] * v[COV_FOCAL] + row[G] * v[COV_K]
