# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""
One view with an unknown camera: minimal solver, reprojection error, Jacobian, and priors.

The pixel (x, y) from the centre sees the ray (x, y, g + h r²). A point P = (X, Y, Z) of the
camera's frame therefore projects to σ (X, Y), with ρ² = X² + Y² and

    h ρ² σ² - Z σ + g = 0,     σ = 2 g / (Z + w),     w = √(Z² - 4 g h ρ²).

The differential of that equation gives every derivative, finite at h = 0 and behind the image
plane too:  w dσ = h σ² d(ρ²) - σ dZ + dg + ρ² σ² dh.
"""

from __future__ import annotations

import math
from typing import NamedTuple

from ..geometry import Array, TRANSLATION
from ..jit import inlined, kernel, vectorised_kernel
from ..minimal.four import Points
from ..minimal.one import solve_minimal, UNFOLDED, Workspace
from ..minimal.solution import G, H, load_row, Row, ROW_SIZE
from ..model.normal_equations import add_point, fill_pose_columns

_SMALLEST_W = 1e-100


class Gates(NamedTuple):
    """Limits of a plausible camera; corner_px: distance of the image's corner from the centre."""

    corner_px: float
    min_half_fov_rad: float
    max_half_fov_rad: float
    max_distortion: float


@kernel
def hypotheses(image: Points, board: Points, gates: Gates, rows: Array, work: Workspace) -> int:
    """Solve the sample; write the plausible solutions to rows; return their number."""
    return keep_plausible(gates, rows, solve_minimal(image, board, UNFOLDED, rows, work))


@kernel
def keep_plausible(gates: Gates, rows: Array, count: int) -> int:
    """Keep the first rows that are plausible, in their order; return their number."""
    kept = 0
    for s in range(count):
        if plausible(rows[s], gates):
            for j in range(ROW_SIZE):
                rows[kept, j] = rows[s, j]
            kept += 1
    return kept


@kernel
def plausible(row: Array, gates: Gates) -> bool:
    """Return whether field of view and distortion of a solution's camera are within the limits."""
    # The corner's ray is (r, g + h r²).
    bend = row[H] * gates.corner_px * gates.corner_px
    half_fov_rad = math.atan2(gates.corner_px, row[G] + bend)
    return (
        gates.min_half_fov_rad <= half_fov_rad <= gates.max_half_fov_rad
        and abs(bend) <= gates.max_distortion * row[G]
    )


@inlined
def squared_error(row: Row, bx: float, by: float, x_px: float, y_px: float) -> float:
    """Return the squared reprojection error of a board point; infinite if it is not visible."""
    x = row[0] * bx + row[1] * by + row[9]
    y = row[3] * bx + row[4] * by + row[10]
    z = row[6] * bx + row[7] * by + row[11]
    sigma = _scale(x, y, z, row[G], row[H])
    dx, dy = sigma * x - x_px, sigma * y - y_px
    error: float = dx * dx + dy * dy
    return error if error < math.inf else math.inf


@vectorised_kernel
def squared_errors(
    row: Array, board: Array, image: Array, start: int, stop: int, squares: Array
) -> None:
    """Write the squared errors of the points from start to stop."""
    # The row as numbers: if the errors might overwrite it, the loop would not vectorise.
    r = load_row(row)
    for i in range(start, stop):
        squares[i] = squared_error(r, board[i, 0], board[i, 1], image[i, 0], image[i, 1])


@kernel
def linearise(row: Array, board: Array, image: Array, i: int, jacobian: Array) -> None:
    """Write the (2, 9) derivatives and residual of point i; NaN if it is not visible."""
    bx, by = board[i, 0], board[i, 1]
    qx, qy, qz = row[0] * bx + row[1] * by, row[3] * bx + row[4] * by, row[6] * bx + row[7] * by
    x, y, z = qx + row[TRANSLATION], qy + row[TRANSLATION + 1], qz + row[TRANSLATION + 2]
    g, h = row[G], row[H]
    sigma = _scale(x, y, z, g, h)
    if not sigma > 0.0:
        jacobian[0, 8] = jacobian[1, 8] = math.nan
        return
    rho2 = x * x + y * y
    # At the fold, w = 0, the derivatives would be infinite; huge ones serve as well.
    inverse = 1.0 / max(math.sqrt(max(z * z - 4.0 * g * h * rho2, 0.0)), _SMALLEST_W)
    # dσ = s_x dX + s_y dY + s_z dZ + s_g dg + s_h dh
    bend = 2.0 * h * sigma * sigma * inverse
    s_x, s_y = bend * x, bend * y
    s_z, s_g, s_h = -sigma * inverse, inverse, rho2 * sigma * sigma * inverse
    # d(σ X) = (σ + X s_x) dX + X s_y dY + X s_z dZ + X s_g dg + X s_h dh; likewise d(σ Y).
    fill_pose_columns(jacobian, 0, sigma + x * s_x, x * s_y, x * s_z, qx, qy, qz)
    fill_pose_columns(jacobian, 1, y * s_x, sigma + y * s_y, y * s_z, qx, qy, qz)
    jacobian[0, 6], jacobian[0, 7], jacobian[0, 8] = x * s_g, x * s_h, sigma * x - image[i, 0]
    jacobian[1, 6], jacobian[1, 7], jacobian[1, 8] = y * s_g, y * s_h, sigma * y - image[i, 1]


@kernel
def add_points(
    row: Array, board: Array, image: Array, limit: float, jacobian: Array, normal: Array
) -> int:
    """Add the points within the limit to the normal equations; return their number."""
    count = 0
    for i in range(len(image)):
        linearise(row, board, image, i, jacobian)
        count += add_point(jacobian, limit, 8, normal)
    return count


@inlined
def _scale(x: float, y: float, z: float, g: float, h: float) -> float:
    """Return σ of a point of the camera's frame; NaN if no pixel sees it."""
    gh4 = 4.0 * g * h
    rho2 = x * x + y * y
    square = z * z - gh4 * rho2
    w = math.sqrt(max(square, 0.0))
    # Behind the image plane Z + w cancels; the other form of the same root does not.
    numerator = 2.0 * g if z > 0.0 else 2.0 * g * (z - w)
    sigma = numerator / (z + w if z > 0.0 else gh4 * rho2)
    return sigma if square >= 0.0 and sigma > 0.0 else math.nan


class Prior(NamedTuple):
    """
    Gaussian priors on the focal length (px) and k; weight 0: no prior.

    A weight is the variance of the image noise over that of the prior, so that the squared
    residuals of the prior are in px² like those of the points.
    """

    focal_px: float
    focal_weight: float
    k: float
    k_weight: float


NO_PRIOR = Prior(0.0, 0.0, 0.0, 0.0)


@kernel
def prior_cost(row: Array, prior: Prior) -> float:
    """Return the squared residuals of the prior, px²."""
    by_focal = row[G] - prior.focal_px
    by_k = row[G] * row[H] - prior.k
    cost: float = prior.focal_weight * by_focal * by_focal + prior.k_weight * by_k * by_k
    return cost


@kernel
def add_prior(row: Array, prior: Prior, normal: Array) -> None:
    """Add the prior to the upper triangle of JᵀJ and, in column 8, to Jᵀr."""
    # k = g h:  dk = h dg + g dh.
    g, h = row[G], row[H]
    by_focal, by_k = g - prior.focal_px, g * h - prior.k
    normal[6, 6] += prior.focal_weight + prior.k_weight * h * h
    normal[6, 7] += prior.k_weight * h * g
    normal[7, 7] += prior.k_weight * g * g
    normal[6, 8] += prior.focal_weight * by_focal + prior.k_weight * h * by_k
    normal[7, 8] += prior.k_weight * g * by_k
