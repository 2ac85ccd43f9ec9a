# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""The calibration of a camera from a sequence of images, with a record of each image."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from p4pfr_ros import CameraEstimate, EstimateOptions, Keyframe, SelfCalibration, Verdict
from p4pfr_ros.boards import Board
from p4pfr_ros.core.geometry import Array
from p4pfr_ros.detection import detect, Detection
from p4pfr_ros.files.image_sources import NamedImage
from p4pfr_ros.report.thumbnails import thumbnail

# The grid in which the coverage of the image is counted.
COLUMNS, ROWS = 10, 8


@dataclass(frozen=True, slots=True, eq=False)
class DetectedImage:
    """
    What was detected in an image (width and height in pixels), or why it could not be read.

    name, stamp_ns, recording: as of a `NamedImage`. thumbnail: the image with its points, small,
    as JPEG; b'' unless it was asked for.
    """

    name: str
    image_size: tuple[int, int]
    detection: Detection | str
    stamp_ns: int | None = None
    recording: str = ''
    thumbnail: bytes = b''


@dataclass(frozen=True, slots=True)
class RejectedImage:
    """
    An image without a usable view, and why; numbers count from 1.

    recording: the video or bag that it is a frame of; '' for a file.
    """

    number: int
    name: str
    reason: str
    recording: str = ''


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
        Whether `add` makes small images, for a report.

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
        return self.add_detected(
            detect_in(named, self.board, with_thumbnail=self._with_thumbnails)
        )

    def add_detected(self, detected: DetectedImage) -> ViewRecord | RejectedImage:
        """Update the calibration with what was detected in an image."""
        number = len(self.records) + len(self.rejected) + 1
        if detected.thumbnail:
            self.thumbnails[number] = detected.thumbnail
        record = self._record(number, detected)
        if isinstance(record, str):
            rejected = RejectedImage(number, detected.name, record, detected.recording)
            self.rejected.append(rejected)
            return rejected
        self.records.append(record)
        return record

    def _record(self, number: int, detected: DetectedImage) -> ViewRecord | str:
        """Return the record of an image, or why it is rejected."""
        detection, size = detected.detection, detected.image_size
        if isinstance(detection, str):
            return detection
        if detection.reason:
            return detection.reason
        if self.calibration is None:
            self.calibration = SelfCalibration(size, robust=self._options)
        if self.calibration.image_size != size:
            expected = '{}x{}'.format(*self.calibration.image_size)
            return f'expected {expected} px like the previous images, got {size[0]}x{size[1]}'
        estimate = self.calibration.update(
            detection.image_points, detection.board_points, number, board=self.board.name
        )
        if estimate.model is None:
            return estimate.status.value
        return ViewRecord(
            number,
            detected.name,
            len(detection.ids),
            int(estimate.inliers.sum()),
            estimate.rms_px,
            self.calibration.verdict,
            self.calibration.fused,
        )


def detect_in(named: NamedImage, board: Board, *, with_thumbnail: bool = False) -> DetectedImage:
    """Detect a board in an image; it may happen in another process than the calibration."""
    if isinstance(named.image, str):
        return DetectedImage(named.name, (0, 0), named.image, named.stamp_ns, named.recording)
    height, width = named.image.shape[:2]
    detection = detect(named.image, board)
    small = thumbnail(named.image, detection) if with_thumbnail else b''
    size = (width, height)
    return DetectedImage(named.name, size, detection, named.stamp_ns, named.recording, small)


def count_per_cell(points_px: Array, image_size: tuple[int, int]) -> Array:
    """Count points (N, 2) in each cell of the image: (ROWS, COLUMNS)."""
    width, height = image_size
    # Pixel centres are integers, so the image starts at -0.5.
    edges_x = np.linspace(-0.5, width - 0.5, COLUMNS + 1)
    edges_y = np.linspace(-0.5, height - 0.5, ROWS + 1)
    counts: Array = np.histogram2d(points_px[:, 1], points_px[:, 0], (edges_y, edges_x))[0]
    return counts
