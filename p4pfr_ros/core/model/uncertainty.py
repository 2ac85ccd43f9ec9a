# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""The noise of the points, and the order of a covariance's entries."""

from __future__ import annotations

import math

from ..geometry import Array
from ..jit import jit, kernel

# Order of a covariance (8, 8): position, rotation about fixed axes (radians), focal length, k.
COVARIANCE_SIZE = 8
POSITION, ROTATION = slice(0, 3), slice(3, 6)
COV_FOCAL, COV_K = 6, 7


# Standard deviation of a corner, px, if the residuals are too few to measure it.
DEFAULT_SIGMA_PX = 0.5

# Lower limit of the measured standard deviation, px: residuals of rounding's size must not stand
# in for missing information.
_SMALLEST_SIGMA_PX = 0.01

_ROUNDS = 20


def sigma_at(covariance: Array, index: int) -> float:
    """Return the standard deviation of an entry; rounding below zero counts as zero."""
    variance = float(covariance[index, index])
    return math.sqrt(max(0.0, variance)) if not math.isnan(variance) else math.nan


@jit
def noise_variance(squares: float, spare: int, limit: float) -> float:
    """
    Return the variance of a coordinate, px², from the inliers' squared errors.

    spare is the number of coordinates beyond the unknowns. Errors beyond the limit (px²) are not
    among the inliers' squares, so their mean is too small; this is corrected.
    """
    measured = squares / max(spare, 1)
    # Of a normal error the square of the distance, r² = 2 u σ², has the density exp(-u). Its
    # mean below the limit is  2 σ² (1 - u / (eᵘ - 1)),  u = limit / (2 σ²).
    variance = measured
    for _ in range(_ROUNDS):
        if not variance > 0.0:
            break
        u = min(0.5 * limit / variance, 700.0)
        # Nearly all of a flat distribution lies beyond the limit: it has no measurable variance.
        variance = min(measured / (1.0 - u / math.expm1(u)), limit)
    return max(variance, _SMALLEST_SIGMA_PX * _SMALLEST_SIGMA_PX)


@jit
def posterior_variance(variance: float, spare: int, limit: float) -> float:
    """
    Widen the noise's variance to that of the estimate's errors, in units of (JᵀJ)⁻¹.

    spare 0: the noise was given. Otherwise it is measured: errors in units of a noise measured
    with ν spare coordinates follow Student's t with ν degrees of freedom, whose variance is
    ν / (ν - 2). For ν ≤ 2 it has none, and the noise is at least the default.
    """
    if spare > 2:
        variance *= spare / (spare - 2.0)
    elif spare > 0:
        variance = max(variance, DEFAULT_SIGMA_PX * DEFAULT_SIGMA_PX)
    # A point beyond the limit (px²) has no influence. JᵀJ contains the share 1 - exp(-u) of the
    # points; by the influence function the estimate has the information of the share
    # 1 - (1 + u) exp(-u),  u = limit / (2 σ²).
    u = min(0.5 * limit / variance, 700.0)
    beyond = math.exp(-u)
    return variance * (1.0 - beyond) / (1.0 - (1.0 + u) * beyond)


@jit
def largest_excess(variance: float, spare: int, ratio: float) -> float:
    """
    Return by how much the cost of another optimum may exceed the best one's, px².

    ratio is twice the logarithm of the likelihood ratio; spare 0: the variance is given. If it is
    measured with ν spare coordinates, the likelihood is Student's, ∝ cost^(-ν/2).
    """
    if spare <= 0:
        return ratio * variance
    return spare * variance * math.expm1(min(ratio / spare, 3.0))


@kernel
def pose_to_public(v: Array, row: Array, board: tuple[float, float, float]) -> None:
    """
    Convert (ω, t of the scaled board) to (t of the board's origin, ω), in place.

    board: the mean (x, y) subtracted from the board's points, and the size that divided them.
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
