# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""What is known of the camera beforehand: normal, as two more residuals of the least squares."""

from __future__ import annotations

from typing import NamedTuple

from ..geometry import Array
from ..jit import kernel
from ..minimal.solution import G, H


class Prior(NamedTuple):
    """
    Focal length (px) and k, each with a weight; weight 0: nothing is known of it.

    A weight is the ratio of two variances, the image noise's and the prior's own, so that the
    prior's squares are in px² as the points' are.
    """

    focal_px: float
    focal_weight: float
    k: float
    k_weight: float


NO_PRIOR = Prior(0.0, 0.0, 0.0, 0.0)


@kernel
def prior_cost(row: Array, prior: Prior) -> float:
    """Return the prior's share of the squared error, px²."""
    by_focal = row[G] - prior.focal_px
    by_k = row[G] * row[H] - prior.k
    cost: float = prior.focal_weight * by_focal * by_focal + prior.k_weight * by_k * by_k
    return cost


@kernel
def add_prior(row: Array, prior: Prior, normal: Array) -> None:
    """Add the prior to JᵀJ and, in column 8, Jᵀr: upper triangle alone."""
    # k = g h:  dk = h dg + g dh.
    g, h = row[G], row[H]
    by_focal, by_k = g - prior.focal_px, g * h - prior.k
    normal[6, 6] += prior.focal_weight + prior.k_weight * h * h
    normal[6, 7] += prior.k_weight * h * g
    normal[7, 7] += prior.k_weight * g * g
    normal[6, 8] += prior.focal_weight * by_focal + prior.k_weight * h * by_k
    normal[7, 8] += prior.k_weight * g * by_k
