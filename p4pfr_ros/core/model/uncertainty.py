# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""How sure one view is: the noise of its points, and the covariance of its estimate."""

from __future__ import annotations

import math

from ..geometry import Array
from ..jit import jit, kernel
from ..linalg import solve_in_place
from ..minimal.solution import G, H
from ..one_view.problem import POSE_AND_CAMERA

# The noise of a corner where the points leave too little to measure it by, px.
DEFAULT_SIGMA_PX = 0.5

# On the diagonal of the scaled JᵀJ: what it holds no information on gets a variance so huge,
# not a made-up one, and nothing else is changed by it.
_NO_INFORMATION = 1e-13

# No corner is known better than this, px, however well a picture's points agree: residuals of
# rounding's size must not make up for information that is not there.
_SMALLEST_SIGMA_PX = 0.01

_ROUNDS = 20


@jit
def noise_variance(squares: float, spare: int, limit: float) -> float:
    """
    Return the variance of a coordinate, px², from the inliers' squared errors.

    spare is the number of coordinates beyond the unknowns. Errors beyond the limit (px²) are not
    among the inliers' squares, so their mean is too small; that is made good.
    """
    measured = squares / max(spare, 1)
    # Of a normal error the square of the distance, r² = 2 u σ², has the density exp(-u). Its
    # mean below the limit is  2 σ² (1 - u / (eᵘ - 1)),  u = limit / (2 σ²).
    variance = measured
    for _ in range(_ROUNDS):
        if not variance > 0.0:
            break
        u = min(0.5 * limit / variance, 700.0)
        # Nearly all of a flat distribution lies beyond the limit: it has no variance to tell.
        variance = min(measured / (1.0 - u / math.expm1(u)), limit)
    return max(variance, _SMALLEST_SIGMA_PX * _SMALLEST_SIGMA_PX)


@jit
def posterior_variance(variance: float, spare: int, limit: float) -> float:
    """
    Widen the noise's variance to what the estimate's errors follow, in units of (JᵀJ)⁻¹.

    spare 0: the noise was given. Otherwise it is not known exactly: errors in units of a noise
    measured with ν coordinates to spare follow Student's t with ν degrees of freedom, whose
    variance is ν / (ν - 2). With two or fewer it has none, and the noise is taken to be no
    smaller than the default.
    """
    if spare > 2:
        variance *= spare / (spare - 2.0)
    elif spare > 0:
        variance = max(variance, DEFAULT_SIGMA_PX * DEFAULT_SIGMA_PX)
    # A point beyond the limit (px²) pulls no longer, and one about to pass it no more for being
    # farther off. Of the n points JᵀJ holds the share 1 - exp(-u); by the influence function the
    # estimate has the information of the share 1 - (1 + u) exp(-u),  u = limit / (2 σ²).
    u = min(0.5 * limit / variance, 700.0)
    beyond = math.exp(-u)
    return variance * (1.0 - beyond) / (1.0 - (1.0 + u) * beyond)


@jit
def largest_excess(variance: float, spare: int, ratio: float) -> float:
    """
    Return how much more than the best (px²) another optimum may cost.

    ratio is twice the logarithm of the likelihood ratio; spare 0: the variance is known. Where
    it is measured by ν coordinates to spare, the likelihood is Student's, ∝ cost^(-ν/2).
    """
    if spare <= 0:
        return ratio * variance
    return spare * variance * math.expm1(min(ratio / spare, 3.0))


@jit
def covariance_from(
    normal: Array,
    unknowns: int,
    variance: float,
    row: Array,
    board: tuple[float, float, float],
    system: Array,
    covariance: Array,
) -> None:
    """
    Write the (8, 8) covariance of x, y, z, rotation x, y, z, focal_px, k.

    normal is JᵀJ by rotation, translation of the scaled board, g, h; where the camera is known
    (six unknowns) the rows and columns of focal_px and k are zero. board: the mean that was
    taken off the board's points (board units) and the size they were divided by.
    """
    _invert(normal, unknowns, system, covariance)
    for j in range(POSE_AND_CAMERA):
        _to_public(covariance[:, j], row, board)
    for j in range(POSE_AND_CAMERA):
        _to_public(covariance[j, :], row, board)
    for a in range(POSE_AND_CAMERA):
        for b in range(a + 1):
            mean = 0.5 * variance * (covariance[a, b] + covariance[b, a])
            covariance[a, b] = covariance[b, a] = mean


@jit
def _invert(normal: Array, unknowns: int, system: Array, inverse: Array) -> None:
    """Write the inverse of JᵀJ, zero beyond the unknowns; system (8, 9) is room to work in."""
    inverse[:, :] = 0.0
    for j in range(unknowns):
        for a in range(unknowns):
            for b in range(unknowns):
                scale = math.sqrt(normal[a, a] * normal[b, b])
                system[a, b] = normal[a, b] / scale if scale > 0.0 else 0.0
            system[a, a] += _NO_INFORMATION
            system[a, unknowns] = 1.0 if a == j else 0.0
        solve_in_place(system, unknowns)
        for a in range(unknowns):
            scale = math.sqrt(normal[a, a] * normal[j, j])
            inverse[a, j] = system[a, unknowns] / scale


@kernel
def _to_public(v: Array, row: Array, board: tuple[float, float, float]) -> None:
    """Take (ω, t of the scaled board, g, h) to (t of the board's origin, ω, f, k), in place."""
    pose_to_public(v, row, board)
    # k = g h.
    v[7] = row[H] * v[6] + row[G] * v[7]


@kernel
def pose_to_public(v: Array, row: Array, board: tuple[float, float, float]) -> None:
    """
    Take (ω, t of the scaled board) to (t of the board's origin, ω), in place.

    board: the mean that was taken off the board's points, and the size they were divided by.
    """
    # t = s t_c - R m,   dt = s dt_c - ω x R m = s dt_c + R m x ω.
    mean_x, mean_y, size = board
    mx = row[0] * mean_x + row[1] * mean_y
    my = row[3] * mean_x + row[4] * mean_y
    mz = row[6] * mean_x + row[7] * mean_y
    wx, wy, wz = v[0], v[1], v[2]
    v[0] = size * v[3] + my * wz - mz * wy
    v[1] = size * v[4] + mz * wx - mx * wz
    v[2] = size * v[5] + mx * wy - my * wx
    v[3], v[4], v[5] = wx, wy, wz
