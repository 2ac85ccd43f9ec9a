# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""The calibration of a camera from a sequence of images, with a record of each image."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from p4pfr_ros import CameraEstimate, EstimateOptions, Keyframe, SelfCalibration, Verdict
from p4pfr_ros.boards import Board
from p4pfr_ros.core.geometry import Array
from p4pfr_ros.detection import detect
from p4pfr_ros.files.images import ImageArray
from p4pfr_ros.report.thumbnails import thumbnail

# The grid in which the coverage of the image is counted.
COLUMNS, ROWS = 10, 8


@dataclass(frozen=True, slots=True, eq=False)
class NamedImage:
    """An image, or the reason why it could not be read, and its name."""

    name: str
    image: ImageArray | str


@dataclass(frozen=True, slots=True)
class RejectedImage:
    """An image without a usable view, and why; numbers count from 1."""

    number: int
    name: str
    reason: str


@dataclass(frozen=True, slots=True, eq=False)
class ViewRecord:
    """
    The view of the board in one image; numbers count images from 1.

    points, inliers
        Number of detected points, and of those consistent with the view's estimate.
    rms_px
        Root mean square reprojection error of the inliers.
    verdict
        How the calibration used the view.
    fused
        The camera estimated from all views up to this one, if any.
    """

    number: int
    name: str
    points: int
    inliers: int
    rms_px: float
    verdict: Verdict
    fused: CameraEstimate | None


class CalibrationRun:
    """
    Feeds images of a board to a `SelfCalibration`, and records the result of each.

    The first image in which the board is detected sets the image size for all others.

    Parameters
    ----------
    board
        The board in the images.
    options
        Options of the estimation from each view.
    with_thumbnails
        Whether small images are kept, for a report.

    """

    def __init__(
        self, board: Board, options: EstimateOptions, *, with_thumbnails: bool = False
    ) -> None:
        self.board = board
        self._options = options
        self._with_thumbnails = with_thumbnails
        # Small images with their points, JPEG, by the numbers of the images.
        self.thumbnails: dict[int, bytes] = {}
        self.calibration: SelfCalibration | None = None
        self.records: list[ViewRecord] = []
        self.rejected: list[RejectedImage] = []

    @property
    def fused(self) -> CameraEstimate | None:
        """The camera estimated from all views, if any."""
        return self.calibration.fused if self.calibration else None

    @property
    def keyframes(self) -> tuple[Keyframe, ...]:
        """The views that the camera is estimated from; their stamps are image numbers."""
        return self.calibration.views if self.calibration else ()

    @property
    def coverage(self) -> float:
        """Share of the image's cells that contain an inlier of a keyframe."""
        if self.calibration is None or not self.keyframes:
            return 0.0
        points = np.concatenate([view.image_points[view.inliers] for view in self.keyframes])
        return float((count_per_cell(points, self.calibration.image_size) > 0).mean())

    def add(self, named: NamedImage) -> ViewRecord | RejectedImage:
        """Detect the board in an image and update the calibration."""
        number = len(self.records) + len(self.rejected) + 1
        record = self._record(number, named)
        if isinstance(record, str):
            rejected = RejectedImage(number, named.name, record)
            self.rejected.append(rejected)
            return rejected
        self.records.append(record)
        return record

    def _record(self, number: int, named: NamedImage) -> ViewRecord | str:
        """Return the record of an image, or why it is rejected."""
        if isinstance(named.image, str):
            return named.image
        detection = detect(named.image, self.board)
        if self._with_thumbnails:
            self.thumbnails[number] = thumbnail(named.image, detection)
        if detection.reason:
            return detection.reason
        height, width = named.image.shape[:2]
        if self.calibration is None:
            self.calibration = SelfCalibration((width, height), robust=self._options)
        if self.calibration.image_size != (width, height):
            expected = '{}x{}'.format(*self.calibration.image_size)
            return f'expected {expected} px like the previous images, got {width}x{height}'
        estimate = self.calibration.update(
            detection.image_points, detection.board_points, number, board=self.board.name
        )
        if estimate.model is None:
            return estimate.status.value
        return ViewRecord(
            number,
            named.name,
            len(detection.ids),
            int(estimate.inliers.sum()),
            estimate.rms_px,
            self.calibration.verdict,
            self.calibration.fused,
        )


def count_per_cell(points_px: Array, image_size: tuple[int, int]) -> Array:
    """Count points (N, 2) in each cell of the image: (ROWS, COLUMNS)."""
    width, height = image_size
    # Pixel centres are integers, so the image starts at -0.5.
    edges_x = np.linspace(-0.5, width - 0.5, COLUMNS + 1)
    edges_y = np.linspace(-0.5, height - 0.5, ROWS + 1)
    counts: Array = np.histogram2d(points_px[:, 1], points_px[:, 0], (edges_y, edges_x))[0]
    return counts
