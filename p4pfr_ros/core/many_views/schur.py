# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""
Poses out of the normal equations, view by view (Schur complements).

A view's block is  [C B; Bᵀ A]  by pose and lens, with the gradients c and a. Solving its first
row for the pose and putting that into the second leaves  A - Bᵀ C⁻¹ B:  what the view tells of
the lens when nothing is known of its pose.
"""

from __future__ import annotations

import math

from ..geometry import Array
from ..jit import kernel
from ..model.lens import COLUMNS, LENS_SIZE, POSE_COLUMNS, RESIDUAL

# What holds no information is not given any: its unknown stays where it is.
_NO_INFORMATION = 1e-13


@kernel
def reduce_view(block: Array, damping: float, solved: Array, reduced: Array) -> bool:
    """
    Add what a view tells of the lens to reduced (6, 7): information, and the negative gradient.

    solved (6, 13) gets  C⁻¹ [B c]  in the columns of the lens and the residual, C damped by a
    share of its diagonal. False: C is singular.
    """
    n = POSE_COLUMNS
    if not _factor(block, damping, solved):
        return False
    for column in range(n, COLUMNS):
        for i in range(n):
            total = block[i, column]
            for j in range(i):
                total -= solved[i, j] * solved[j, column]
            solved[i, column] = total / solved[i, i]
    # So far L⁻¹ [B c]; the products are BᵀC⁻¹B and BᵀC⁻¹c.
    for a in range(LENS_SIZE):
        for b in range(LENS_SIZE + 1):
            total = block[n + a, n + b]
            for i in range(n):
                total -= solved[i, n + a] * solved[i, n + b]
            reduced[a, b] += total if b < LENS_SIZE else -total
    for column in range(n, COLUMNS):
        for i in range(n - 1, -1, -1):
            total = solved[i, column]
            for j in range(i + 1, n):
                total -= solved[j, i] * solved[j, column]
            solved[i, column] = total / solved[i, i]
    return True


@kernel
def _factor(block: Array, damping: float, factor: Array) -> bool:
    """Write the Cholesky factor L of the damped C to the left of factor."""
    for i in range(POSE_COLUMNS):
        for j in range(i + 1):
            total = block[i, j]
            if i == j:
                total *= 1.0 + damping + _NO_INFORMATION
            for m in range(j):
                total -= factor[i, m] * factor[j, m]
            if i == j:
                if not total > 0.0:
                    return False
                factor[i, i] = math.sqrt(total)
            else:
                factor[i, j] = total / factor[j, j]
    return True


@kernel
def pose_step(solved: Array, lens_step: Array, step: Array) -> None:
    """Write the pose's step (6,) that goes with a step of the lens (6,):  -C⁻¹ (c + B δ)."""
    for i in range(POSE_COLUMNS):
        total = solved[i, RESIDUAL]
        for a in range(LENS_SIZE):
            total += solved[i, POSE_COLUMNS + a] * lens_step[a]
        step[i] = -total
