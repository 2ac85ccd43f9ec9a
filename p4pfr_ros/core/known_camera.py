# SPDX-License-Identifier: Apache-2.0
"""
A view by a known camera: pose alone, by the camera's rays, whatever its lens.

With the rays ρᵢ of four points, Σ mᵢ λᵢ ρᵢ = 0 (see ``cone``) is three equations in four depths:
by Cramer's rule mᵢ λᵢ = ± det(the other three rays), and the pose follows in closed form.

Errors are in pixels all the same: close to its ray, a point P of the camera's frame misses its
pixel by  e = W P / (ρ · P),  ρ the unit ray and W (2, 3) the pixels per unit of displacement
across it (W ρ = 0). That is exact at e = 0 and of first order about it, for any camera.
"""

from __future__ import annotations

import math

import numpy as np

from .camera import DivisionCamera
from .cone import board_weights
from .free_camera import fill_pose_columns
from .geometry import Array, Ints
from .jit import jit
from .minimal import Workspace
from .normalise import board_duals, unscale
from .recover import orthogonal_factor
from .solution import G, H, TRANSLATION

_DIFFERENCE_PX = 1e-3


def rays_and_across(camera: DivisionCamera, image: Array) -> tuple[Array, Array]:
    """Return the unit rays (N, 3) of raw pixels (N, 2), and W (N, 2, 3)."""
    # J (3, 2) is the change of the unit ray with the pixel; a ray is a polynomial of its pixel,
    # so central differences lose nothing that matters. W = J⁺ = (JᵀJ)⁻¹ Jᵀ: W J = I, W ρ = 0.
    columns = [
        (_unit(camera.unproject(image + step)) - _unit(camera.unproject(image - step)))
        / (2.0 * _DIFFERENCE_PX)
        for step in np.eye(2) * _DIFFERENCE_PX
    ]
    across = np.ascontiguousarray(np.linalg.pinv(np.stack(columns, axis=-1)))
    return _unit(camera.unproject(image)), across


def _unit(rays: Array) -> Array:
    unit: Array = rays / np.linalg.norm(rays, axis=-1, keepdims=True)
    return unit


@jit
def hypothesis(rays: Array, chosen: Ints, row: Array, room: Workspace) -> int:
    """Write the pose of the room's sample, where there is one; return 1 or 0."""
    a, b, c, d = rays[chosen[0]], rays[chosen[1]], rays[chosen[2]], rays[chosen[3]]
    m = room.weights
    # With three points of the board on a line the fourth's depth is open to Cramer's rule.
    if not board_weights(room.sample_board, m) or m[0] * m[1] * m[2] * m[3] == 0.0:
        return 0
    depths = (
        _determinant(b, c, d) / m[0],
        -_determinant(a, c, d) / m[1],
        _determinant(a, b, d) / m[2],
        -_determinant(a, b, c) / m[3],
    )
    if min(depths) * max(depths) <= 0.0:
        return 0
    size = board_duals(room.sample_board, room.board, room.duals)
    if not _pose_from_depths(depths, (a, b, c, d), room.duals, row):
        return 0
    row[G], row[H] = 1.0, 0.0
    unscale(row, room.sample_board, 1.0, size)
    return 1


@jit
def _pose_from_depths(
    depths: tuple[float, float, float, float],
    rays: tuple[Array, Array, Array, Array],
    duals: Array,
    row: Array,
) -> bool:
    """Write rotation and centroid of the corners Qᵢ = λᵢ ρᵢ: the board's, but for one scale."""
    sign = 1.0 if depths[0] > 0.0 else -1.0
    h1 = h2 = h3 = 0.0j
    mx = my = mz = 0.0
    for i in range(4):
        depth = sign * depths[i]
        c = complex(duals[i, 0], duals[i, 1])
        x, y, z = depth * rays[i][0], depth * rays[i][1], depth * rays[i][2]
        h1 += x * c
        h2 += y * c
        h3 += z * c
        mx += 0.25 * x
        my += 0.25 * y
        mz += 0.25 * z
    scale = orthogonal_factor(h1, h2, h3, row)
    if not scale > 0.0:
        return False
    row[TRANSLATION] = mx / scale
    row[TRANSLATION + 1] = my / scale
    row[TRANSLATION + 2] = mz / scale
    return True


@jit
def _determinant(a: Array, b: Array, c: Array) -> float:
    value: float = (
        a[0] * (b[1] * c[2] - b[2] * c[1])
        - a[1] * (b[0] * c[2] - b[2] * c[0])
        + a[2] * (b[0] * c[1] - b[1] * c[0])
    )
    return value


@jit
def squared_error(row: Array, board: Array, ray: Array, across: Array) -> float:
    """Return the squared reprojection error of a point, px²; infinite behind the camera."""
    bx, by = board[0], board[1]
    x = row[0] * bx + row[1] * by + row[TRANSLATION]
    y = row[3] * bx + row[4] * by + row[TRANSLATION + 1]
    z = row[6] * bx + row[7] * by + row[TRANSLATION + 2]
    along = ray[0] * x + ray[1] * y + ray[2] * z
    if not along > 0.0:
        return math.inf
    ex = (across[0, 0] * x + across[0, 1] * y + across[0, 2] * z) / along
    ey = (across[1, 0] * x + across[1, 1] * y + across[1, 2] * z) / along
    error: float = ex * ex + ey * ey
    return error


@jit
def linearise(row: Array, board: Array, ray: Array, across: Array, jacobian: Array) -> None:
    """Write the (2, 9) derivatives and residual of a point; NaN behind the camera."""
    bx, by = board[0], board[1]
    qx, qy, qz = row[0] * bx + row[1] * by, row[3] * bx + row[4] * by, row[6] * bx + row[7] * by
    x, y, z = qx + row[TRANSLATION], qy + row[TRANSLATION + 1], qz + row[TRANSLATION + 2]
    along = ray[0] * x + ray[1] * y + ray[2] * z
    if not along > 0.0:
        along = math.nan
    for j in range(2):
        w = across[j]
        error = (w[0] * x + w[1] * y + w[2] * z) / along
        # de = (W - e ρᵀ) dP / (ρ · P)
        ax = (w[0] - error * ray[0]) / along
        ay = (w[1] - error * ray[1]) / along
        az = (w[2] - error * ray[2]) / along
        fill_pose_columns(jacobian[j], ax, ay, az, qx, qy, qz)
        jacobian[j, 6] = jacobian[j, 7] = 0.0
        jacobian[j, 8] = error
