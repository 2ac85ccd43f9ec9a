# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""What was seen, estimated and true at one moment, and how far apart they are."""

from __future__ import annotations

from dataclasses import dataclass
import math

import numpy as np
from p4pfr_ros import DivisionCamera, Pose, Solution
from p4pfr_ros.core.geometry import rotation_angle_rad

from ..conversions import Correspondences, ImageArray


@dataclass(frozen=True, slots=True, eq=False)
class View:
    """Everything of one stamp; ``latency_s`` from the picture's stamp to the pose's arrival."""

    picture: ImageArray
    points: Correspondences
    estimate: Solution
    true_pose: Pose
    latency_s: float

    @property
    def extent_px(self) -> float:
        """Width and height of the box around the points, added up."""
        return float(np.ptp(self.points.image_points, axis=0).sum())

    @property
    def rms_px(self) -> float:
        """Reprojection error of the estimate."""
        board_points = np.pad(self.points.board_points, ((0, 0), (0, 1)))
        in_camera = self.estimate.camera_from_board.transform(board_points)
        residuals = self.estimate.camera.project(in_camera) - self.points.image_points
        return float(np.sqrt(np.mean(np.sum(residuals**2, axis=1))))


@dataclass(frozen=True, slots=True)
class Errors:
    """
    How far an estimate is from the truth.

    position and focal are relative (to the board's distance, to the true focal length);
    rotation_deg is the angle of the whole turn that is missing, about whatever axis.
    """

    position: float
    rotation_deg: float
    focal: float
    k: float
    rms_px: float
    latency_s: float

    @classmethod
    def of(cls, view: View, camera: DivisionCamera) -> Errors:
        """Compare a view's estimate with its true pose and the true camera."""
        pose, true = view.estimate.camera_from_board, view.true_pose
        away = float(np.linalg.norm(pose.translation - true.translation))
        return cls(
            position=away / float(np.linalg.norm(true.translation)),
            rotation_deg=math.degrees(rotation_angle_rad(pose.rotation, true.rotation)),
            focal=abs(view.estimate.camera.focal_px / camera.focal_px - 1.0),
            k=abs(view.estimate.camera.k - camera.k),
            rms_px=view.rms_px,
            latency_s=view.latency_s,
        )


def median_errors(errors: list[Errors]) -> Errors:
    """Return the median of each."""
    rows = [[getattr(e, name) for name in Errors.__slots__] for e in errors]
    return Errors(*np.median(rows, axis=0).tolist())


def tilt_deg(camera_from_board: Pose) -> float:
    """Return the angle between board and image plane: 0 seen head-on, 180 from behind."""
    x, y, z = camera_from_board.rotation[:, 2]  # out of the board, so towards the camera
    return math.degrees(math.atan2(math.hypot(x, y), -z))
