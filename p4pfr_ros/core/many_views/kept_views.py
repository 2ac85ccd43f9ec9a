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

"""The views of a joint fit, for people: where the board was, and by how much each point misses."""

from __future__ import annotations

import math

import numpy as np

from .calibration_terms import KeptView
from .calibration_view import CalibrationView, camera_of
from .camera import DivisionCamera
from .geometry import Array
from .joint_fit import JointFit


def kept_views(fit: JointFit) -> tuple[KeptView, ...]:
    """Describe the views of a fit."""
    camera = camera_of(fit.lens, fit.views[0].scaled.center_px) if fit.views else None
    return tuple(
        _kept(view, row, camera, fit.limit)
        for view, row in zip(fit.views, fit.poses, strict=True)
        if camera is not None
    )


def _kept(view: CalibrationView, row: Array, camera: DivisionCamera, limit: float) -> KeptView:
    pose = view.pose_from_row(row)
    points = np.pad(view.board_points, ((0, 0), (0, 1)))
    residuals_px = camera.project(pose.transform(points)) - view.image_points
    squares = np.sum(residuals_px**2, axis=1)
    inliers = squares < limit
    return KeptView(
        image_points=view.image_points,
        board_points=view.board_points,
        camera_from_board=pose,
        inliers=inliers,
        residuals_px=residuals_px,
        rms_px=math.sqrt(squares[inliers].mean()) if inliers.any() else math.nan,
        stamp=view.stamp,
    )
