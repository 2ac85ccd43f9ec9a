# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""The covariance of a pose by a camera that is itself known by its covariance alone."""

from __future__ import annotations

import numpy as np

from ..geometry import Array
from ..jit import jit
from ..model.lens import FOCAL, K, LENS_SIZE, POSE_COLUMNS
from ..model.uncertainty import pose_to_public


@jit
def fused_covariance(
    block: Array,
    inverse: Array,
    of_lens: Array,
    noise: float,
    row: Array,
    board: tuple[float, float, float],
    covariance: Array,
) -> None:
    """
    Write the (8, 8) covariance of x, y, z, rotation x, y, z, focal_px, k.

    block (13, 13): a view's normal equations by pose and lens, of which inverse (6, 6) is C⁻¹,
    the pose's; of_lens (6, 6): the lens's covariance; noise: the variance of a coordinate, px².
    row (12,): the pose of the scaled board; board: the mean that was taken off the board's points
    (board units) and the size they were divided by.
    """
    # The pose follows the lens,  δ = F dθ,  F = -C⁻¹ B,  and has its own noise beside that:
    #     cov(δ) = σ² C⁻¹ + F Λ Fᵀ,     cov(δ, θ) = F Λ.
    n = POSE_COLUMNS
    follows, with_lens = np.zeros((n, LENS_SIZE)), np.zeros((n, LENS_SIZE))
    for a in range(n):
        for j in range(LENS_SIZE):
            for b in range(n):
                follows[a, j] -= inverse[a, b] * block[b, n + j]
    for a in range(n):
        for j in range(LENS_SIZE):
            for i in range(LENS_SIZE):
                with_lens[a, j] += follows[a, i] * of_lens[i, j]
    for a in range(n):
        for b in range(n):
            covariance[a, b] = noise * inverse[a, b]
            for j in range(LENS_SIZE):
                covariance[a, b] += with_lens[a, j] * follows[b, j]
        for at, j in ((n, FOCAL), (n + 1, K)):
            covariance[a, at] = covariance[at, a] = with_lens[a, j]
    for at, i in ((n, FOCAL), (n + 1, K)):
        covariance[at, n] = of_lens[i, FOCAL]
        covariance[at, n + 1] = of_lens[i, K]
    for j in range(n + 2):
        pose_to_public(covariance[:, j], row, board)
    for j in range(n + 2):
        pose_to_public(covariance[j, :], row, board)
