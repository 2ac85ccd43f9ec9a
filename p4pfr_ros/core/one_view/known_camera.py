# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""
One view with a known camera: the pose alone, from the rays of the pixels, for any lens.

With the rays ρᵢ of four points, Σ mᵢ λᵢ ρᵢ = 0 (see ``minimal.cone``) is three equations in four
depths: by Cramer's rule mᵢ λᵢ = ± det(the other three rays), and the pose follows in closed form.

Errors are in pixels nevertheless: a point P of the camera's frame, close to the unit ray ρ of its
pixel, has the reprojection error  e = W P / (ρ · P),  W (2, 3) the pixels per unit of displacement
across the ray (W ρ = 0). This is a first-order approximation, exact at e = 0, for any camera.
"""

from __future__ import annotations

import math

import numpy as np

from ..geometry import Array, Ints, TRANSLATION
from ..jit import kernel
from ..minimal.cone import board_weights
from ..minimal.four import dot, Four, Points, sum_of
from ..minimal.pose import orthogonal_factor, scale_board, unscale
from ..minimal.solution import G, H, ROW_SIZE, store_row
from ..model.lens import ASPECT, depth_and_slope, FOCAL, inverse_decentring, with_decentring
from ..model.normal_equations import add_point, fill_pose_columns

# Rays within this angle, radians, coincide.
_ONE_RAY = 1e-12


@kernel
def rays_and_across(image: Array, lens: Array, rays: Array, across: Array) -> None:
    """Write the unit rays (N, 3) of pixels from the centre (N, 2), and W (N, 2, 3)."""
    fx, fy = lens[FOCAL], lens[FOCAL] * (1.0 + lens[ASPECT])
    for i in range(len(image)):
        dx, dy = image[i, 0] / fx, image[i, 1] / fy
        x, y = with_decentring(dx, dy, lens)
        r2 = x * x + y * y
        z, slope = depth_and_slope(lens, r2)
        slope *= 2.0
        length = math.sqrt(r2 + z * z)
        rays[i, 0], rays[i, 1], rays[i, 2] = x / length, y / length, z / length
        # The lens sees P at e = (x, y) where  X z = x Z  and  Y z = y Z. At P = (x, y, z):
        #     (z - s x²) dx - s x y dy = z dX - x dZ,   likewise for y,   s = slope.
        # The determinant is z (z - s r²); z cancels, so z = 0 needs no special case.
        scale = length / (z - slope * r2)
        xx, xy, xz = scale * (z - slope * y * y), scale * slope * x * y, -scale * x
        yy, yz = scale * (z - slope * x * x), -scale * y
        # The pixel moves by f (1 + D')⁻¹ de.
        a, b, c, d = inverse_decentring(dx, dy, lens)
        across[i, 0, 0] = fx * (a * xx + b * xy)
        across[i, 0, 1] = fx * (a * xy + b * yy)
        across[i, 0, 2] = fx * (a * xz + b * yz)
        across[i, 1, 0] = fy * (c * xx + d * xy)
        across[i, 1, 1] = fy * (c * xy + d * yy)
        across[i, 1, 2] = fy * (c * xz + d * yz)


@kernel
def hypothesis(rays: Array, board_points: Points, chosen: Ints, row: Array) -> int:
    """Write the pose of the sample to row; return 1, or 0 if it has none."""
    a, b, c, d = rays[chosen[0]], rays[chosen[1]], rays[chosen[2]], rays[chosen[3]]
    has_weights, m = board_weights(board_points)
    # With three collinear board points Cramer's rule does not determine the fourth's depth.
    if not has_weights or m[0] * m[1] * m[2] * m[3] == 0.0:
        return 0
    depths = (
        _determinant(b, c, d) / m[0],
        -_determinant(a, c, d) / m[1],
        _determinant(a, b, d) / m[2],
        -_determinant(a, b, c) / m[3],
    )
    if min(depths) * max(depths) <= 0.0:
        return 0
    board = scale_board(board_points)
    # The points Qᵢ = λᵢ ρᵢ are the board's corners up to scale.
    sign = 1.0 if depths[0] > 0.0 else -1.0
    x = _along(depths, sign, a[0], b[0], c[0], d[0])
    y = _along(depths, sign, a[1], b[1], c[1], d[1])
    z = _along(depths, sign, a[2], b[2], c[2], d[2])
    c_x, c_y = board.duals
    inverse_scale, rotation = orthogonal_factor(
        complex(dot(x, c_x), dot(x, c_y)),
        complex(dot(y, c_x), dot(y, c_y)),
        complex(dot(z, c_x), dot(z, c_y)),
    )
    if not inverse_scale > 0.0:
        return 0
    quarter = 0.25 * inverse_scale
    centroid = (quarter * sum_of(x), quarter * sum_of(y), quarter * sum_of(z))
    store_row(unscale((*rotation, *centroid, 1.0, 0.0), 1.0, board.frame), row)
    return 1


@kernel
def _along(depths: Four, sign: float, a: float, b: float, c: float, d: float) -> Four:
    """Return one coordinate of the four points."""
    return sign * depths[0] * a, sign * depths[1] * b, sign * depths[2] * c, sign * depths[3] * d


@kernel
def _determinant(a: Array, b: Array, c: Array) -> float:
    value: float = (
        a[0] * (b[1] * c[2] - b[2] * c[1])
        - a[1] * (b[0] * c[2] - b[2] * c[0])
        + a[2] * (b[0] * c[1] - b[1] * c[0])
    )
    return value


@kernel
def squared_error(row: Array, board: Array, rays: Array, across: Array, i: int) -> float:
    """Return the squared reprojection error of point i, px²; infinite behind the camera."""
    bx, by = board[i, 0], board[i, 1]
    x = row[0] * bx + row[1] * by + row[TRANSLATION]
    y = row[3] * bx + row[4] * by + row[TRANSLATION + 1]
    z = row[6] * bx + row[7] * by + row[TRANSLATION + 2]
    along = rays[i, 0] * x + rays[i, 1] * y + rays[i, 2] * z
    if not along > 0.0:
        return math.inf
    ex = (across[i, 0, 0] * x + across[i, 0, 1] * y + across[i, 0, 2] * z) / along
    ey = (across[i, 1, 0] * x + across[i, 1, 1] * y + across[i, 1, 2] * z) / along
    error: float = ex * ex + ey * ey
    return error


@kernel
def linearise(
    row: Array, board: Array, rays: Array, across: Array, i: int, jacobian: Array
) -> None:
    """Write the (2, 9) derivatives and residual of point i; NaN behind the camera."""
    bx, by = board[i, 0], board[i, 1]
    qx, qy, qz = row[0] * bx + row[1] * by, row[3] * bx + row[4] * by, row[6] * bx + row[7] * by
    x, y, z = qx + row[TRANSLATION], qy + row[TRANSLATION + 1], qz + row[TRANSLATION + 2]
    along = rays[i, 0] * x + rays[i, 1] * y + rays[i, 2] * z
    inverse = 1.0 / along if along > 0.0 else math.nan
    for j in range(2):
        wx, wy, wz = across[i, j, 0], across[i, j, 1], across[i, j, 2]
        error = (wx * x + wy * y + wz * z) * inverse
        # de = (W - e ρᵀ) dP / (ρ · P)
        ax = (wx - error * rays[i, 0]) * inverse
        ay = (wy - error * rays[i, 1]) * inverse
        az = (wz - error * rays[i, 2]) * inverse
        fill_pose_columns(jacobian, j, ax, ay, az, qx, qy, qz)
        jacobian[j, 6] = jacobian[j, 7] = 0.0
        jacobian[j, 8] = error


@kernel
def add_points(
    row: Array,
    board: Array,
    rays: Array,
    across: Array,
    limit: float,
    jacobian: Array,
    normal: Array,
) -> int:
    """Add the points within the limit to the normal equations; return their number."""
    count = 0
    for i in range(len(board)):
        linearise(row, board, rays, across, i, jacobian)
        count += add_point(jacobian, limit, 6, normal)
    return count


@kernel
def add_stretched_points(
    row: Array,
    board: Array,
    rays: Array,
    across: Array,
    limit: float,
    jacobian: Array,
    normal: Array,
) -> None:
    """Add the points as ``add_points`` does; columns 6 and 7 are the board's stretch and skew."""
    for i in range(len(board)):
        linearise(row, board, rays, across, i, jacobian)
        x, y = board[i, 0], board[i, 1]
        for j in range(2):
            # The derivatives by the translation are those by the point P, whatever moves it.
            by_x, by_y, by_z = jacobian[j, 3], jacobian[j, 4], jacobian[j, 5]
            along_x = by_x * row[0] + by_y * row[3] + by_z * row[6]
            along_y = by_x * row[1] + by_y * row[4] + by_z * row[7]
            jacobian[j, 6], jacobian[j, 7] = along_x * x - along_y * y, along_x * y + along_y * x
        add_point(jacobian, limit, 8, normal)


def weak_perspective_rows(rays: Array, board: Array) -> Array:
    """
    Return the two poses by weak perspective as rows (2, ROW_SIZE), mirror images of each other.

    rays (N, 3), board (N, 2). Empty if the rays coincide or span more than a half space. These
    rows are needed for four noisy, nearly collinear points, which may have no closed-form pose.
    """
    sight = rays.mean(axis=0)
    if not (rays @ sight > 0.0).all():
        return np.empty((0, ROW_SIZE))
    to_sight = _turn_to_axis(sight / np.linalg.norm(sight))
    turned = rays @ to_sight.T
    flat = turned[:, :2] / turned[:, 2:]
    # About the mean ray (x, y) ≈ A X + b, where A is 1/Z times R's upper left block: its
    # singular values are 1/Z and cos(tilt)/Z.
    columns = np.column_stack([board, np.ones(len(board))])
    affine = np.linalg.lstsq(columns, flat, rcond=None)[0]
    u, (largest, smallest), v = np.linalg.svd(affine[:2].T)
    if not largest > _ONE_RAY:
        return np.empty((0, ROW_SIZE))
    cosine = min(smallest / largest, 1.0)
    sine = np.sqrt(1.0 - cosine**2)
    rows = np.empty((2, ROW_SIZE))
    for row, sign in zip(rows, (1.0, -1.0), strict=True):
        first = np.vstack([u @ np.diag([1.0, cosine]), [0.0, sign * sine]]) @ v
        rotation = np.column_stack([first, np.cross(first[:, 0], first[:, 1])])
        row[:TRANSLATION] = (to_sight.T @ rotation).ravel()
        row[TRANSLATION:G] = to_sight.T @ [*affine[2], 1.0] / largest
        row[G], row[H] = 1.0, 0.0
    return rows


def _turn_to_axis(direction: Array) -> Array:
    """Return a rotation (3, 3) of a unit vector to the z axis."""
    helper = np.eye(3)[int(np.argmin(np.abs(direction)))]
    x = np.cross(helper, direction)
    x /= np.linalg.norm(x)
    turn: Array = np.vstack([x, np.cross(direction, x), direction])
    return turn
