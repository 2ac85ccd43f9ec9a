# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""
The division camera in the kernels: a lens (10,), its projection and the derivatives.

A point P = (X, Y, Z) of the camera's frame is seen by the lens at e = s (X, Y), s > 0, where the
ray (e, w(|e|²)) goes through P. With ρ² = X² + Y², q = s² ρ²:

    w(q) = s Z,     w(q) = 1 + k q + k2 q² + k3 q³ + k4 q⁴.

The differential of that equation gives every derivative, with w' = dw/dq:

    (Z - 2 s ρ² w') ds = w' s² d(ρ²) - s dZ + q dk + q² dk2 + q³ dk3 + q⁴ dk4.

The factor on the left is positive up to the fold of the lens. Decentring and the pixels follow:

    e = d + D(d),     D(x, y) = (2 p1 x y + p2 (q + 2 x²), p1 (q + 2 y²) + 2 p2 x y),   q = |d|²,
    u = c + f (dx, (1 + a) dy).
"""

from __future__ import annotations

import math

import numpy as np

from .normal_equations import fill_pose_columns
from ..cameras.division import DivisionCamera
from ..geometry import Array, TRANSLATION
from ..jit import kernel

# Entries of a lens: focal length (px), centre (px, from the middle of the image), k to k4,
# a = fy / fx - 1, p1, p2.
FOCAL, CX, CY, K, K2, K3, K4, ASPECT, P1, P2 = range(10)
LENS_SIZE = 10
TERMS = slice(K, K4 + 1)

# Columns of a point's derivatives: rotation, translation, lens.
POSE_COLUMNS = 6
LENS_END = POSE_COLUMNS + LENS_SIZE

# Newton's method for s with more than one term. It starts at 1 / Z near the axis (ρ² / Z² below
# the limit), elsewhere at the observed pixel.
_NEWTON_STEPS = 10
# It ends after a step this small, relative: it converges quadratically.
_CONVERGED = 1e-9
_NEAR_AXIS = 0.01

# Newton's method for d of e, from d = e - D(e): decentring is small, and two steps are exact.
_DECENTRING_STEPS = 2


def lens_from_camera(camera: DivisionCamera, middle_px: tuple[float, float]) -> Array:
    """Return the lens (10,) of a camera, its centre relative to the middle of the image."""
    x, y = np.subtract(camera.center_px, middle_px).tolist()
    aspect = camera.aspect - 1.0
    return np.array([camera.focal_px, x, y, *camera.terms, aspect, camera.p1, camera.p2])


def camera_from_lens(lens: Array, middle_px: tuple[float, float]) -> DivisionCamera:
    """Return the camera of a lens (10,)."""
    focal_px, x, y, k, k2, k3, k4, aspect, p1, p2 = lens.tolist()
    center_px = x + middle_px[0], y + middle_px[1]
    return DivisionCamera.unchecked(focal_px, center_px, k, k2, k3, k4, 1.0 + aspect, p1, p2)


@kernel
def offset_px(
    x: float, y: float, z: float, lens: Array, u: float, v: float
) -> tuple[float, float]:
    """Return the pixel, from the centre, of a point of the camera's frame observed near (u, v)."""
    s = _scale(x, y, z, lens, u, v)
    dx, dy = _without_decentring(s * x, s * y, lens)
    return lens[FOCAL] * dx, lens[FOCAL] * (1.0 + lens[ASPECT]) * dy


@kernel
def linearise_rotated(
    qx: float,
    qy: float,
    qz: float,
    pose: Array,
    lens: Array,
    u: float,
    v: float,
    jacobian: Array,
) -> tuple[float, float]:
    """
    Write the (2, 16) derivatives of the point P = Q + t, px; NaN if it is not visible.

    Q = R X: the point of the board X, rotated. Return its pixel from the centre.
    """
    x, y, z = qx + pose[TRANSLATION], qy + pose[TRANSLATION + 1], qz + pose[TRANSLATION + 2]
    fx = lens[FOCAL]
    fy = fx * (1.0 + lens[ASPECT])
    s = _scale(x, y, z, lens, u, v)
    rho2 = x * x + y * y
    q = s * s * rho2
    _, slope = depth_and_slope(lens, q)
    inverse = 1.0 / (z - 2.0 * s * rho2 * slope)
    s_rho2, s_z = slope * s * s * inverse, -s * inverse
    s_x, s_y = 2.0 * x * s_rho2, 2.0 * y * s_rho2
    ex, ey = s * x, s * y
    dx, dy = _without_decentring(ex, ey, lens)
    # du = f (1 + D')⁻¹ (de - D_p dp)
    a, b, c, d = inverse_decentring(dx, dy, lens)
    a, b, c, d = fx * a, fx * b, fy * c, fy * d
    xx, xy, xz = s + x * s_x, x * s_y, x * s_z
    yx, yy, yz = y * s_x, s + y * s_y, y * s_z
    fill_pose_columns(jacobian, 0, a * xx + b * yx, a * xy + b * yy, a * xz + b * yz, qx, qy, qz)
    fill_pose_columns(jacobian, 1, c * xx + d * yx, c * xy + d * yy, c * xz + d * yz, qx, qy, qz)
    for j in range(2):
        along_x, along_y = (a, b) if j == 0 else (c, d)
        _fill_lens_columns(jacobian, j, along_x, along_y, dx, dy)
        power = (along_x * x + along_y * y) * inverse
        for i in range(4):
            power *= q
            jacobian[j, 6 + K + i] = power
    jacobian[0, 6 + FOCAL], jacobian[1, 6 + FOCAL] = dx, (1.0 + lens[ASPECT]) * dy
    jacobian[0, 6 + ASPECT], jacobian[1, 6 + ASPECT] = 0.0, fx * dy
    return fx * dx, fy * dy


@kernel
def _fill_lens_columns(
    jacobian: Array, j: int, along_x: float, along_y: float, x: float, y: float
) -> None:
    """Write the derivatives of coordinate j at d = (x, y) by centre and decentring."""
    xx, xy, yy = x * x, x * y, y * y
    jacobian[j, 6 + CX] = 1.0 - j
    jacobian[j, 6 + CY] = j
    jacobian[j, 6 + P1] = -2.0 * along_x * xy - along_y * (xx + 3.0 * yy)
    jacobian[j, 6 + P2] = -along_x * (3.0 * xx + yy) - 2.0 * along_y * xy


@kernel
def with_decentring(x: float, y: float, lens: Array) -> tuple[float, float]:
    """Return e = d + D(d)."""
    p1, p2 = lens[P1], lens[P2]
    q = x * x + y * y
    return (
        x + 2.0 * p1 * x * y + p2 * (q + 2.0 * x * x),
        y + p1 * (q + 2.0 * y * y) + 2.0 * p2 * x * y,
    )


@kernel
def _without_decentring(ex: float, ey: float, lens: Array) -> tuple[float, float]:
    """Return d of e = d + D(d)."""
    p1, p2 = lens[P1], lens[P2]
    if p1 == 0.0 and p2 == 0.0:
        return ex, ey
    x, y = ex, ey
    for step in range(_DECENTRING_STEPS + 1):
        reached_x, reached_y = with_decentring(x, y, lens)
        miss_x, miss_y = ex - reached_x, ey - reached_y
        if step == 0:
            x, y = x + miss_x, y + miss_y
            continue
        a, b, c, d = inverse_decentring(x, y, lens)
        x, y = x + a * miss_x + b * miss_y, y + c * miss_x + d * miss_y
    return x, y


@kernel
def inverse_decentring(x: float, y: float, lens: Array) -> tuple[float, float, float, float]:
    """Return the inverse of the derivative 1 + D' of e by d, row by row."""
    p1, p2 = lens[P1], lens[P2]
    if p1 == 0.0 and p2 == 0.0:
        return 1.0, 0.0, 0.0, 1.0
    a, d = 1.0 + 2.0 * p1 * y + 6.0 * p2 * x, 1.0 + 6.0 * p1 * y + 2.0 * p2 * x
    b = 2.0 * (p1 * x + p2 * y)
    scale = 1.0 / (a * d - b * b)
    return d * scale, -b * scale, -b * scale, a * scale


@kernel
def depth_and_slope(lens: Array, q: float) -> tuple[float, float]:
    """Return w(q) and w'(q)."""
    k, k2, k3, k4 = lens[K], lens[K2], lens[K3], lens[K4]
    return (
        1.0 + q * (k + q * (k2 + q * (k3 + q * k4))),
        k + q * (2.0 * k2 + q * (3.0 * k3 + q * 4.0 * k4)),
    )


@kernel
def _scale(x: float, y: float, z: float, lens: Array, u: float, v: float) -> float:
    """Return s of a point observed near (u, v); NaN if no pixel near (u, v) sees it."""
    rho2 = x * x + y * y
    if lens[K2] == 0.0 and lens[K3] == 0.0 and lens[K4] == 0.0:
        return one_term_scale(z, lens[K], rho2)
    dx = (u - lens[CX]) / lens[FOCAL]
    dy = (v - lens[CY]) / (lens[FOCAL] * (1.0 + lens[ASPECT]))
    near_axis = z > 0.0 and rho2 < _NEAR_AXIS * z * z
    s = 1.0 / z if near_axis else math.sqrt((dx * dx + dy * dy) / rho2)
    for _ in range(_NEWTON_STEPS):
        q = s * s * rho2
        w, slope = depth_and_slope(lens, q)
        unfolded = z - 2.0 * s * rho2 * slope
        step = (w - s * z) / unfolded
        s += step
        if abs(step) <= _CONVERGED * s:
            return s if unfolded > 0.0 else math.nan
    return math.nan


@kernel
def one_term_scale(z: float, k: float, rho2: float) -> float:
    """Return s of a lens with one term: the root of  k ρ² s² - Z s + 1  that is 1 / Z at k = 0."""
    square = z * z - 4.0 * k * rho2
    if not square >= 0.0:
        return math.nan
    root = math.sqrt(square)
    # Behind the image plane Z + root cancels; the other form of the same root does not.
    s = 2.0 / (z + root) if z > 0.0 else (z - root) / (2.0 * k * rho2)
    return s if 0.0 < s < math.inf else math.nan
