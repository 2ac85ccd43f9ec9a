# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""
The smallest consensus that is accepted: more than chance, and more than a small minority.

Chance is judged a contrario (Moisan and Stival, IJCV 2004). Suppose that the N image points are
uniform in an area A. A model that four of them define has a given other point within the
threshold t with probability α = π t² / A. The expected number of sets of k inliers, over all
sizes, all sets and all fours that may define the model, is

    NFA(k) = (N - 4) C(N, k) C(k, 4) α^(k - 4) = (N - 4) C(N, 4) C(N - 4, k - 4) α^(k - 4).

NFA(4) is more than one, and NFA(k + 1) / NFA(k) = α (N - k) / (k - 3) decreases with k, so the
NFA is below a bound from one k on.

This module stands alone because it is one statistical test, independent of camera and search.
"""

from __future__ import annotations

import math

from ..geometry import Array
from ..jit import jit

# Largest expected number of sets by chance.
_MAX_EXPECTED = 1e-3


@jit
def fewest_inliers(image: Array, threshold_px: float, max_area: float, at_least: int) -> int:
    """
    Return the smallest number of inliers that is accepted; all points together always are.

    image (N, 2) px; max_area: the image's area, px², which the points' bounding box is limited
    to; at_least: the minimum for other reasons.
    """
    n = len(image)
    alpha = math.pi * threshold_px * threshold_px / _area(image, threshold_px, max_area)
    k = min(max(at_least, 4), n)
    # The logarithm of the NFA, with m! = Γ(m + 1) and C(N, 4) C(N - 4, k - 4) in one.
    log_expected = math.log(max(n - 4, 1)) + math.lgamma(n + 1.0) - math.log(24.0)
    log_expected -= math.lgamma(k - 3.0) + math.lgamma(n - k + 1.0)
    log_expected += (k - 4) * math.log(alpha)
    while k < n and log_expected > math.log(_MAX_EXPECTED):
        log_expected += math.log(alpha * (n - k) / (k - 3.0))
        k += 1
    return k


@jit
def _area(image: Array, threshold_px: float, max_area: float) -> float:
    """Return the area of the points' bounding box, px², at least that of a square of 2 t."""
    low_x = high_x = image[0, 0]
    low_y = high_y = image[0, 1]
    for i in range(1, len(image)):
        low_x = min(low_x, image[i, 0])
        high_x = max(high_x, image[i, 0])
        low_y = min(low_y, image[i, 1])
        high_y = max(high_y, image[i, 1])
    smallest = 4.0 * threshold_px * threshold_px
    area: float = max(min((high_x - low_x) * (high_y - low_y), max_area), smallest)
    return area
