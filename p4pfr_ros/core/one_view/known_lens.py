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

"""A pose by a camera that somebody has calibrated: plumb_bob, rational_polynomial, equidistant."""

from __future__ import annotations

from dataclasses import replace
import functools

import numpy as np
from numpy.typing import ArrayLike
from p4pfr_ros.core.answer import no_estimate
from p4pfr_ros.core.camera import DivisionCamera
from p4pfr_ros.core.camera_info_model import CameraInfoModel
from p4pfr_ros.core.closest_division import division_camera_from_model
from p4pfr_ros.core.estimate import PoseEstimate, RansacOptions, Stop
from p4pfr_ros.core.geometry import Array, as_points
from p4pfr_ros.core.robust import estimate_pose

_FEWEST_POINTS = 4


def undistorted_rays(model: CameraInfoModel, points_px: ArrayLike) -> Array:
    """
    Return the normalised pinhole coordinates (N, 2), X / Z and Y / Z, of raw pixels (N, 2).

    Exact: iterated until they project back to their pixel within rounding. NaN where the model
    has no ray for the pixel, or one that does not point ahead.
    """
    rays = model.unproject(as_points(points_px, 'points_px', (None, 2)))
    ahead = np.where(rays[:, 2:] > 0.0, rays[:, 2:], np.nan)
    normalised: Array = rays[:, :2] / ahead
    return normalised


def estimate_pose_by_model(
    image_points: ArrayLike,
    board_points: ArrayLike,
    model: CameraInfoModel,
    options: RansacOptions | None = None,
) -> PoseEstimate:
    """
    Estimate the pose alone, by a calibrated camera.

    Each pixel's ray is exact by the model. The reprojection errors are those of the division
    camera closest to it, moved to where that camera sees the very same rays: it is the answer's
    ``model.camera``, and its pixels are raw pixels but for the model's residual. So threshold,
    rms_px and covariance keep their meaning for wide lenses, as they would not in the plane of an
    undistorted picture, which stretches its rim.

    Parameters
    ----------
    image_points : (N, 2) array, N ≥ 4
        Raw pixels. Those that the model has no ray for are outliers.
    board_points : (N, 2) array
        The same points on the board's plane Z = 0, metres.
    model
        The calibrated camera.
    options
        How to search.

    Raises
    ------
    ValueError
        A wrong shape, or a number that is not finite.

    """
    raw = as_points(image_points, 'image_points', (None, 2))
    board = as_points(board_points, 'board_points', (len(raw), 2))
    if len(raw) < _FEWEST_POINTS:
        raise ValueError(f'image_points must be at least {_FEWEST_POINTS}, got {len(raw)}')
    camera = _closest(model)
    moved = camera.project(model.unproject(raw))
    seen = ~np.isnan(moved).any(axis=1)
    if np.count_nonzero(seen) < _FEWEST_POINTS:
        return no_estimate(Stop.NO_SOLUTION, len(raw), 0)
    estimate = estimate_pose(
        moved[seen], board[seen], image_size=model.image_size, camera=camera, options=options
    )
    inliers = np.zeros(len(raw), dtype=bool)
    inliers[seen] = estimate.inliers
    return replace(estimate, inliers=inliers)


@functools.lru_cache(maxsize=16)
def _closest(model: CameraInfoModel) -> DivisionCamera:
    """Keep what stays the same from frame to frame."""
    return division_camera_from_model(model)[0]
