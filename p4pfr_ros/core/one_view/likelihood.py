# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""
Whether a very different focal length explains a view as well: a question for the likelihood.

Close to straight ahead the standard deviation misleads: the estimate then rests on a tilt that
the noise has made up, and around it the focal length seems to be known.
"""

from __future__ import annotations

import math

from .least_squares import least_squares_room, minimise, truncated_cost
from .prior import Prior
from .problem import Problem
from ..geometry import Array
from ..jit import jit
from ..minimal.solution import G, H, TRANSLATION

# What is called observable must tell a camera from one of half, and of twice, its focal length.
_FACTOR = 2.0

# A held focal length stays within a pixel or so.
_HOLD = 1.0

# From afar: first with a wide limit, of squares.
_WIDE = 100.0
_STEPS = 30
_TOLERANCE = 1e-4


@jit
def another_focal_fits(row: Array, problem: Problem, limit: float, excess: float) -> bool:
    """
    Say whether half or twice the focal length costs no more than ``excess`` (px²) in addition.

    Everything else is adapted to it by least squares; row is the estimate, limit the inliers'.
    """
    cost = truncated_cost(row, problem, limit, math.inf)
    room = least_squares_room()
    fits = False
    for factor in (1.0 / _FACTOR, _FACTOR):
        prior = Prior(factor * row[G], _HOLD, problem.prior.k, problem.prior.k_weight)
        held = Problem(
            problem.image,
            problem.board,
            problem.unknowns,
            problem.gates,
            prior,
            problem.rays,
            problem.across,
        )
        # As large in the picture, and as bent: the distance goes with f, and h r² / g stays.
        other = row.copy()
        other[G] *= factor
        other[H] *= factor
        other[TRANSLATION + 2] *= factor
        minimise(other, held, _WIDE * limit, _STEPS, _TOLERANCE, room)
        fits = fits or minimise(other, held, limit, _STEPS, _TOLERANCE, room) - cost < excess
    return fits
