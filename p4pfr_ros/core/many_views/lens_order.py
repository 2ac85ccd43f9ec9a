# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""
How many terms of the division polynomial the data ask for.

Rao's score test costs nothing: at the optimum of one order the gradient by the next term, taken
after the free ones have made the best of it, is normal with the variance that the information
matrix says, if that term is zero in truth. Its square over that variance is χ² of one degree.
"""

from __future__ import annotations

import numpy as np

from .joint_fit import JointFit
from ..model.lens import K, LENS_SIZE

# Lenses have one to three.
MAX_ORDER = 3

# χ² of a term that is taken in, and below which one is given up again: five and three standard
# deviations. A test is made at each view, and residuals are never quite normal.
_TAKEN_IN = 25.0
_GIVEN_UP = 9.0


def asks_for_next_term(fit: JointFit) -> bool:
    """Say whether the residuals demand the next term."""
    free = K + fit.order
    if fit.order == MAX_ORDER:
        return False
    information, gradient = fit.equations[:, :LENS_SIZE], fit.equations[:, LENS_SIZE]
    by_free = np.linalg.solve(information[:free, :free], information[:free, free])
    left = information[free, free] - by_free @ information[:free, free]
    pull = gradient[free] - by_free @ gradient[:free]
    return bool(pull**2 > _TAKEN_IN * left * fit.variance)


def needs_last_term(fit: JointFit) -> bool:
    """Say whether the last free term differs from zero."""
    last = K + fit.order - 1
    return fit.order == 1 or bool(fit.lens[last] ** 2 > _GIVEN_UP * fit.covariance[last, last])
