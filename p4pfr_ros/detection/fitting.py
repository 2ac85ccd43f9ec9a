# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""
Least squares in kernels: seven parameters of an image patch, by the Levenberg-Marquardt method.

A model writes its derivatives by the parameters and its residuals, one row each, into
``Room.rows``; in these loops over pixels, without branches and calls of the C library, the
compiler uses vector instructions.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from p4pfr_ros.core.geometry import Array
from p4pfr_ros.core.jit import kernel, reducing_kernel
from p4pfr_ros.core.linalg import solve_in_place

PARAMETERS = 7
DAMPING_AFTER_SUCCESS, DAMPING_AFTER_FAILURE = 0.2, 10.0
# Largest slope of tanh: that of the Gaussian with the variance of a unit box, 1/12: √(2/π) √12.
_MAX_SLOPE = 2.76
# Beyond, tanh differs from 1 by less than 4e-8.
_MAX_TANH_ARGUMENT = 9.0


class Room(NamedTuple):
    """
    Workspace of a fit to at most m pixels.

    ``parameters`` (2, 7) and ``normal`` (2, 7, 8) are those of the best fit and of the trial;
    ``normal`` holds the upper triangle of JᵀWJ, and JᵀWr in its last column. ``rows`` (8, m) are
    the derivatives and the residuals, ``weighted`` (m,) and ``system`` (7, 8) are scratch.
    """

    parameters: Array
    normal: Array
    rows: Array
    weighted: Array
    system: Array


def room(pixels: int) -> Room:
    """Allocate the workspace."""
    return Room(
        np.zeros((2, PARAMETERS)),
        np.zeros((2, PARAMETERS, PARAMETERS + 1)),
        np.zeros((PARAMETERS + 1, pixels)),
        np.zeros(pixels),
        np.zeros((PARAMETERS, PARAMETERS + 1)),
    )


@kernel
def tanh(x: float) -> float:
    """Approximate tanh with an error below 4e-8, without a branch: loops over it vectorise."""
    # Lambert's continued fraction at x / 4, cut after five terms, is p / q. Doubling the argument
    # twice, by tanh 2y = 2 t / (1 + t²), needs a single division.
    y = 0.25 * min(max(x, -_MAX_TANH_ARGUMENT), _MAX_TANH_ARGUMENT)
    y2 = y * y
    p = y * (945.0 + y2 * (105.0 + y2))
    q = 945.0 + y2 * (420.0 + 15.0 * y2)
    p, q = 2.0 * p * q, p * p + q * q
    return 2.0 * p * q / (p * p + q * q)


@kernel
def sharpness(q: float) -> tuple[float, float]:
    """
    Map an unbounded parameter q to the slope s of an edge tanh(s e), per pixel; return s, ds/dq.

    s is bounded by the slope of an ideal edge averaged over a pixel; q = 0 gives half of it. An
    even sharper edge would leave its position within a pixel undetermined.
    """
    s = _MAX_SLOPE / (1.0 + math.exp(-min(max(q, -30.0), 30.0)))
    return s, s * (1.0 - s / _MAX_SLOPE)


@reducing_kernel
def add_up(rows: Array, weights: Array, count: int, weighted: Array, normal: Array) -> float:
    """Write the normal equations of the first ``count`` pixels; return the weighted cost."""
    for i in range(PARAMETERS + 1):
        for k in range(count):
            weighted[k] = weights[k] * rows[i, k]
        # The last row are the residuals: their square is the cost.
        if i == PARAMETERS:
            break
        for j in range(i, PARAMETERS + 1):
            total = 0.0
            for k in range(count):
                total += weighted[k] * rows[j, k]
            normal[i, j] = total
    cost = 0.0
    for k in range(count):
        cost += weighted[k] * rows[PARAMETERS, k]
    return cost


@kernel
def damped_step(room: Room, damping: float) -> None:
    """Write into parameters[1] a damped Gauss-Newton step from parameters[0]."""
    parameters, normal, system = room.parameters, room.normal, room.system
    for i in range(PARAMETERS):
        for j in range(i, PARAMETERS + 1):
            system[i, j] = normal[0, i, j]
            if j < PARAMETERS:
                system[j, i] = normal[0, i, j]
        # The constant keeps the matrix regular for a uniform patch: all derivatives are zero.
        system[i, i] += damping * normal[0, i, i] + 1e-6
    solve_in_place(system, PARAMETERS)
    for i in range(PARAMETERS):
        parameters[1, i] = parameters[0, i] + system[i, PARAMETERS]


@kernel
def accept_trial(room: Room, trial: int) -> None:
    """Make the trial (0: the initial parameters, 1: a step) the best fit."""
    parameters, normal = room.parameters, room.normal
    for i in range(PARAMETERS):
        parameters[0, i] = parameters[trial, i]
        for j in range(i, PARAMETERS + 1):
            normal[0, i, j] = normal[trial, i, j]
