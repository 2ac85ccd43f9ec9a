# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""What is to be said of one picture."""

from __future__ import annotations

from dataclasses import dataclass
import math
from pathlib import Path

import numpy as np
from p4pfr_ros import Pose, PoseEstimate, Solution

# Where the covariance of an estimate has these two.
_FOCAL, _K = 6, 7


@dataclass(frozen=True, slots=True)
class NoAnswer:
    """A picture that could not be read, shows no board, or allows no estimate: and why."""

    path: Path
    reason: str


@dataclass(frozen=True, slots=True, eq=False)
class Answer:
    """A picture (width and height in pixels) and the estimate from it; model is its best."""

    path: Path
    image_size: tuple[int, int]
    model: Solution
    estimate: PoseEstimate

    @property
    def focal_sigma_px(self) -> float:
        """Return the standard deviation of the focal length."""
        return math.sqrt(self.estimate.covariance[_FOCAL, _FOCAL])

    @property
    def k_sigma(self) -> float:
        """Return the standard deviation of the distortion."""
        return math.sqrt(self.estimate.covariance[_K, _K])

    @property
    def distance_sigma_m(self) -> float:
        """Return the standard deviation of the distance from the camera to the board's centre."""
        position = self.model.camera_from_board.translation
        sight = position / np.linalg.norm(position)
        return math.sqrt(sight @ self.estimate.covariance[:3, :3] @ sight)

    @property
    def not_observable(self) -> list[str]:
        """Return the names of what this view cannot tell."""
        names = ('direction', 'distance', 'focal', 'distortion')
        return [name for name in names if not getattr(self.estimate.observable, name)]


def distance_m(camera_from_board: Pose) -> float:
    """Return the distance from the camera to the board's centre."""
    return float(np.linalg.norm(camera_from_board.translation))


def tilt_deg(camera_from_board: Pose) -> float:
    """Return the angle between the board's normal and the viewing axis: 0 seen head-on."""
    x, y, z = camera_from_board.rotation[:, 2]  # out of the board, so towards the camera
    return math.degrees(math.atan2(math.hypot(x, y), -z))
