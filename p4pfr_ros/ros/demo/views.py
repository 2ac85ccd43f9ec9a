# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""The views of the demo: image, estimate and truth, and the errors of the estimates."""

from __future__ import annotations

from dataclasses import dataclass
import math

import numpy as np
from p4pfr_ros import DivisionCamera, Pose, Solution
from p4pfr_ros.core.geometry import rotation_angle_rad

from ..conversions import Correspondences, ImageArray


@dataclass(frozen=True, slots=True, eq=False)
class DemoView:
    """All data with one stamp; ``latency_s`` is from that stamp to the arrival of the pose."""

    image: ImageArray
    points: Correspondences
    estimate: Solution
    true_pose: Pose
    latency_s: float

    @property
    def extent_px(self) -> float:
        """Width plus height of the bounding box of the points."""
        return float(np.ptp(self.points.image_points, axis=0).sum())

    @property
    def rms_px(self) -> float:
        """RMS reprojection error of the estimate."""
        board_points = np.pad(self.points.board_points, ((0, 0), (0, 1)))
        in_camera = self.estimate.camera_from_board.transform(board_points)
        residuals = self.estimate.camera.project(in_camera) - self.points.image_points
        return float(np.sqrt(np.mean(np.sum(residuals**2, axis=1))))


@dataclass(frozen=True, slots=True)
class Errors:
    """
    The errors of an estimate.

    position and focal are relative to the true distance and the true focal length; rotation_deg
    is the angle of the rotation between estimate and truth.
    """

    position: float
    rotation_deg: float
    focal: float
    k: float
    rms_px: float
    latency_s: float

    @classmethod
    def of(cls, view: DemoView, camera: DivisionCamera) -> Errors:
        """Compare the estimate of a view with its true pose and the true camera."""
        pose, true = view.estimate.camera_from_board, view.true_pose
        error_m = float(np.linalg.norm(pose.translation - true.translation))
        return cls(
            position=error_m / true.distance,
            rotation_deg=math.degrees(rotation_angle_rad(pose.rotation, true.rotation)),
            focal=abs(view.estimate.camera.focal_px / camera.focal_px - 1.0),
            k=abs(view.estimate.camera.k - camera.k),
            rms_px=view.rms_px,
            latency_s=view.latency_s,
        )


class Record:
    """
    The errors of all views, the last view, and the view with the largest board.

    Parameters
    ----------
    camera
        The true camera.

    """

    def __init__(self, camera: DivisionCamera) -> None:
        self.errors: list[Errors] = []
        self.last: DemoView | None = None
        self.largest: DemoView | None = None
        self._camera = camera

    def add(self, view: DemoView) -> None:
        """Add a view."""
        self.errors.append(Errors.of(view, self._camera))
        self.last = view
        if self.largest is None or view.extent_px > self.largest.extent_px:
            self.largest = view


def median_errors(errors: list[Errors]) -> Errors:
    """Return the median of each error."""
    rows = [[getattr(e, name) for name in Errors.__slots__] for e in errors]
    return Errors(*np.median(rows, axis=0).tolist())
