# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""
The model of the full fit of one view, and its linearisation.

The search takes the principal point for the middle of the image, the lens for one term, pixels
for square and the board for flat. Real cameras and boards deviate a little, and one view cannot
tell by how much; a pose that takes such a constant for true is wrong by many of its standard
deviations. So here each is a parameter with a prior: pose (6), lens (10) and deviations (6).

The lens is parametrised such that its priors do not depend on each other: the logarithm of the
focal length, the centre in pixels from the middle of the image, the bends  bᵢ = kᵢ (R/f)²ⁱ  at
the distance R of the image's corner, fy / fx - 1, and decentring. A deviation is a multiple of its
standard deviation, so its prior is N(0, 1).

This module stands alone because it is the model; ``full_fit`` minimises it.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from ..geometry import Array, Ints, POSE_SIZE, TRANSLATION
from ..jit import inlined, jit, kernel, vectorised_kernel
from ..model import lens as lens_kernels
from ..model.lens import ASPECT, CX, CY, FOCAL, K, K4, LENS_END, LENS_SIZE, P2, POSE_COLUMNS
from ..model.prior import BEND_SPREADS, TERM_SPREADS

# Deviations: shear of the image along its rows (rolling shutter), and of the board: stretch along
# x (and shrinkage along y), skew, and height over x², xy and y².
SHEAR, STRETCH, SKEW, BOW_XX, BOW_XY, BOW_YY = range(6)
DEVIATIONS = 6

# Places in a state (28,): pose of the scaled board, lens as parametrised here, deviations.
LENS = POSE_SIZE
DEVIATION = POSE_SIZE + LENS_SIZE
STATE_SIZE = DEVIATION + DEVIATIONS

# Columns of a point's derivatives: pose, lens, deviations; then the residual.
LENS_COLUMN = POSE_COLUMNS
DEVIATION_COLUMN = POSE_COLUMNS + LENS_SIZE
PARAMETERS = DEVIATION_COLUMN + DEVIATIONS
# Padded, so that loops over columns have a constant length of whole vectors.
WIDTH = 24

# Rows of derivatives that are added to the normal equations together.
BLOCK = 8

LOG_FOCAL, BEND = 0, 3  # places in the lens as parametrised here; there are four bends
BENDS = 4


class FullProblem(NamedTuple):
    """
    One view and the priors of everything but its pose.

    image (N, 2) px from the middle of the image; board (N, 3) scaled, with heights; corner_px: R
    mean (10,), information (10, 10): the prior on the lens, as parametrised here
    usual: multiple of the usual spread of the bends, which depends on f; 0: as given
    sizes (6,): standard deviations of the deviations
    active (M,): the columns that are estimated; the others keep their values
    """

    image: Array
    board: Array
    corner_px: float
    mean: Array
    information: Array
    usual: float
    sizes: Array
    active: Ints


class FullWork(NamedTuple):
    """Workspace, allocated once."""

    lens: Array
    point: Array
    block: Array
    points: Array
    normal: Array
    system: Array
    trial: Array
    information: Array
    covariance: Array
    squares: Array


@jit
def full_work(points: int) -> FullWork:
    """Allocate the workspace for a number of points."""
    size = (PARAMETERS, WIDTH)
    return FullWork(
        np.empty(LENS_SIZE),
        np.empty((2, LENS_END)),
        np.zeros((BLOCK, WIDTH)),
        np.zeros(size),
        np.zeros(size),
        np.empty(size),
        np.empty(STATE_SIZE),
        np.empty((PARAMETERS, PARAMETERS)),
        np.empty((PARAMETERS, PARAMETERS)),
        np.empty(points),
    )


@kernel
def lens_of(state: Array, corner_px: float, lens: Array) -> None:
    """Write the lens (10,) in the units of ``model.lens``."""
    focal_px = math.exp(state[LENS + LOG_FOCAL])
    unit = (focal_px / corner_px) ** 2
    lens[FOCAL] = focal_px
    lens[CX], lens[CY] = state[LENS + CX], state[LENS + CY]
    power = 1.0
    for i in range(BENDS):
        power *= unit
        lens[K + i] = state[LENS + BEND + i] * power
    for i in range(ASPECT, P2 + 1):
        lens[i] = state[LENS + i]


@kernel
def state_from(row: Array, lens: Array, corner_px: float, state: Array) -> None:
    """Write the state of a pose (12,) and a lens (10,), without deviations."""
    for i in range(POSE_SIZE):
        state[i] = row[i]
    unit = (corner_px / lens[FOCAL]) ** 2
    state[LENS + LOG_FOCAL] = math.log(lens[FOCAL])
    state[LENS + CX], state[LENS + CY] = lens[CX], lens[CY]
    power = 1.0
    for i in range(BENDS):
        power *= unit
        state[LENS + BEND + i] = lens[K + i] * power
    for i in range(ASPECT, P2 + 1):
        state[LENS + i] = lens[i]
    for i in range(DEVIATIONS):
        state[DEVIATION + i] = 0.0


@kernel
def _on_the_board(state: Array, problem: FullProblem, i: int) -> tuple[float, float, float]:
    """Return Q = R X of point i, with X on the board as it deviates."""
    x, y = problem.board[i, 0], problem.board[i, 1]
    size, at = problem.sizes, DEVIATION
    stretch, skew = size[STRETCH] * state[at + STRETCH], size[SKEW] * state[at + SKEW]
    bx, by = x + stretch * x + skew * y, y - stretch * y + skew * x
    bz = problem.board[i, 2] + (
        size[BOW_XX] * state[at + BOW_XX] * x * x
        + size[BOW_XY] * state[at + BOW_XY] * x * y
        + size[BOW_YY] * state[at + BOW_YY] * y * y
    )
    return (
        state[0] * bx + state[1] * by + state[2] * bz,
        state[3] * bx + state[4] * by + state[5] * bz,
        state[6] * bx + state[7] * by + state[8] * bz,
    )


@kernel
def squared_error(state: Array, lens: Array, problem: FullProblem, i: int) -> float:
    """Return the squared reprojection error of point i, px²; infinite if it is not visible."""
    qx, qy, qz = _on_the_board(state, problem, i)
    u, v = problem.image[i, 0], problem.image[i, 1]
    x, y = qx + state[TRANSLATION], qy + state[TRANSLATION + 1]
    dx, dy = lens_kernels.offset_px(x, y, qz + state[TRANSLATION + 2], lens, u, v)
    shear = problem.sizes[SHEAR] * state[DEVIATION + SHEAR]
    ex, ey = lens[CX] + dx + shear * dy - u, lens[CY] + dy - v
    error: float = ex * ex + ey * ey
    return error if error < math.inf else math.inf


@kernel
def _linearise(state: Array, problem: FullProblem, i: int, row: int, work: FullWork) -> None:
    """Write derivatives and residual of point i to two rows of the block; NaN if not visible."""
    point, lens = work.point, work.lens
    jacobian = work.block[row : row + 2]
    u, v = problem.image[i, 0], problem.image[i, 1]
    size = problem.sizes
    qx, qy, qz = _on_the_board(state, problem, i)
    dx, dy = lens_kernels.linearise_rotated(qx, qy, qz, state, lens, u, v, point)
    shear = size[SHEAR] * state[DEVIATION + SHEAR]
    # The pixel from the centre, d = (dx, dy), moves to  dx + σ dy,  dy.
    if shear != 0.0:
        for c in range(LENS_END):
            point[0, c] += shear * point[1, c]
    for j in range(2):
        for c in range(POSE_COLUMNS):
            jacobian[j, c] = point[j, c]
        jacobian[j, 6 + CX], jacobian[j, 6 + CY] = 1.0 - j, j
        for c in range(6 + ASPECT, LENS_END):
            jacobian[j, c] = point[j, c]
        _lens_columns(j, problem.corner_px, lens, point, jacobian)
        _board_columns(j, problem, i, state, point, jacobian)
    at = DEVIATION_COLUMN
    jacobian[0, at + SHEAR], jacobian[1, at + SHEAR] = size[SHEAR] * dy, 0.0
    jacobian[0, PARAMETERS] = lens[CX] + dx + shear * dy - u
    jacobian[1, PARAMETERS] = lens[CY] + dy - v


@kernel
def _lens_columns(j: int, corner_px: float, lens: Array, point: Array, jacobian: Array) -> None:
    """Write the derivatives of coordinate j by log f and the bends."""
    unit = (lens[FOCAL] / corner_px) ** 2
    # At constant bends kᵢ grows with f²ⁱ.
    along, power = lens[FOCAL] * point[j, 6 + FOCAL], 1.0
    for i in range(BENDS):
        power *= unit
        by_term = point[j, 6 + K + i]
        along += (2.0 * i + 2.0) * lens[K + i] * by_term
        jacobian[j, 6 + BEND + i] = power * by_term
    jacobian[j, 6 + LOG_FOCAL] = along


@kernel
def _board_columns(
    j: int, problem: FullProblem, i: int, state: Array, point: Array, jacobian: Array
) -> None:
    """Write the derivatives of coordinate j of point i by the board's deviations."""
    x, y = problem.board[i, 0], problem.board[i, 1]
    size, at = problem.sizes, DEVIATION_COLUMN
    # Derivatives by the board's own x, y and z:  a · R.
    a, b, c = point[j, 3], point[j, 4], point[j, 5]
    by_x = a * state[0] + b * state[3] + c * state[6]
    by_y = a * state[1] + b * state[4] + c * state[7]
    by_z = a * state[2] + b * state[5] + c * state[8]
    jacobian[j, at + STRETCH] = size[STRETCH] * (by_x * x - by_y * y)
    jacobian[j, at + SKEW] = size[SKEW] * (by_x * y + by_y * x)
    jacobian[j, at + BOW_XX] = size[BOW_XX] * by_z * x * x
    jacobian[j, at + BOW_XY] = size[BOW_XY] * by_z * x * y
    jacobian[j, at + BOW_YY] = size[BOW_YY] * by_z * y * y


@kernel
def write_squares(state: Array, problem: FullProblem, work: FullWork) -> None:
    """Write the squared errors, (N,) px²."""
    lens_of(state, problem.corner_px, work.lens)
    for i in range(len(problem.image)):
        work.squares[i] = squared_error(state, work.lens, problem, i)


@kernel
def set_usual_bends(state: Array, problem: FullProblem) -> None:
    """Set the prior on the bends to that of real lenses with the state's focal length."""
    if not problem.usual > 0.0:
        return
    log_unit = 2.0 * (math.log(problem.corner_px) - state[LENS + LOG_FOCAL])
    unit = math.exp(min(max(log_unit, -50.0), 50.0))
    power = 1.0
    for i in range(BENDS):
        power *= unit
        spread2 = (TERM_SPREADS[i] * power) ** 2 + BEND_SPREADS[i] ** 2
        problem.information[BEND + i, BEND + i] = 1.0 / (problem.usual**2 * spread2)


@kernel
def farthest_px(image: Array, lens: Array) -> float:
    """Return the distance of the farthest point from the centre."""
    farthest2 = 0.0
    for i in range(len(image)):
        x, y = image[i, 0] - lens[CX], image[i, 1] - lens[CY]
        farthest2 = max(farthest2, x * x + y * y)
    return math.sqrt(farthest2)


@kernel
def half_field(lens: Array, radius_px: float) -> tuple[float, float]:
    """Return angle to the axis, radians, and bend of the ray at a distance from the centre."""
    q = (radius_px / lens[FOCAL]) ** 2
    bend = q * (lens[K] + q * (lens[K + 1] + q * (lens[K + 2] + q * lens[K4])))
    return math.atan2(math.sqrt(q), 1.0 + bend), bend


@kernel
def lens_chi2(state: Array, problem: FullProblem) -> float:
    """Return the squared deviation of the lens from its prior, in variances."""
    total = 0.0
    for a in range(LENS_SIZE):
        for b in range(LENS_SIZE):
            product = (state[LENS + a] - problem.mean[a]) * (state[LENS + b] - problem.mean[b])
            total += problem.information[a, b] * product
    return total


@kernel
def prior_chi2(state: Array, problem: FullProblem) -> float:
    """Return the squared deviation of lens and deviations from the priors, in variances."""
    total = lens_chi2(state, problem)
    for i in range(DEVIATIONS):
        total += state[DEVIATION + i] ** 2
    return total


@kernel
def normal_equations(
    state: Array, problem: FullProblem, limit: float, work: FullWork
) -> tuple[int, float]:
    """
    Write JᵀJ and, as last column, -Jᵀr of the points within the limit to work.points, px².

    Also write the squared errors. Return the number of points within the limit and the sum of
    their squared errors.
    """
    points, block, n = work.points, work.block, PARAMETERS
    for a in range(n):
        for b in range(WIDTH):
            points[a, b] = 0.0
    lens_of(state, problem.corner_px, work.lens)
    count, total, rows = 0, 0.0, 0
    for i in range(len(problem.image)):
        _linearise(state, problem, i, rows, work)
        square = block[rows, n] ** 2 + block[rows + 1, n] ** 2
        work.squares[i] = square if square < math.inf else math.inf
        # Written so that NaN is not within.
        if not square < limit:
            continue
        count += 1
        total += square
        rows += 2
        if rows == BLOCK:
            _add_block(block, points)
            rows = 0
    for row in range(rows, BLOCK):
        for a in range(n + 1):
            block[row, a] = 0.0
    if rows:
        _add_block(block, points)
    for a in range(n):
        points[a, n] = -points[a, n]
        for b in range(a):
            points[a, b] = points[b, a]
    return count, total


@vectorised_kernel
def _add_block(block: Array, points: Array) -> None:
    """
    Add JᵀJ and Jᵀr of eight rows; a loop of constant length over columns is vectorised.

    JᵀJ is symmetric: whole vectors left of the diagonal are left out.
    """
    _add_rows(0, 8, block, points)
    _add_rows(8, 16, block, points)
    _add_rows(16, PARAMETERS, block, points)


@inlined
def _add_rows(first: int, end: int, block: Array, points: Array) -> None:
    for a in range(first, end):
        for b in range(first, WIDTH):
            points[a, b] += (
                (block[0, a] * block[0, b] + block[1, a] * block[1, b])
                + (block[2, a] * block[2, b] + block[3, a] * block[3, b])
                + (block[4, a] * block[4, b] + block[5, a] * block[5, b])
                + (block[6, a] * block[6, b] + block[7, a] * block[7, b])
            )


@kernel
def add_priors(state: Array, problem: FullProblem, variance: float, work: FullWork) -> None:
    """Write the information and negative gradient of points and priors, px², to work.normal."""
    normal, n = work.normal, PARAMETERS
    for a in range(n):
        for b in range(WIDTH):
            normal[a, b] = work.points[a, b]
    for a in range(LENS_SIZE):
        for b in range(LENS_SIZE):
            weight = variance * problem.information[a, b]
            normal[LENS_COLUMN + a, LENS_COLUMN + b] += weight
            normal[LENS_COLUMN + a, n] -= weight * (state[LENS + b] - problem.mean[b])
    for i in range(DEVIATIONS):
        normal[DEVIATION_COLUMN + i, DEVIATION_COLUMN + i] += variance
        normal[DEVIATION_COLUMN + i, n] -= variance * state[DEVIATION + i]
