# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""The joint fit itself: find the noise, adjust with its gate, and say what came out."""

from __future__ import annotations

from collections.abc import Sequence
import math
from typing import NamedTuple

import numpy as np

from .bundle import Bundle, squared_errors
from .bundle_adjustment import (
    adjust,
    adjust_room,
    AdjustRoom,
    fill_blocks,
    lens_equations,
    view_equations,
)
from .joint_fit import gate_of, JointFit
from .scatter import scatter_of
from ..geometry import Array
from ..model.calibration_view import bundle_of, CalibrationView
from ..model.lens import K, LENS_SIZE, POSE_COLUMNS
from ..model.prior import Knowledge
from ..model.uncertainty import DEFAULT_SIGMA_PX, noise_variance

# The median of the squared length of a normal error is 2 ln 2 variances of a coordinate.
_MEDIAN_SQUARE = 2.0 * math.log(2.0)

# Where most points are not seen at all, px².
_LARGEST_SQUARE = 1e6

# With fewer coordinates to spare the residuals do not tell the noise.
_ENOUGH_TO_SPARE = 20

# Each round finds the noise anew, for its gate, and adjusts: steps at most, and tolerance.
_ROUNDS = ((20, 1e-2), (10, 1e-4), (20, 1e-7))


def fit_views(
    views: Sequence[CalibrationView],
    poses: Array,
    lens: Array,
    order: int,
    knowledge: Knowledge,
    sigma_px: float | None = None,
) -> JointFit:
    """
    Fit one lens to the views, from poses (V, 12) and lens (6,) on.

    sigma_px: the noise of a coordinate where it is known; None: it is measured.
    """
    points = bundle_of(views)
    poses, lens = poses.copy(), lens.copy()
    lens[K + order :] = 0.0
    squares = np.empty(len(points.image))
    room = adjust_room(len(views))
    unknowns = POSE_COLUMNS * len(views) + K + order
    variance = limit = 0.0
    for steps, tolerance in _ROUNDS:
        squared_errors(points, poses, lens, squares)
        variance = sigma_px**2 if sigma_px else _median_variance(squares, unknowns)
        limit = gate_of(variance)
        prior = knowledge.weighed(variance)
        adjust(points, poses, lens, order, prior, limit, steps, tolerance, room)
    fitted = _Fitted(tuple(views), points, lens, order, poses, limit, variance, room)
    return _described(fitted, knowledge, measured=sigma_px is None)


class _Fitted(NamedTuple):
    """What came out of the adjustment, and the room that it worked in."""

    views: tuple[CalibrationView, ...]
    points: Bundle
    lens: Array
    order: int
    poses: Array
    limit: float
    variance: float
    room: AdjustRoom


def _described(fitted: _Fitted, knowledge: Knowledge, measured: bool) -> JointFit:
    """Measure the noise, where it is not known, and linearise a last time."""
    views, points, lens, order, poses, limit, variance, room = fitted
    squares = np.empty(len(points.image))
    squared_errors(points, poses, lens, squares)
    inlier = squares < limit
    spare = 2 * int(inlier.sum()) - POSE_COLUMNS * len(views) - K - order
    measured = measured and spare >= _ENOUGH_TO_SPARE
    if measured:
        variance = noise_variance(float(squares[inlier].sum()), spare, limit)
    told = np.empty((len(views), LENS_SIZE, LENS_SIZE + 1))
    prior = knowledge.weighed(variance)
    fill_blocks(points, poses, lens, limit, room)
    view_equations(len(views), room, told)
    lens_equations(len(views), lens, prior, 0.0, room)
    free, scatter = slice(K + order), 1.0
    if measured:
        scatter = scatter_of(
            told[:, free, free],
            told[:, free, LENS_SIZE],
            prior.information[free, free],
            room.reduced[free, free],
            variance,
        )
    return JointFit(
        views=views,
        lens=lens,
        order=order,
        poses=poses,
        squares=squares,
        limit=limit,
        variance=variance,
        spare=spare,
        measured=measured,
        scatter=scatter,
        equations=room.reduced,
        prior=variance * (knowledge.information - knowledge.remembered),
        told=told[:, :, :LENS_SIZE],
        pulls=told[:, :, LENS_SIZE],
    )


def _median_variance(squares: Array, unknowns: int) -> float:
    """Return the variance of a coordinate, px², that the median of the squared errors tells."""
    coordinates = 2 * len(squares)
    spare = coordinates - unknowns
    median = min(float(np.median(squares)), _LARGEST_SQUARE)
    told = median / _MEDIAN_SQUARE * coordinates / max(spare, 1)
    return told if spare >= _ENOUGH_TO_SPARE else max(told, DEFAULT_SIGMA_PX**2)
