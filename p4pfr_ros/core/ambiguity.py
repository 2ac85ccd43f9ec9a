# SPDX-License-Identifier: Apache-2.0
"""
The flip: a small or far board has a second pose that explains its picture nearly as well.

Mirroring the board's normal in the line of sight changes a weak perspective view not at all. So
the second local optimum is sought from there, and told where the noise cannot tell them apart.
"""

from __future__ import annotations

import numpy as np

from .geometry import Array, rotation_angle_rad
from .least_squares import LeastSquaresRoom, minimise
from .problem import Problem
from .solution import TRANSLATION

# Twice the log of the likelihood ratio beyond which the worse pose is out: one in a hundred.
_MAX_RATIO = 9.21

_STEPS = 100
_TOLERANCE = 1e-12

# Poses closer than this are the same optimum, radians.
_SAME_RAD = 0.02


def flipped_optimum(
    problem: Problem,
    row: Array,
    cost: float,
    limit: float,
    variance: float,
    room: LeastSquaresRoom,
) -> Array | None:
    """Return the other optimum's row where it is as good within the noise (px²), else None."""
    other = row.copy()
    other[:TRANSLATION] = _mirrored(row).ravel()
    other_cost = minimise(other, problem, limit, _STEPS, _TOLERANCE, room)
    same = rotation_angle_rad(_rotation(other), _rotation(row)) < _SAME_RAD
    if same or other_cost - cost > _MAX_RATIO * variance:
        return None
    return other


def _mirrored(row: Array) -> Array:
    """Turn the board so that its normal n is mirrored in the line of sight v."""
    sight = row[TRANSLATION : TRANSLATION + 3]
    v = sight / np.linalg.norm(sight)
    n = _rotation(row)[:, 2]
    mirrored = 2.0 * (v @ n) * v - n
    # Half a turn about v takes n to the mirrored normal; half a turn about that keeps it, and
    # undoes the turn within the plane.
    turned: Array = _half_turn(mirrored) @ _half_turn(v) @ _rotation(row)
    return turned


def _half_turn(axis: Array) -> Array:
    turn: Array = 2.0 * np.outer(axis, axis) - np.eye(3)
    return turn


def _rotation(row: Array) -> Array:
    return row[:TRANSLATION].reshape(3, 3)
