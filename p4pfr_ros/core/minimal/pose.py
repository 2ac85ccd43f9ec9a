# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""
The pose of each root of the sextic: scaling, recovery, and Newton's method on the four points.

``scale_image`` and ``board_duals`` scale a problem, so that a board in mm, in km or far from its
origin is solved alike; ``pose_from_root`` and ``place_centroid`` recover pose, focal length and
distortion from a root; ``polish`` removes the rounding error of the sextic; ``unscale`` converts
to pixels and the board's own frame.
"""

from __future__ import annotations

import math

from .sextic import evaluate, Factors
from .solution import G, H
from ..geometry import Array, TRANSLATION
from ..jit import kernel
from ..linalg import copy_row, rotate, solve_in_place

# The residual of some ten rounding errors; no step is taken below it.
_GOOD_ENOUGH = 2e-15

# A step that does not reduce the residual to this share is the last: the rest is rounding.
_WORTHWHILE = 0.5
_MAX_STEPS = 3


@kernel
def scale_image(image: Array, scaled: Array, radius: Array) -> float:
    """Scale the farthest point to radius 1; write the radii (4,); return the scale, px."""
    farthest2 = 0.0
    for i in range(4):
        radius[i] = image[i, 0] * image[i, 0] + image[i, 1] * image[i, 1]
        farthest2 = max(farthest2, radius[i])
    if not 0.0 < farthest2 < math.inf:
        return 0.0
    scale_px = math.sqrt(farthest2)
    inverse = 1.0 / scale_px
    for i in range(4):
        scaled[i, 0] = image[i, 0] * inverse
        scaled[i, 1] = image[i, 1] * inverse
        radius[i] = math.sqrt(radius[i]) * inverse
    return scale_px


@kernel
def board_duals(board: Array, scaled: Array, duals: Array) -> float:
    """
    Centre the board, scale it to about 1, and compute its dual vectors c (4, 2).

    With the centred points X̂ᵢ, cᵢ = (Σ X̂ X̂ᵀ)⁻¹ X̂ᵢ has Σ cᵢ = 0 and Σ X̂ᵢ cᵢᵀ = I: for any affine
    map of the board, Qᵢ = H X̂ᵢ + t, the sum Σ Qᵢ cᵢᵀ is H. Return the scale, board units.
    """
    mx, my = _mean_from_first(board)
    size = 0.0
    for i in range(4):
        # Far from the origin the board's mean is rounded, but differences of its points are not.
        scaled[i, 0] = (board[i, 0] - board[0, 0]) - mx
        scaled[i, 1] = (board[i, 1] - board[0, 1]) - my
        size = max(size, max(abs(scaled[i, 0]), abs(scaled[i, 1])))
    inverse = 1.0 / size
    xx = xy = yy = 0.0
    for i in range(4):
        scaled[i, 0] *= inverse
        scaled[i, 1] *= inverse
        xx += scaled[i, 0] * scaled[i, 0]
        xy += scaled[i, 0] * scaled[i, 1]
        yy += scaled[i, 1] * scaled[i, 1]
    determinant = xx * yy - xy * xy
    for i in range(4):
        duals[i, 0] = (yy * scaled[i, 0] - xy * scaled[i, 1]) / determinant
        duals[i, 1] = (xx * scaled[i, 1] - xy * scaled[i, 0]) / determinant
    return size


@kernel
def pose_from_root(f: Factors, tau: float, row: Array) -> bool:
    """Write rotation, focal length and h of a root; the translation slot holds the scale."""
    at = evaluate(f, tau)
    norm = at.z.real * at.z.real + at.z.imag * at.z.imag
    # From q + f² z²/d² = 0: f is undetermined if z = 0 (fronto-parallel), k if d = 0, and f² > 0
    # requires Re(q z̄²) < 0.
    if not (norm > 0.0 and at.d != 0.0 and at.re < 0.0):
        return False
    focal = math.sqrt(-at.re) * abs(at.d) / norm
    if not focal < math.inf:
        return False
    h1 = 0.5 * (at.u + at.v)
    h2 = -0.5j * (at.u - at.v)
    h3 = (focal / at.d) * at.z
    scale = orthogonal_factor(h1, h2, h3, row)
    row[TRANSLATION] = scale
    row[G] = focal
    row[H] = -focal * at.n / at.d
    return scale > 0.0


@kernel
def orthogonal_factor(h1: complex, h2: complex, h3: complex, row: Array) -> float:
    """
    Write the rotation nearest to s [r₁ r₂] = [Re h, Im h] and return its scale s; 0 if none.

    The rotation is orthonormal to rounding, whatever the rounding of h.
    """
    # H (HᵀH)^(-1/2), with the 2x2 root in closed form:
    #     G^(1/2) = (G + δ I)/t,  G^(-1/2) = (adj G + δ I)/(δ t),  δ² = det G,  t² = tr G + 2 δ.
    g11 = h1.real * h1.real + h2.real * h2.real + h3.real * h3.real
    g22 = h1.imag * h1.imag + h2.imag * h2.imag + h3.imag * h3.imag
    g12 = h1.real * h1.imag + h2.real * h2.imag + h3.real * h3.imag
    delta = math.sqrt(max(0.0, g11 * g22 - g12 * g12))
    trace = math.sqrt(g11 + g22 + 2.0 * delta)
    if not delta > 0.0:
        return 0.0
    inverse = 1.0 / (delta * trace)
    a, b, c = (g22 + delta) * inverse, -g12 * inverse, (g11 + delta) * inverse
    row[0], row[1] = h1.real * a + h1.imag * b, h1.real * b + h1.imag * c
    row[3], row[4] = h2.real * a + h2.imag * b, h2.real * b + h2.imag * c
    row[6], row[7] = h3.real * a + h3.imag * b, h3.real * b + h3.imag * c
    row[2] = row[3] * row[7] - row[6] * row[4]
    row[5] = row[6] * row[1] - row[0] * row[7]
    row[8] = row[0] * row[4] - row[3] * row[1]
    return 0.5 * trace


@kernel
def place_centroid(rays: Array, tau: float, image: Array, row: Array) -> None:
    """Replace the scale in the translation slot by the centroid in the camera's frame."""
    scale = 0.25 / row[TRANSLATION]
    tx = ty = tz = 0.0
    for i in range(4):
        depth = (1.0 - tau) * rays[0, i] + tau * rays[1, i]
        x, y = image[i, 0], image[i, 1]
        tx += depth * x
        ty += depth * y
        tz += depth * (row[G] + row[H] * (x * x + y * y))
    row[TRANSLATION] = scale * tx
    row[TRANSLATION + 1] = scale * ty
    row[TRANSLATION + 2] = scale * tz


@kernel
def polish(solution: Array, image: Array, board: Array, system: Array, trial: Array) -> float:
    """
    Improve a solution in place and return its residual.

    image is (4, 2) and board (4, 2), both scaled to about 1; ``system`` (8, 9) and ``trial``
    (ROW_SIZE,) are workspace. The residual is the largest |P x ρ| / |P| of the points P and the
    rays ρ that they should lie on, which is |ρ| times the sine of the angle between the two.
    Infinite if a point is behind the camera or not a number.
    """
    residual = _residual(solution, image, board)
    for _ in range(_MAX_STEPS):
        if residual <= _GOOD_ENOUGH:
            break
        _linearise(solution, image, board, system)
        if not solve_in_place(system, 8):
            break
        _newton_step(solution, system, trial)
        trial_residual = _residual(trial, image, board)
        worthwhile = trial_residual < _WORTHWHILE * residual
        if trial_residual < residual:
            copy_row(trial, solution)
            residual = trial_residual
        if not worthwhile:
            break
    return residual


@kernel
def _point(s: Array, x: float, y: float) -> tuple[float, float, float]:
    """Rotate a board point to the camera's frame, without the translation."""
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
        square = (cx * cx + cy * cy + cz * cz) / (px * px + py * py + pz * pz)
        # Written so that NaN is rejected like a point behind the camera.
        if not px * x + py * y + pz * z > 0.0:
            return math.inf
        worst = max(worst, square)
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
        # The ray ρ = (x, y, z) meets the point P if P x ρ = 0. Two of its three rows are
        # independent: along e1, e2 with (e1, e2, ρ) right-handed and orthogonal. No component of
        # ρ is always large, so e1 is made from the largest ones.
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
def _newton_step(solution: Array, system: Array, trial: Array) -> None:
    rotate(solution, system[0, 8], system[1, 8], system[2, 8], trial)
    for i in range(3):
        trial[TRANSLATION + i] = solution[TRANSLATION + i] + system[3 + i, 8]
    trial[G] = solution[G] + system[6, 8]
    trial[H] = solution[H] + system[7, 8]


@kernel
def _mean_from_first(board: Array) -> tuple[float, float]:
    x, y = board[0, 0], board[0, 1]
    return (
        0.25 * ((board[1, 0] - x) + (board[2, 0] - x) + (board[3, 0] - x)),
        0.25 * ((board[1, 1] - y) + (board[2, 1] - y) + (board[3, 1] - y)),
    )


@kernel
def unscale(row: Array, board: Array, scale_px: float, size: float) -> None:
    """Convert a solution of the scaled, centred problem to pixels and the board's own frame."""
    row[G] *= scale_px
    row[H] /= scale_px
    mx, my = _mean_from_first(board)
    mx += board[0, 0]
    my += board[0, 1]
    for i in range(3):
        t = row[TRANSLATION + i] * size
        row[TRANSLATION + i] = t - row[3 * i] * mx - row[3 * i + 1] * my
