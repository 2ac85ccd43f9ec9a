# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""The views of a joint fit, for people: where the board was, and by how much each point misses."""

from __future__ import annotations

import math

import numpy as np

from .joint_fit import JointFit
from .results import Keyframe
from ..cameras.division import DivisionCamera
from ..geometry import Array
from ..model.calibration_view import CalibrationView, camera_of


def keyframes(fit: JointFit) -> tuple[Keyframe, ...]:
    """Describe the views of a fit."""
    camera = camera_of(fit.lens, fit.views[0].scaled.center_px) if fit.views else None
    return tuple(
        _kept(view, row, camera, fit.limit)
        for view, row in zip(fit.views, fit.poses, strict=True)
        if camera is not None
    )


def _kept(view: CalibrationView, row: Array, camera: DivisionCamera, limit: float) -> Keyframe:
    pose = view.pose_from_row(row)
    points = np.pad(view.board_points, ((0, 0), (0, 1)))
    residuals_px = camera.project(pose.transform(points)) - view.image_points
    squares = np.sum(residuals_px**2, axis=1)
    inliers = squares < limit
    return Keyframe(
        image_points=view.image_points,
        board_points=view.board_points,
        camera_from_board=pose,
        inliers=inliers,
        residuals_px=residuals_px,
        rms_px=math.sqrt(squares[inliers].mean()) if inliers.any() else math.nan,
        stamp=view.stamp,
    )
