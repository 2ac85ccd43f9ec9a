# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""Newton's method on the reprojection of four points: what rounding cost the sextic comes back."""

from __future__ import annotations

import math

from .solution import G, H, TRANSLATION
from ..geometry import Array
from ..jit import kernel
from ..linalg import copy_row, rotate, solve_in_place

# The residual that some ten roundings leave: no step below it.
_GOOD_ENOUGH = 2e-15

# A step that does not lower the residual by so much was rounding's; each costs more than a root.
_WORTHWHILE = 0.5
_MAX_STEPS = 3


@kernel
def polish(solution: Array, image: Array, board: Array, system: Array, trial: Array) -> float:
    """
    Improve a solution in place and return its residual.

    image is (4, 2) and board (4, 2), both scaled to about 1; ``system`` (8, 9) and ``trial``
    (ROW_SIZE,) are room to work in. The residual is the largest |P x ρ| / |P| of the points P and
    the rays ρ that they should lie on: where the ray is long (telephoto) the displacement in the
    image, else the sine of the angle. Infinite where a point is behind, or is not a number.
    """
    residual = _residual(solution, image, board)
    for _ in range(_MAX_STEPS):
        if residual <= _GOOD_ENOUGH:
            break
        _linearise(solution, image, board, system)
        if not solve_in_place(system, 8):
            break
        _step(solution, system, trial)
        better = _residual(trial, image, board)
        worthwhile = better < _WORTHWHILE * residual
        if better < residual:
            copy_row(trial, solution)
            residual = better
        if not worthwhile:
            break
    return residual


@kernel
def _point(s: Array, x: float, y: float) -> tuple[float, float, float]:
    """Take a board point to the camera's frame, without the translation."""
    return (s[0] * x + s[1] * y, s[3] * x + s[4] * y, s[6] * x + s[7] * y)


@kernel
def _residual(solution: Array, image: Array, board: Array) -> float:
    worst = 0.0
    for i in range(4):
        px, py, pz = _point(solution, board[i, 0], board[i, 1])
        px += solution[TRANSLATION]
        py += solution[TRANSLATION + 1]
        pz += solution[TRANSLATION + 2]
        x, y = image[i, 0], image[i, 1]
        z = solution[G] + solution[H] * (x * x + y * y)
        cx, cy, cz = py * z - pz * y, pz * x - px * z, px * y - py * x
        miss2 = (cx * cx + cy * cy + cz * cz) / (px * px + py * py + pz * pz)
        # Behind the camera, along the ray, is no solution; NaN is none either.
        if not px * x + py * y + pz * z > 0.0:
            return math.inf
        worst = max(worst, miss2)
    return math.sqrt(worst)


@kernel
def _linearise(solution: Array, image: Array, board: Array, system: Array) -> None:
    """Write the (8, 9) system of the step: rotation, translation, g, h; then the right side."""
    for i in range(4):
        qx, qy, qz = _point(solution, board[i, 0], board[i, 1])
        px = qx + solution[TRANSLATION]
        py = qy + solution[TRANSLATION + 1]
        pz = qz + solution[TRANSLATION + 2]
        x, y = image[i, 0], image[i, 1]
        r2 = x * x + y * y
        z = solution[G] + solution[H] * r2
        # The ray ρ = (x, y, z) meets the point P when P x ρ = 0: of its three rows two count,
        # taken along e1, e2 with (e1, e2, ρ) right-handed and orthogonal. ρ need not be long in
        # any one direction, so e1 is made from its largest components.
        if abs(z) > abs(x):
            norm = math.hypot(z, y)
            ax, ay, az = 0.0, z / norm, -y / norm
        else:
            norm = math.hypot(x, y)
            ax, ay, az = y / norm, -x / norm, 0.0
        length = math.sqrt(r2 + z * z)
        bx = (y * az - z * ay) / length
        by = (z * ax - x * az) / length
        bz = (x * ay - y * ax) / length
        # e1 · (P x ρ) = (ρ x e1) · P = |ρ| e2 · P  and  e2 · (P x ρ) = -|ρ| e1 · P.
        # Divided by |ρ|, with dP = ω x Q + dt, Q = R X, and dρ = (0, 0, dg + r² dh):
        #     e · dP = (Q x e) · ω + e · dt,     e1 · (P x dρ) = (e1x Py - e1y Px) dρz.
        first, second = 2 * i, 2 * i + 1
        _fill_row(system[first], qx, qy, qz, bx, by, bz, (ax * py - ay * px) / length, r2)
        _fill_row(system[second], qx, qy, qz, ax, ay, az, -(bx * py - by * px) / length, r2)
        system[first, 8] = -(bx * px + by * py + bz * pz)
        system[second, 8] = -(ax * px + ay * py + az * pz)


@kernel
def _fill_row(
    row: Array,
    qx: float,
    qy: float,
    qz: float,
    ex: float,
    ey: float,
    ez: float,
    by_depth: float,
    r2: float,
) -> None:
    row[0] = qy * ez - qz * ey
    row[1] = qz * ex - qx * ez
    row[2] = qx * ey - qy * ex
    row[3] = ex
    row[4] = ey
    row[5] = ez
    row[6] = by_depth
    row[7] = by_depth * r2


@kernel
def _step(solution: Array, system: Array, trial: Array) -> None:
    rotate(solution, system[0, 8], system[1, 8], system[2, 8], trial)
    for i in range(3):
        trial[TRANSLATION + i] = solution[TRANSLATION + i] + system[3 + i, 8]
    trial[G] = solution[G] + system[6, 8]
    trial[H] = solution[H] + system[7, 8]
