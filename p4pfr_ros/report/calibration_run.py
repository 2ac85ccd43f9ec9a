# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""A camera calibrated from pictures, one after another, and what became of each."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from p4pfr_ros import CameraEstimate, EstimateOptions, Keyframe, SelfCalibration, Verdict
from p4pfr_ros.boards import Board
from p4pfr_ros.core.geometry import Array
from p4pfr_ros.detection import detect
from p4pfr_ros.files.images import ImageArray

# The picture is divided into cells: those with a corner in them are covered.
COLUMNS, ROWS = 10, 8


@dataclass(frozen=True, slots=True, eq=False)
class NamedPicture:
    """A picture, or the reason why there is none, and what it is called."""

    name: str
    picture: ImageArray | str


@dataclass(frozen=True, slots=True)
class Miss:
    """A picture that could not be used, and why; numbers count from 1."""

    number: int
    name: str
    reason: str


@dataclass(frozen=True, slots=True, eq=False)
class Sighting:
    """
    A picture that shows the board; numbers count from 1.

    points, inliers
        How many points were found, and how many agree with the view's estimate.
    rms_px
        Over the inliers.
    verdict
        What the calibration made of the view.
    fused
        The camera from all the views so far, once there is one.
    """

    number: int
    name: str
    points: int
    inliers: int
    rms_px: float
    verdict: Verdict
    fused: CameraEstimate | None


class PictureCalibration:
    """
    Shows pictures of a board to a `SelfCalibration`, and keeps what became of each.

    The first picture that shows the board says how large all have to be.
    """

    def __init__(self, board: Board, robust: EstimateOptions) -> None:
        self._board = board
        self._robust = robust
        self.calibration: SelfCalibration | None = None
        self.sightings: list[Sighting] = []
        self.misses: list[Miss] = []

    @property
    def fused(self) -> CameraEstimate | None:
        """Return the camera from all the views, if there is one."""
        return self.calibration.fused if self.calibration else None

    @property
    def views(self) -> tuple[Keyframe, ...]:
        """Return the views that the camera comes from; their stamps are the pictures' numbers."""
        return self.calibration.views if self.calibration else ()

    def look_at(self, named: NamedPicture) -> Sighting | Miss:
        """Take one picture in."""
        number = len(self.sightings) + len(self.misses) + 1
        seen = self._sighting(number, named)
        if isinstance(seen, str):
            miss = Miss(number, named.name, seen)
            self.misses.append(miss)
            return miss
        self.sightings.append(seen)
        return seen

    def _sighting(self, number: int, named: NamedPicture) -> Sighting | str:
        if isinstance(named.picture, str):
            return named.picture
        found = detect(named.picture, self._board)
        if found.reason:
            return found.reason
        height, width = named.picture.shape[:2]
        if self.calibration is None:
            self.calibration = SelfCalibration((width, height), robust=self._robust)
        if self.calibration.image_size != (width, height):
            expected = '{}x{}'.format(*self.calibration.image_size)
            return f'expected {expected} px like the pictures before, got {width}x{height}'
        estimate = self.calibration.update(found.image_points, found.board_points, number)
        if estimate.model is None:
            return estimate.status.value
        return Sighting(
            number,
            named.name,
            len(found.ids),
            int(estimate.inliers.sum()),
            estimate.rms_px,
            self.calibration.verdict,
            self.calibration.fused,
        )


def coverage(points_px: Array, image_size: tuple[int, int]) -> Array:
    """Count points (N, 2) in each cell of the picture: (ROWS, COLUMNS)."""
    width, height = image_size
    # Pixel centres are integers, so the picture begins half a pixel before 0.
    edges_x = np.linspace(-0.5, width - 0.5, COLUMNS + 1)
    edges_y = np.linspace(-0.5, height - 0.5, ROWS + 1)
    counts: Array = np.histogram2d(points_px[:, 1], points_px[:, 0], (edges_y, edges_x))[0]
    return counts
