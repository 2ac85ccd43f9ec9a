# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""The noise variance, and the order and units of a public covariance."""

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

# Lower limit of the measured standard deviation, px: with residuals of rounding's size, quantities
# that the view does not determine would seem certain.
_SMALLEST_SIGMA_PX = 0.01

_ROUNDS = 20


def sigma_at(covariance: Array, index: int) -> float:
    """Return the standard deviation of an entry; rounding below zero counts as zero."""
    variance = float(covariance[index, index])
    return math.sqrt(max(0.0, variance)) if not math.isnan(variance) else math.nan


@jit
def noise_variance(squares: float, dof: int, limit: float) -> float:
    """
    Return the variance of a coordinate, px², from the inliers' squared errors.

    dof: the degrees of freedom, coordinates minus unknowns. Errors beyond the limit (px²) are not
    among the inliers' squares, so their mean is too small; this is corrected.
    """
    measured = squares / max(dof, 1)
    # The squared length of a normal error, r² = 2 u σ², has the density exp(-u). Its mean below
    # the limit is  2 σ² (1 - u / (eᵘ - 1)),  u = limit / (2 σ²).
    variance = measured
    for _ in range(_ROUNDS):
        if not variance > 0.0:
            break
        u = min(0.5 * limit / variance, 700.0)
        # A nearly flat distribution lies beyond the limit: its variance is not measurable.
        variance = min(measured / (1.0 - u / math.expm1(u)), limit)
    return max(variance, _SMALLEST_SIGMA_PX * _SMALLEST_SIGMA_PX)


@jit
def posterior_variance(variance: float, dof: int, limit: float) -> float:
    """
    Return the variance that turns (JᵀJ)⁻¹ into the covariance of the estimate, px².

    dof 0: the noise was given. Otherwise it was measured: errors in units of a noise measured with
    ν degrees of freedom follow Student's t, whose variance is ν / (ν - 2). For ν ≤ 2 it has none,
    and the noise is at least the default.
    """
    if dof > 2:
        variance *= dof / (dof - 2.0)
    elif dof > 0:
        variance = max(variance, DEFAULT_SIGMA_PX * DEFAULT_SIGMA_PX)
    # A point beyond the limit (px²) has no influence. JᵀJ contains the share 1 - exp(-u) of the
    # points, u = limit / (2 σ²); by the influence function the estimate has only the information
    # of the share 1 - (1 + u) exp(-u).
    u = min(0.5 * limit / variance, 700.0)
    beyond = math.exp(-u)
    return variance * (1.0 - beyond) / (1.0 - (1.0 + u) * beyond)


@jit
def largest_excess(variance: float, dof: int, ratio: float) -> float:
    """
    Return by how much the cost of another optimum may exceed the best one's, px².

    ratio is twice the logarithm of the likelihood ratio; dof 0: the variance is given. If it was
    measured with ν degrees of freedom, the likelihood is Student's, ∝ cost^(-ν/2).
    """
    if dof <= 0:
        return ratio * variance
    return dof * variance * math.expm1(min(ratio / dof, 3.0))


@kernel
def pose_to_public(v: Array, row: Array, board_scale: tuple[float, float, float]) -> None:
    """
    Convert (dω, dt of the scaled board) to (dt of the board's origin, dω), in place.

    board_scale: see ``Observation``.
    """
    # t = s t_c - R m,   dt = s dt_c - dω x R m = s dt_c + R m x dω.
    mean_x, mean_y, size = board_scale
    mx = row[0] * mean_x + row[1] * mean_y
    my = row[3] * mean_x + row[4] * mean_y
    mz = row[6] * mean_x + row[7] * mean_y
    wx, wy, wz = v[0], v[1], v[2]
    v[0] = size * v[3] + my * wz - mz * wy
    v[1] = size * v[4] + mz * wx - mx * wz
    v[2] = size * v[5] + mx * wy - my * wx
    v[3], v[4], v[5] = wx, wy, wz
