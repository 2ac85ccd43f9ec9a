# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""A view through the camera of a joint fit: what it tells of that, and how sure its pose is."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from .bundle import Bundle, view_block
from .fused_covariance import fused_covariance
from .joint_fit import JointFit
from ..geometry import Array
from ..jit import jit
from ..model.calibration_view import bundle_of, CalibrationView
from ..model.lens import COLUMNS, POSE_COLUMNS, RESIDUAL, squared_error
from ..model.prior import inverse_of
from ..model.uncertainty import noise_variance
from ..one_view.problem import POSE_AND_CAMERA

# A view whose own noise is this many times the variance of all views' is believed: it is blurred.
_NOISIER = 2.0
_ENOUGH_TO_SPARE = 20


@dataclass(frozen=True, eq=False)
class SeenByFit:
    """
    A view through the camera of a joint fit.

    row (12,), the pose of the scaled board; squares (N,), the squared errors, px²; inliers, how
    many of them are within the fit's limit, and inlier_squares, their sum; block (13, 13), the
    normal equations by pose and lens.
    """

    view: CalibrationView
    fit: JointFit
    row: Array
    squares: Array
    inliers: int
    inlier_squares: float
    block: Array

    @property
    def cost(self) -> float:
        """The sum of the squared errors, each cut off at the fit's limit, px²."""
        return self.inlier_squares + (len(self.view) - self.inliers) * self.fit.limit

    @cached_property
    def told(self) -> Array:
        """What the view tells of the lens, (6, 6), px², its pose not known."""
        across, by_lens = self._parts()
        information: Array = by_lens - across.T @ self._inverse @ across
        return 0.5 * (information + information.T)

    @cached_property
    def pull(self) -> Array:
        """Where the view would have the lens go, its pose following: (6,), px²."""
        across, _ = self._parts()
        by_residual = self.block[:RESIDUAL, RESIDUAL]
        at_pose = self._inverse @ by_residual[:POSE_COLUMNS]
        gradient: Array = by_residual[POSE_COLUMNS:] - across.T @ at_pose
        return -gradient

    def covariance(self) -> Array:
        """Return the covariance (8, 8) of pose, focal length and k, in the caller's units."""
        scaled = self.view.scaled
        board = (*scaled.board_mean.tolist(), scaled.board_size)
        covariance = np.empty((POSE_AND_CAMERA, POSE_AND_CAMERA))
        fused_covariance(
            self.block,
            self._inverse,
            self.fit.covariance,
            self._noise(),
            self.row,
            board,
            covariance,
        )
        return covariance

    @cached_property
    def _inverse(self) -> Array:
        """C⁻¹, of the pose's part of the block."""
        return inverse_of(self.block[:POSE_COLUMNS, :POSE_COLUMNS])

    def _parts(self) -> tuple[Array, Array]:
        """Return B and A of the block."""
        pose, lens = slice(0, POSE_COLUMNS), slice(POSE_COLUMNS, RESIDUAL)
        return self.block[pose, lens], self.block[lens, lens]

    def _noise(self) -> float:
        """Return the variance of a coordinate, px²."""
        spare = 2 * self.inliers - POSE_COLUMNS
        common = self.fit.posterior_variance
        if spare < _ENOUGH_TO_SPARE:
            return common
        own = noise_variance(self.inlier_squares, spare, self.fit.limit)
        return own if own > _NOISIER * self.fit.variance else common


def seen_by_fit(view: CalibrationView, row: Array, fit: JointFit) -> SeenByFit:
    """Look at a view, its pose (12,) given, through the fit's camera."""
    squares, block = np.empty(len(view)), np.empty((COLUMNS, COLUMNS))
    inliers, total = _look(bundle_of([view]), row, fit.lens, fit.limit, squares, block)
    return SeenByFit(view, fit, row, squares, inliers, total, block)


@jit
def _look(
    points: Bundle, row: Array, lens: Array, limit: float, squares: Array, block: Array
) -> tuple[int, float]:
    """Write the squared errors and the block of a view; return its inliers, and their sum."""
    view_block(points, 0, row, lens, limit, np.empty((2, COLUMNS)), block)
    inliers, total = 0, 0.0
    for i in range(len(squares)):
        x, y = points.board[i, 0], points.board[i, 1]
        squares[i] = squared_error(row, lens, x, y, points.image[i, 0], points.image[i, 1])
        if squares[i] < limit:
            inliers += 1
            total += squares[i]
    return inliers, total
