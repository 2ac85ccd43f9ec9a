# Copyright 2026 p4pfr_ros maintainers
#
# Licensed under the Apache License, Version 2.0 (the "License");
# you may not use this file except in compliance with the License.
# You may obtain a copy of the License at
#
#     http://www.apache.org/licenses/LICENSE-2.0
#
# Unless required by applicable law or agreed to in writing, software
# distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied.
# See the License for the specific language governing permissions and
# limitations under the License.

"""A view's pose by the camera of all views, and a covariance that holds that camera's errors."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
import math

import numpy as np

from .bundle import squared_errors, view_block
from .calibration_view import bundle_of, CalibrationView, camera_of
from .estimate import PoseEstimate, Stop
from .geometry import Array
from .information import inverse_of
from .joint_fit import JointFit
from .lens import COLUMNS, FOCAL, K, POSE_COLUMNS, RESIDUAL
from .observability import observability_of, without_the_undetermined
from .solution import Solution
from .uncertainty import noise_variance

# A view whose own noise is this many times the variance of all views' is believed: it is blurred.
_NOISIER = 2.0
_ENOUGH_TO_SPARE = 20


@dataclass(frozen=True, eq=False)
class SeenByFit:
    """
    A view through the camera of a joint fit.

    row (12,), the pose of the scaled board; squares (N,), the squared errors, px²; block (13, 13),
    the normal equations by pose and lens.
    """

    view: CalibrationView
    fit: JointFit
    row: Array
    squares: Array
    block: Array

    @property
    def cost(self) -> float:
        """The sum of the squared errors, each cut off at the fit's limit, px²."""
        return float(np.minimum(self.squares, self.fit.limit).sum())

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
        across, inverse = self._parts()[0], self._inverse
        of_lens = self.fit.covariance
        # The pose follows the lens:  δ = -C⁻¹ B dθ,  and has its own noise beside that.
        follows = -inverse @ across
        joint = np.empty((RESIDUAL, RESIDUAL))
        joint[:POSE_COLUMNS, :POSE_COLUMNS] = (
            self._noise() * inverse + follows @ of_lens @ follows.T
        )
        joint[:POSE_COLUMNS, POSE_COLUMNS:] = follows @ of_lens
        joint[POSE_COLUMNS:, :POSE_COLUMNS] = joint[:POSE_COLUMNS, POSE_COLUMNS:].T
        joint[POSE_COLUMNS:, POSE_COLUMNS:] = of_lens
        public = self._to_public()
        covariance: Array = public @ joint @ public.T
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
        inlier = self.squares < self.fit.limit
        spare = 2 * int(inlier.sum()) - POSE_COLUMNS
        common = self.fit.posterior_variance
        if spare < _ENOUGH_TO_SPARE:
            return common
        own = noise_variance(float(self.squares[inlier].sum()), spare, self.fit.limit)
        return own if own > _NOISIER * self.fit.variance else common

    def _to_public(self) -> Array:
        """Return the (8, 12) derivative of (t, ω, f, k) by (ω, t of the scaled board, lens)."""
        # t = s t_c - R m,   dt = s dt_c - ω x R m = s dt_c + [R m]ₓ ω.
        mean = self.row[:9].reshape(3, 3)[:, :2] @ self.view.scaled.board_mean
        x, y, z = mean.tolist()
        public = np.zeros((8, RESIDUAL))
        public[:3, :3] = [[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]]
        public[:3, 3:6] = self.view.scaled.board_size * np.eye(3)
        public[3:6, :3] = np.eye(3)
        public[6, POSE_COLUMNS + FOCAL] = public[7, POSE_COLUMNS + K] = 1.0
        return public


def seen_by_fit(view: CalibrationView, row: Array, fit: JointFit) -> SeenByFit:
    """Look at a view, its pose (12,) given, through the fit's camera."""
    points = bundle_of([view])
    squares = np.empty(len(view))
    block, jacobian = np.empty((COLUMNS, COLUMNS)), np.empty((2, COLUMNS))
    squared_errors(points, row[None], fit.lens, squares)
    view_block(points, 0, row, fit.lens, fit.limit, jacobian, block)
    return SeenByFit(view, fit, row, squares, block)


def fused_answer(seen: SeenByFit, known: PoseEstimate, threshold_px: float) -> PoseEstimate:
    """Dress a view's pose by a fit's camera; known is its estimate by a camera close to it."""
    camera = camera_of(seen.fit.lens, seen.view.scaled.center_px)
    pose = seen.view.pose_from_row(seen.row)
    covariance = seen.covariance()
    observable = observability_of(
        camera.focal_px, pose.translation, covariance, seen.view.scaled.corner_px
    )
    inliers = seen.squares < threshold_px**2
    stop = known.stop
    if observable.undetermined:
        stop = Stop.UNDETERMINED
    elif stop is Stop.UNDETERMINED:
        stop = Stop.CONFIDENT
    return replace(
        known,
        model=Solution(camera, pose),
        stop=stop,
        inliers=inliers,
        rms_px=math.sqrt(seen.squares[inliers].mean()) if inliers.any() else math.nan,
        covariance=without_the_undetermined(covariance, observable),
        alternatives=tuple(Solution(camera, o.camera_from_board) for o in known.alternatives),
        observable=observable,
    )
