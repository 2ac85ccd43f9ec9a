# SPDX-License-Identifier: Apache-2.0
"""
Least squares over one view: pose, focal length and distortion to the reprojection error.

The unknowns are a rotation ω and a translation t of the camera's frame, the focal length g and h,
where the pixel (x, y) from the centre sees the ray (x, y, g + h r²): k = g h. A point
P = (X, Y, Z) then projects to σ (X, Y), with ρ² = X² + Y² and

    h ρ² σ² - Z σ + g = 0,     σ = 2 g / (Z + w),     w = √(Z² - 4 g h ρ²).

That equation's differential gives all the derivatives, finite at h = 0 and behind the image plane:

    w dσ = h σ² d(ρ²) - σ dZ + dg + ρ² σ² dh.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from .geometry import Array
from .jit import jit
from .linear import rotate, solve_in_place
from .solution import G, H, ROW_SIZE, TRANSLATION

UNKNOWNS = 8

# Levenberg-Marquardt: damping relative to the diagonal of JᵀJ.
_FIRST_DAMPING = 1e-4
_LARGEST_DAMPING = 1e8


class RefineRoom(NamedTuple):
    """Room for the least squares, made once."""

    normal: Array
    system: Array
    jacobian: Array
    trial: Array


def refine_room() -> RefineRoom:
    """Make the room that ``levenberg_marquardt`` works in."""
    size = (UNKNOWNS, UNKNOWNS + 1)
    return RefineRoom(
        np.empty(size), np.empty(size), np.empty((2, UNKNOWNS + 1)), np.empty(ROW_SIZE)
    )


@jit
def scale_of(x: float, y: float, z: float, g: float, h: float) -> float:
    """Return σ of a point of the camera's frame; NaN where no pixel sees it."""
    gh4 = 4.0 * g * h
    rho2 = x * x + y * y
    w = math.sqrt(max(z * z - gh4 * rho2, 0.0))
    if z * z < gh4 * rho2:
        return math.nan
    # Behind the image plane Z + w cancels; the other form of the same root does not.
    sigma = 2.0 * g / (z + w) if z > 0.0 else 2.0 * g * (z - w) / (gh4 * rho2)
    return sigma if sigma > 0.0 else math.nan


@jit
def squared_error(row: Array, image: Array, board: Array, i: int) -> float:
    """Return the squared reprojection error of point i, px²; infinite where it is not seen."""
    x = row[0] * board[i, 0] + row[1] * board[i, 1] + row[TRANSLATION]
    y = row[3] * board[i, 0] + row[4] * board[i, 1] + row[TRANSLATION + 1]
    z = row[6] * board[i, 0] + row[7] * board[i, 1] + row[TRANSLATION + 2]
    sigma = scale_of(x, y, z, row[G], row[H])
    dx, dy = sigma * x - image[i, 0], sigma * y - image[i, 1]
    error = dx * dx + dy * dy
    return error if error < math.inf else math.inf


@jit
def truncated_cost(row: Array, image: Array, board: Array, limit: float, enough: float) -> float:
    """Sum the squared errors, each cut off at ``limit`` px²; stop where the sum passes enough."""
    cost = 0.0
    for i in range(len(image)):
        cost += min(squared_error(row, image, board, i), limit)
        if cost > enough:
            break
    return cost


@jit
def normal_equations(
    row: Array, image: Array, board: Array, limit: float, normal: Array, jacobian: Array
) -> int:
    """
    Write JᵀJ and -Jᵀr, (8, 9), over the points whose squared error is below the limit.

    The order is ω, t, g, h; ``jacobian`` (2, 9) is room for one point. Returned is their number.
    """
    normal[:, :] = 0.0
    count = 0
    for i in range(len(image)):
        if not linearise(row, image, board, i, limit, jacobian):
            continue
        count += 1
        for a in range(UNKNOWNS):
            for b in range(a, UNKNOWNS + 1):
                normal[a, b] += jacobian[0, a] * jacobian[0, b] + jacobian[1, a] * jacobian[1, b]
    for a in range(UNKNOWNS):
        for b in range(a):
            normal[a, b] = normal[b, a]
        normal[a, UNKNOWNS] = -normal[a, UNKNOWNS]
    return count


@jit
def linearise(
    row: Array, image: Array, board: Array, i: int, limit: float, jacobian: Array
) -> bool:
    """
    Write the (2, 9) Jacobian and residual of one point; False where it is cut off.

    Columns: rotation about x, y, z, translation, g, h, then the residual, px.
    """
    qx = row[0] * board[i, 0] + row[1] * board[i, 1]
    qy = row[3] * board[i, 0] + row[4] * board[i, 1]
    qz = row[6] * board[i, 0] + row[7] * board[i, 1]
    x, y, z = qx + row[TRANSLATION], qy + row[TRANSLATION + 1], qz + row[TRANSLATION + 2]
    g, h = row[G], row[H]
    sigma = scale_of(x, y, z, g, h)
    ex, ey = sigma * x - image[i, 0], sigma * y - image[i, 1]
    if not ex * ex + ey * ey < limit:
        return False
    rho2 = x * x + y * y
    w = math.sqrt(max(z * z - 4.0 * g * h * rho2, 1e-300))
    # dσ = s_x dX + s_y dY + s_z dZ + s_g dg + s_h dh
    s_x, s_y = 2.0 * h * sigma * sigma * x / w, 2.0 * h * sigma * sigma * y / w
    s_z, s_g, s_h = -sigma / w, 1.0 / w, rho2 * sigma * sigma / w
    # d(σ X) = (σ + X s_x) dX + X s_y dY + X s_z dZ + ..., and dP = ω x Q + dt.
    _fill(jacobian[0], sigma + x * s_x, x * s_y, x * s_z, qx, qy, qz)
    _fill(jacobian[1], y * s_x, sigma + y * s_y, y * s_z, qx, qy, qz)
    jacobian[0, 6], jacobian[0, 7], jacobian[0, 8] = x * s_g, x * s_h, ex
    jacobian[1, 6], jacobian[1, 7], jacobian[1, 8] = y * s_g, y * s_h, ey
    return True


@jit
def _fill(line: Array, ax: float, ay: float, az: float, qx: float, qy: float, qz: float) -> None:
    """Write a · (ω x Q + dt) = (Q x a) · ω + a · dt."""
    line[0] = qy * az - qz * ay
    line[1] = qz * ax - qx * az
    line[2] = qx * ay - qy * ax
    line[3] = ax
    line[4] = ay
    line[5] = az


@jit
def levenberg_marquardt(
    row: Array,
    image: Array,
    board: Array,
    limit: float,
    unknowns: int,
    max_steps: int,
    tolerance: float,
    room: RefineRoom,
) -> float:
    """
    Minimise the truncated cost from ``row``, in place; return the cost.

    ``unknowns`` is 8, or 6 where the camera is known. It ends after max_steps trials, or where a
    step lowers the cost by less than the share ``tolerance``.
    """
    cost = truncated_cost(row, image, board, limit, math.inf)
    damping = _FIRST_DAMPING
    fresh = True
    for _ in range(max_steps):
        if fresh and normal_equations(row, image, board, limit, room.normal, room.jacobian) < 4:
            break
        fresh = False
        _damp(room.normal, damping, unknowns, room.system)
        lower = math.inf
        if solve_in_place(room.system, unknowns):
            _move(row, room.system, unknowns, room.trial)
            if room.trial[G] > 0.0:
                lower = truncated_cost(room.trial, image, board, limit, cost)
        if lower < cost:
            gain = cost - lower
            row[:] = room.trial
            fresh = True
            damping = max(0.1 * damping, 1e-12)
            if gain <= tolerance * cost:
                return lower
            cost = lower
        else:
            damping *= 10.0
            if damping > _LARGEST_DAMPING:
                break
    return cost


@jit
def _damp(normal: Array, damping: float, unknowns: int, system: Array) -> None:
    for a in range(unknowns):
        for b in range(unknowns):
            system[a, b] = normal[a, b]
        system[a, a] *= 1.0 + damping
        system[a, unknowns] = normal[a, UNKNOWNS]


@jit
def _move(row: Array, system: Array, unknowns: int, trial: Array) -> None:
    rotate(row, system[0, unknowns], system[1, unknowns], system[2, unknowns], trial)
    for i in range(3):
        trial[TRANSLATION + i] = row[TRANSLATION + i] + system[3 + i, unknowns]
    trial[G] = row[G]
    trial[H] = row[H]
    if unknowns == UNKNOWNS:
        trial[G] += system[6, unknowns]
        trial[H] += system[7, unknowns]
