# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""The normal equations JᵀJ and Jᵀr of one view, accumulated point by point."""

from __future__ import annotations

from ..geometry import Array
from ..jit import kernel

# Columns of a point's Jacobian: rotation, translation, g and h; then the residual.
COLUMNS = 9


@kernel
def fill_pose_columns(
    jacobian: Array, j: int, ax: float, ay: float, az: float, qx: float, qy: float, qz: float
) -> None:
    """Write a · dP to row j, for dP = ω x Q + dt, Q = R X:  a · (ω x Q) = (Q x a) · ω."""
    jacobian[j, 0] = qy * az - qz * ay
    jacobian[j, 1] = qz * ax - qx * az
    jacobian[j, 2] = qx * ay - qy * ax
    jacobian[j, 3] = ax
    jacobian[j, 4] = ay
    jacobian[j, 5] = az


@kernel
def add_point(jacobian: Array, limit: float, unknowns: int, normal: Array) -> int:
    """Add a point's (2, 9) rows to the upper triangle if within the limit; return 1 or 0."""
    # Written so that NaN is not within.
    if not jacobian[0, 8] * jacobian[0, 8] + jacobian[1, 8] * jacobian[1, 8] < limit:
        return 0
    for a in range(unknowns):
        first, second = jacobian[0, a], jacobian[1, a]
        for b in range(a, COLUMNS):
            normal[a, b] += first * jacobian[0, b] + second * jacobian[1, b]
    return 1
