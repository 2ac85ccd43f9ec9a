# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""
The division camera of many views in the kernels: a lens (6,), one to three terms, free centre.

A point P = (X, Y, Z) of the camera's frame projects to  u = c + f s (X, Y),  s > 0, where the ray
(d, w(|d|²)), d = s (X, Y), goes through P. With ρ² = X² + Y², q = s² ρ²:

    w(q) = s Z,     w(q) = 1 + k q + k2 q² + k3 q³.

The differential of that equation gives every derivative, with w' = dw/dq:

    (Z - 2 s ρ² w') ds = w' s² d(ρ²) - s dZ + q dk + q² dk2 + q³ dk3.

The factor on the left is positive up to the fold of the lens.
"""

from __future__ import annotations

import math

import numpy as np

from .normal_equations import fill_pose_columns
from ..cameras.division import DivisionCamera
from ..geometry import Array, TRANSLATION
from ..jit import kernel

# Entries of a lens: focal length (px), centre (px, from the middle of the image), k, k2, k3.
FOCAL, CX, CY, K, K2, K3 = range(6)
LENS_SIZE = 6

# Columns of a point's derivatives: rotation, translation, lens; then the residual.
POSE_COLUMNS = 6
RESIDUAL = POSE_COLUMNS + LENS_SIZE
COLUMNS = RESIDUAL + 1

# Newton's method for s with two or three terms. It starts at 1 / Z near the axis (ρ² / Z² below
# the limit), elsewhere at the observed pixel.
_NEWTON_STEPS = 10
# It ends after a step this small, relative: it converges quadratically.
_CONVERGED = 1e-9
_NEAR_AXIS = 0.01


def lens_from_camera(camera: DivisionCamera, middle_px: tuple[float, float]) -> Array:
    """Return the lens (6,) of a camera, its centre relative to the middle of the image."""
    lens = np.empty(LENS_SIZE)
    lens[FOCAL], lens[K], lens[K2], lens[K3] = camera.focal_px, camera.k, camera.k2, camera.k3
    lens[CX], lens[CY] = np.subtract(camera.center_px, middle_px)
    return lens


def camera_from_lens(lens: Array, middle_px: tuple[float, float]) -> DivisionCamera:
    """Return the camera of a lens (6,)."""
    focal_px, x, y, k, k2, k3 = lens.tolist()
    return DivisionCamera(focal_px, (x + middle_px[0], y + middle_px[1]), k, k2, k3)


@kernel
def squared_error(pose: Array, lens: Array, bx: float, by: float, u: float, v: float) -> float:
    """Return the squared reprojection error of a board point at the pixel (u, v), px²."""
    x = pose[0] * bx + pose[1] * by + pose[TRANSLATION]
    y = pose[3] * bx + pose[4] * by + pose[TRANSLATION + 1]
    z = pose[6] * bx + pose[7] * by + pose[TRANSLATION + 2]
    s = _scale(x, y, z, lens, u, v)
    dx = lens[CX] + lens[FOCAL] * s * x - u
    dy = lens[CY] + lens[FOCAL] * s * y - v
    error: float = dx * dx + dy * dy
    return error if error < math.inf else math.inf


@kernel
def offset_px(
    x: float, y: float, z: float, lens: Array, u: float, v: float
) -> tuple[float, float]:
    """Return the pixel, from the centre, of a point of the camera's frame observed near (u, v)."""
    s = _scale(x, y, z, lens, u, v)
    return lens[FOCAL] * s * x, lens[FOCAL] * s * y


@kernel
def linearise(
    pose: Array, lens: Array, bx: float, by: float, u: float, v: float, jacobian: Array
) -> None:
    """Write the (2, 13) derivatives and residual of a point, px; NaN if it is not visible."""
    qx, qy, qz = (
        pose[0] * bx + pose[1] * by,
        pose[3] * bx + pose[4] * by,
        pose[6] * bx + pose[7] * by,
    )
    linearise_rotated(qx, qy, qz, pose, lens, u, v, jacobian)


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
) -> None:
    """Linearise as `linearise` does a point of the board that has been rotated: Q = R X."""
    x, y, z = qx + pose[TRANSLATION], qy + pose[TRANSLATION + 1], qz + pose[TRANSLATION + 2]
    f = lens[FOCAL]
    s = _scale(x, y, z, lens, u, v)
    rho2 = x * x + y * y
    q = s * s * rho2
    slope = _slope(lens, q)
    inverse = 1.0 / (z - 2.0 * s * rho2 * slope)
    s_rho2, s_z = slope * s * s * inverse, -s * inverse
    s_x, s_y = 2.0 * x * s_rho2, 2.0 * y * s_rho2
    fill_pose_columns(jacobian, 0, f * (s + x * s_x), f * x * s_y, f * x * s_z, qx, qy, qz)
    fill_pose_columns(jacobian, 1, f * y * s_x, f * (s + y * s_y), f * y * s_z, qx, qy, qz)
    for j in range(2):
        across = x if j == 0 else y
        by_k = f * across * q * inverse
        jacobian[j, 6 + FOCAL] = s * across
        jacobian[j, 6 + CX] = 1.0 - j
        jacobian[j, 6 + CY] = j
        jacobian[j, 6 + K] = by_k
        jacobian[j, 6 + K2] = by_k * q
        jacobian[j, 6 + K3] = by_k * q * q
    jacobian[0, RESIDUAL] = lens[CX] + f * s * x - u
    jacobian[1, RESIDUAL] = lens[CY] + f * s * y - v


@kernel
def _slope(lens: Array, q: float) -> float:
    """Return w'(q)."""
    slope: float = lens[K] + q * (2.0 * lens[K2] + q * 3.0 * lens[K3])
    return slope


@kernel
def _scale(x: float, y: float, z: float, lens: Array, u: float, v: float) -> float:
    """Return s of a point observed near (u, v); NaN if no pixel near (u, v) sees it."""
    rho2 = x * x + y * y
    if lens[K2] == 0.0 and lens[K3] == 0.0:
        return closed_form(z, lens[K], rho2)
    dx, dy = (u - lens[CX]) / lens[FOCAL], (v - lens[CY]) / lens[FOCAL]
    near_axis = z > 0.0 and rho2 < _NEAR_AXIS * z * z
    s = 1.0 / z if near_axis else math.sqrt((dx * dx + dy * dy) / rho2)
    for _ in range(_NEWTON_STEPS):
        q = s * s * rho2
        w = 1.0 + q * (lens[K] + q * (lens[K2] + q * lens[K3]))
        unfolded = z - 2.0 * s * rho2 * _slope(lens, q)
        step = (w - s * z) / unfolded
        s += step
        if abs(step) <= _CONVERGED * s:
            return s if unfolded > 0.0 else math.nan
    return math.nan


@kernel
def closed_form(z: float, k: float, rho2: float) -> float:
    """Return s of a lens with one term: the root of  k ρ² s² - Z s + 1  that is 1 / Z at k = 0."""
    square = z * z - 4.0 * k * rho2
    if not square >= 0.0:
        return math.nan
    root = math.sqrt(square)
    # Behind the image plane Z + root cancels; the other form of the same root does not.
    s = 2.0 / (z + root) if z > 0.0 else (z - root) / (2.0 * k * rho2)
    return s if 0.0 < s < math.inf else math.nan
