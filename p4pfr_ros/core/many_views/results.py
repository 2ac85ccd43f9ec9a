# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""The words of self-calibration: what it is asked, how far it is, what became of a view."""

from __future__ import annotations

from dataclasses import dataclass
import enum
import math
from typing import Any

from ..geometry import Array, Mask, Pose


class CalibrationState(enum.Enum):
    """How far the calibration is; the value is a sentence for people."""

    UNCALIBRATED = 'the views do not tell the focal length and distortion yet'
    CONVERGING = 'the camera is known roughly, and better with each new view'
    CALIBRATED = 'the camera is known as well as was asked for'


class Verdict(enum.Enum):
    """What became of a view; the value is a sentence for people."""

    USED = 'the camera has been estimated anew, with what the view tells'
    REDUNDANT = 'the view agrees with the camera, and adds nothing new'
    OUTLIER = 'the view disagrees with the camera, and does not count'
    RESTARTED = 'the views disagree with the camera for good: it has changed, and is started over'
    NO_POSE = 'the view has no answer'


@dataclass(frozen=True, slots=True, kw_only=True)
class CalibrationOptions:
    """
    How ``SelfCalibration`` works.

    Parameters
    ----------
    max_views
        At most so many views are kept whole: those that tell most of the camera together. Of
        others it is remembered what they told.
    min_views
        With fewer it is never calibrated.
    focal_tolerance
        Standard deviation of the focal length, as a share of it, below which it is calibrated.
    center_tolerance
        The same of the optical centre, as a share of the picture's diagonal.
    bend_tolerance
        The same of the distortion at the picture's corner, k |d|².
    center_spread
        How far the optical centre of lenses is from the middle of the picture, a standard
        deviation, as a share of the diagonal.
    new_view
        A view counts as new when its points lie so far from where any kept view has them, as a
        share of the picture's diagonal.
    outliers_to_restart
        Of the last ten views that told something of the camera, so many that disagree mean that
        it has changed.

    Raises
    ------
    ValueError
        An option is out of its range.

    """

    max_views: int = 40
    min_views: int = 5
    focal_tolerance: float = 0.005
    center_tolerance: float = 0.005
    bend_tolerance: float = 0.01
    center_spread: float = 0.03
    new_view: float = 0.02
    outliers_to_restart: int = 5

    def __post_init__(self) -> None:
        for name in ('focal', 'center', 'bend'):
            name += '_tolerance'
            if not 0.0 < getattr(self, name) < 1.0:
                raise ValueError(f'{name} must be between 0 and 1, got {getattr(self, name)}')
        for name in ('center_spread', 'new_view'):
            if not 0.0 < getattr(self, name) < math.inf:
                raise ValueError(f'{name} must be > 0, got {getattr(self, name)}')
        if not 2 <= self.min_views <= self.max_views:
            raise ValueError(
                'min_views must be at least 2 and at most max_views, got '
                f'{self.min_views} and {self.max_views}'
            )
        if not 2 <= self.outliers_to_restart <= 10:
            raise ValueError(
                f'outliers_to_restart must be from 2 to 10, got {self.outliers_to_restart}'
            )


@dataclass(frozen=True, slots=True, eq=False)
class Keyframe:
    """
    A view that the camera is estimated from.

    image_points (N, 2) raw px, board_points (N, 2) and camera_from_board in board units,
    inliers (N,) bool, residuals_px (N, 2) reprojected less seen (NaN where the camera does not
    see the point), rms_px of the inliers, and the stamp that came with it.
    """

    image_points: Array
    board_points: Array
    camera_from_board: Pose
    inliers: Mask
    residuals_px: Array
    rms_px: float
    stamp: Any
