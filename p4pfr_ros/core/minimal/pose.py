# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""
The pose of each root of the sextic: scaling, recovery, and Newton's method on the four points.

``scale_image`` and ``scale_board`` scale a problem, so that a board in mm, in km or far from its
origin is solved alike; ``pose_from_root`` recovers pose, focal length and distortion from a root;
``polish`` removes the rounding error of the sextic; ``unscale`` converts to pixels and the board's
own frame.
"""

from __future__ import annotations

import math
from typing import NamedTuple

from .cone import Cone
from .four import dot, Four, largest, minus, plus, Points, scaled, times
from .sextic import Factors, factors_at
from .solution import G, H, load_row, Row
from ..geometry import Array, TRANSLATION
from ..jit import inlined, kernel
from ..linalg import copy_row, rotate, solve_in_place

# The residual of some ten rounding errors; no step is taken below it.
GOOD_ENOUGH = 2e-15

# A step that does not reduce the residual to this share is the last: the rest is rounding.
_WORTHWHILE = 0.5
_MAX_STEPS = 3


@inlined
def scale_image(image: Points) -> tuple[float, Points, Four]:
    """
    Scale the farthest point to radius 1; return the scale, px, the points and their radii.

    The scale is 0 if all points are at the centre, or one is too far for a double.
    """
    x, y = image
    r2 = plus(times(x, x), times(y, y))
    farthest2 = largest(r2)
    valid = 0.0 < farthest2 < math.inf
    scale_px = math.sqrt(farthest2) if valid else 0.0
    inverse = 1.0 / scale_px if valid else 0.0
    radius = (math.sqrt(r2[0]), math.sqrt(r2[1]), math.sqrt(r2[2]), math.sqrt(r2[3]))
    return scale_px, Points(scaled(x, inverse), scaled(y, inverse)), scaled(radius, inverse)


# Size and centroid of a board, in its own unit and frame.
Frame = tuple[float, float, float]


class Board(NamedTuple):
    """The board centred and scaled to about 1, and its dual vectors."""

    points: Points
    duals: Points
    frame: Frame


@inlined
def scale_board(board: Points) -> Board:
    """
    Centre and scale the board, and compute its dual vectors c.

    With the centred points X̂ᵢ, cᵢ = (Σ X̂ X̂ᵀ)⁻¹ X̂ᵢ has Σ cᵢ = 0 and Σ X̂ᵢ cᵢᵀ = I: for any affine
    map of the board, Qᵢ = H X̂ᵢ + t, the sum Σ Qᵢ cᵢᵀ is H.
    """
    # Far from the origin the board's mean is rounded, but differences of its points are not.
    x, mean_x = _centred(board.x)
    y, mean_y = _centred(board.y)
    size = max(largest(x), largest(y))
    inverse = 1.0 / size if size > 0.0 else 0.0
    x, y = scaled(x, inverse), scaled(y, inverse)
    xx, xy, yy = dot(x, x), dot(x, y), dot(y, y)
    determinant = xx * yy - xy * xy
    inverse = 1.0 / determinant if determinant != 0.0 else 0.0
    duals = Points(
        scaled(minus(scaled(x, yy), scaled(y, xy)), inverse),
        scaled(minus(scaled(y, xx), scaled(x, xy)), inverse),
    )
    return Board(Points(x, y), duals, (size, board.x[0] + mean_x, board.y[0] + mean_y))


@inlined
def _centred(a: Four) -> tuple[Four, float]:
    """Return the deviations from the mean, and the mean as measured from the first."""
    d1, d2, d3 = a[1] - a[0], a[2] - a[0], a[3] - a[0]
    mean = 0.25 * (d1 + d2 + d3)
    return (-mean, d1 - mean, d2 - mean, d3 - mean), mean


@inlined
def pose_from_root(f: Factors, tau: float, cone: Cone, image: Points) -> tuple[bool, Row]:
    """Return whether a root has a pose; pose, focal length and h of the scaled problem."""
    u, v, l, p, n, d = factors_at(f, tau)  # noqa: E741
    z_x, z_y = d * l.real - n * p.real, d * l.imag - n * p.imag
    q_x, q_y = u.real * v.real - u.imag * v.imag, u.real * v.imag + u.imag * v.real
    # Re(q z̄²), z² = (z_x² - z_y²) + 2i z_x z_y.
    re = q_x * (z_x * z_x - z_y * z_y) + q_y * (z_x * z_y + z_x * z_y)
    norm = z_x * z_x + z_y * z_y
    # From q + f² z²/d² = 0: f is undetermined if z = 0 (fronto-parallel), k if d = 0, and f² > 0
    # requires Re(q z̄²) < 0.
    valid = norm > 0.0 and d != 0.0 and re < 0.0
    by_d = math.sqrt(-re) / norm if valid else 1.0
    by_d = by_d if d > 0.0 else -by_d
    focal, h = by_d * d, -by_d * n
    inverse_scale, r = orthogonal_factor(
        complex(0.5 * (u.real + v.real), 0.5 * (u.imag + v.imag)),
        complex(0.5 * (u.imag - v.imag), -0.5 * (u.real - v.real)),
        complex(by_d * z_x, by_d * z_y),
    )
    # The centroid: the mean of Qᵢ = λᵢ (xᵢ, yᵢ, g + h rᵢ²), divided by s.
    x, y = image
    depth = plus(scaled(cone.a, 1.0 - tau), scaled(cone.b, tau))
    inverse = 0.25 * inverse_scale
    r2 = plus(times(x, x), times(y, y))
    ray_z = (focal + h * r2[0], focal + h * r2[1], focal + h * r2[2], focal + h * r2[3])
    t = (inverse * dot(depth, x), inverse * dot(depth, y), inverse * dot(depth, ray_z))
    return valid and 0.0 < focal < math.inf and inverse_scale > 0.0, (*r, *t, focal, h)


Nine = tuple[float, float, float, float, float, float, float, float, float]


@inlined
def orthogonal_factor(h1: complex, h2: complex, h3: complex) -> tuple[float, Nine]:
    """
    Return 1 / s, and the rotation nearest to s [r₁ r₂] = [Re h, Im h]; 0 if there is none.

    The rotation is orthonormal to rounding, whatever the rounding of h.
    """
    # H (HᵀH)^(-1/2), with the 2x2 root in closed form:
    #     G^(1/2) = (G + δ I)/t,  G^(-1/2) = (adj G + δ I)/(δ t),  δ² = det G,  t² = tr G + 2 δ.
    g11 = h1.real * h1.real + h2.real * h2.real + h3.real * h3.real
    g22 = h1.imag * h1.imag + h2.imag * h2.imag + h3.imag * h3.imag
    g12 = h1.real * h1.imag + h2.real * h2.imag + h3.real * h3.imag
    delta = math.sqrt(max(0.0, g11 * g22 - g12 * g12))
    trace = math.sqrt(g11 + g22 + 2.0 * delta)
    inverse = 1.0 / (delta * trace) if delta > 0.0 else 0.0
    a, b, c = (g22 + delta) * inverse, -g12 * inverse, (g11 + delta) * inverse
    x1, x2 = h1.real * a + h1.imag * b, h1.real * b + h1.imag * c
    y1, y2 = h2.real * a + h2.imag * b, h2.real * b + h2.imag * c
    z1, z2 = h3.real * a + h3.imag * b, h3.real * b + h3.imag * c
    rotation = (
        (x1, x2, y1 * z2 - z1 * y2),
        (y1, y2, z1 * x2 - x1 * z2),
        (z1, z2, x1 * y2 - y1 * x2),
    )
    return 2.0 * delta * inverse, (*rotation[0], *rotation[1], *rotation[2])


@inlined
def is_accurate(row: Row, image: Points, board: Points) -> bool:
    """Return whether ``residual_of`` is at most GOOD_ENOUGH, without divisions and roots."""
    (c0, p0), (c1, p1), (c2, p2), (c3, p3) = _squares(row, image, board)
    share = GOOD_ENOUGH * GOOD_ENOUGH
    return (c0 <= share * p0 and c1 <= share * p1) and (c2 <= share * p2 and c3 <= share * p3)


@inlined
def residual_of(row: Row, image: Points, board: Points) -> float:
    """
    Return the largest |P x ρ| / |P| of the points P and the rays ρ that they should lie on.

    It is |ρ| times the sine of the angle between the two; infinite if a point is behind the camera
    or not a number.
    """
    (c0, p0), (c1, p1), (c2, p2), (c3, p3) = _squares(row, image, board)
    return math.sqrt(max(max(c0 / p0, c1 / p1), max(c2 / p2, c3 / p3)))


Pair = tuple[float, float]


@inlined
def _squares(row: Row, image: Points, board: Points) -> tuple[Pair, Pair, Pair, Pair]:
    x, y = image
    return (
        _square(row, x[0], y[0], board.x[0], board.y[0]),
        _square(row, x[1], y[1], board.x[1], board.y[1]),
        _square(row, x[2], y[2], board.x[2], board.y[2]),
        _square(row, x[3], y[3], board.x[3], board.y[3]),
    )


@inlined
def _square(row: Row, x: float, y: float, bx: float, by: float) -> Pair:
    """Return |P x ρ|² and |P|² of a point; the first is infinite if P is behind the camera."""
    px = row[0] * bx + row[1] * by + row[9]
    py = row[3] * bx + row[4] * by + row[10]
    pz = row[6] * bx + row[7] * by + row[11]
    z = row[G] + row[H] * (x * x + y * y)
    cx, cy, cz = py * z - pz * y, pz * x - px * z, px * y - py * x
    square = cx * cx + cy * cy + cz * cz
    # Written so that NaN is rejected like a point behind the camera.
    in_front = px * x + py * y + pz * z > 0.0
    return square if in_front else math.inf, px * px + py * py + pz * pz


@kernel
def polish(solution: Array, image: Points, board: Points, system: Array, trial: Array) -> float:
    """
    Improve a solution (ROW_SIZE,) in place, by Newton's method; return its residual.

    Image and board are scaled to about 1; ``system`` (8, 9) and ``trial`` (ROW_SIZE,) are
    workspace.
    """
    residual = residual_of(load_row(solution), image, board)
    for _ in range(_MAX_STEPS):
        if residual <= GOOD_ENOUGH:
            break
        _linearise(solution, image, board, system)
        if not solve_in_place(system, 8):
            break
        _newton_step(solution, system, trial)
        trial_residual = residual_of(load_row(trial), image, board)
        worthwhile = trial_residual < _WORTHWHILE * residual
        if trial_residual < residual:
            copy_row(trial, solution)
            residual = trial_residual
        if not worthwhile:
            break
    return residual


@kernel
def _linearise(solution: Array, image: Points, board: Points, system: Array) -> None:
    """Write the (8, 9) system of the step: rotation, translation, g, h; then the right side."""
    for i in range(4):
        bx, by = board.x[i], board.y[i]
        qx = solution[0] * bx + solution[1] * by
        qy = solution[3] * bx + solution[4] * by
        qz = solution[6] * bx + solution[7] * by
        px = qx + solution[TRANSLATION]
        py = qy + solution[TRANSLATION + 1]
        pz = qz + solution[TRANSLATION + 2]
        x, y = image.x[i], image.y[i]
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
        ex = (y * az - z * ay) / length
        ey = (z * ax - x * az) / length
        ez = (x * ay - y * ax) / length
        # e1 · (P x ρ) = (ρ x e1) · P = |ρ| e2 · P  and  e2 · (P x ρ) = -|ρ| e1 · P.
        # Divided by |ρ|, with dP = ω x Q + dt, Q = R X, and dρ = (0, 0, dg + r² dh):
        #     e · dP = (Q x e) · ω + e · dt,     e1 · (P x dρ) = (e1x Py - e1y Px) dρz.
        first, second = 2 * i, 2 * i + 1
        _fill_row(system[first], qx, qy, qz, ex, ey, ez, (ax * py - ay * px) / length, r2)
        _fill_row(system[second], qx, qy, qz, ax, ay, az, -(ex * py - ey * px) / length, r2)
        system[first, 8] = -(ex * px + ey * py + ez * pz)
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


@inlined
def unscale(row: Row, scale_px: float, frame: Frame) -> Row:
    """Convert a solution of the scaled, centred problem to pixels and the board's own frame."""
    size, x, y = frame
    return (
        *row[:9],
        row[9] * size - row[0] * x - row[1] * y,
        row[10] * size - row[3] * x - row[4] * y,
        row[11] * size - row[6] * x - row[7] * y,
        row[G] * scale_px,
        row[H] / scale_px,
    )
