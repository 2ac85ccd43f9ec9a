# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""
The number of terms of the division polynomial that the data require.

Rao's score test needs no fit: at the optimum of one order the gradient by the next term, after the
free terms have adapted to it, is normal with the variance of the information matrix if that term
is zero in truth. Its square over that variance is χ² with one degree of freedom.

This module stands alone because freeing and fixing a term are one test and must stay side by side.
"""

from __future__ import annotations

import numpy as np

from .joint_fit import JointFit
from ..model.lens import K, LENS_SIZE

# Lenses have one to three terms.
MAX_ORDER = 3

# χ² above which a term is freed, and below which it is fixed again: five and three standard
# deviations. The test is repeated at each view, and residuals are not exactly normal.
_FREED = 25.0
_FIXED = 9.0


def requires_next_term(fit: JointFit) -> bool:
    """Return whether the residuals require the next term."""
    free = K + fit.order
    if fit.order == MAX_ORDER:
        return False
    information, gradient = fit.equations[:, :LENS_SIZE], fit.equations[:, LENS_SIZE]
    by_free = np.linalg.solve(information[:free, :free], information[:free, free])
    left = information[free, free] - by_free @ information[:free, free]
    gradient_left = gradient[free] - by_free @ gradient[:free]
    return bool(gradient_left**2 > _FREED * left * fit.variance)


def needs_last_term(fit: JointFit) -> bool:
    """Return whether the last free term differs from zero."""
    last = K + fit.order - 1
    return fit.order == 1 or bool(fit.lens[last] ** 2 > _FIXED * fit.covariance[last, last])
