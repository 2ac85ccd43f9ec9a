# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""
One view as the kernels want it, and what the loops may ask of it.

The camera is unknown (``free_camera``) or known (``known_camera``): a flag in the problem, not a
function handed to the loops, because Numba cannot keep a function on disk that has functions
among its arguments. The branch it costs is always taken the same way.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from . import free_camera, known_camera
from .free_camera import Gates
from .prior import NO_PRIOR, Prior
from ..cameras.division import DivisionCamera
from ..geometry import Array, Ints
from ..jit import jit
from ..minimal.solver import Workspace

# The unknowns: pose and camera, or pose alone where the camera is known.
POSE_AND_CAMERA = 8
POSE = 6


class Problem(NamedTuple):
    """
    One view of a board.

    image (N, 2) px from the centre, board (N, 2) about its mean; unknowns says whether the camera
    is among them. Where it is not, rays (N, 3) and across (N, 2, 3) are its rays.
    """

    image: Array
    board: Array
    unknowns: int
    gates: Gates
    prior: Prior
    rays: Array
    across: Array


def free_problem(image: Array, board: Array, gates: Gates, prior: Prior = NO_PRIOR) -> Problem:
    """Make the problem of pose and camera."""
    return Problem(image, board, POSE_AND_CAMERA, gates, prior, _NO_RAYS, _NO_ACROSS)


def known_problem(image: Array, board: Array, gates: Gates, camera: DivisionCamera) -> Problem:
    """Make the problem of the pose alone."""
    rays, across = np.empty((len(image), 3)), np.empty((len(image), 2, 3))
    lens = (camera.focal_px, camera.k, camera.k2, camera.k3)
    known_camera.rays_and_across(image, lens, rays, across)
    return Problem(image, board, POSE, gates, NO_PRIOR, rays, across)


_NO_RAYS = np.empty((0, 3))
_NO_ACROSS = np.empty((0, 2, 3))


@jit
def hypotheses(problem: Problem, chosen: Ints, rows: Array, room: Workspace) -> int:
    """Solve the four chosen points; write the plausible solutions; return their number."""
    for i in range(4):
        for j in range(2):
            room.sample_image[i, j] = problem.image[chosen[i], j]
            room.sample_board[i, j] = problem.board[chosen[i], j]
    if problem.unknowns == POSE:
        return known_camera.hypothesis(problem.rays, chosen, rows[0], room)
    return free_camera.hypotheses(problem.gates, rows, room)


@jit
def plausible(row: Array, problem: Problem) -> bool:
    """Say whether the row's camera is one that is built; a known one always is."""
    return problem.unknowns == POSE or free_camera.plausible(row, problem.gates)


@jit
def squared_error(row: Array, problem: Problem, i: int) -> float:
    """Return the squared reprojection error of point i, px²; infinite where it is not seen."""
    if problem.unknowns == POSE:
        return known_camera.squared_error(row, problem.board, problem.rays, problem.across, i)
    return free_camera.squared_error(row, problem.board, problem.image, i)


@jit
def truncated_sum(row: Array, problem: Problem, limit: float, enough: float) -> float:
    """Sum the squared errors, each cut off at limit, px²; stop where the sum passes enough."""
    board = problem.board
    if problem.unknowns == POSE:
        return known_camera.truncated_sum(row, board, problem.rays, problem.across, limit, enough)
    return free_camera.truncated_sum(row, board, problem.image, limit, enough)


@jit
def linearise(row: Array, problem: Problem, i: int, jacobian: Array) -> None:
    """
    Write the (2, 9) derivatives and residual of point i, px; NaN where it is not seen.

    Columns: by the rotation (radians about the camera's axes), the translation, g, h; residual.
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
def squared_errors(row: Array, problem: Problem, squares: Array) -> None:
    """Write all the squared errors, (N,) px²."""
    for i in range(len(problem.image)):
        squares[i] = squared_error(row, problem, i)


@jit
def count_within(row: Array, problem: Problem, limit: float) -> int:
    """Return how many squared errors are below the limit, px²."""
    count = 0
    for i in range(len(problem.image)):
        if squared_error(row, problem, i) < limit:
            count += 1
    return count
