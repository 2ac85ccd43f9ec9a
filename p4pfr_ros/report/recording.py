# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""
All that is computed from one recording: its camera, the poses in it, a report, and a summary.

This module stands alone: it runs on any machine that reads the recording, and writes nothing
there. The command line decides where, and what becomes of the files.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
import csv
from dataclasses import dataclass, field
import io
from pathlib import Path
from tempfile import TemporaryDirectory
import time
from typing import Any

import cv2
from p4pfr_ros import __version__, CalibrationState, EstimateOptions
from p4pfr_ros.boards import Board
from p4pfr_ros.files.calibration import Calibration, save_calibration
from p4pfr_ros.files.image_sources import open_source
from p4pfr_ros.files.images import Decoding, uncalibrated_size
from p4pfr_ros.files.yaml_fields import ConfigError
from p4pfr_ros.report.calibration_run import CalibrationRun, detect_in, DetectedImage
from p4pfr_ros.report.image_pose import (
    CSV_COLUMNS,
    csv_row,
    estimate_detection,
    FailedImage,
    Given,
    ImageEstimate,
    TUM_HEADINGS,
    tum_line,
)

# Columns of the summary after the recording's name.
SUMMARY_COLUMNS = (
    'state',
    'images',
    'views',
    'poses',
    'focal_px',
    'sigma_focal_px',
    'rms_px',
    'projection_sigma_px',
    'coverage',
    'seconds',
    'error',
)
CAMERA, CSV, TUM, REPORT = 'camera.yaml', 'poses.csv', 'poses.tum', 'report.png'


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class RecordingTask:
    """
    A recording (bag, video, or folder of images), and how to process it.

    force: write the camera even if it is not calibrated. The other fields are those of
    `open_source` and `calibrate`.
    """

    path: Path
    board: Board
    options: EstimateOptions
    topic: str | None = None
    every: int = 1
    max_megapixels: float = 64.0
    moving: str = 'camera'
    force: bool = False
    version: str = field(default=__version__)


@dataclass(frozen=True, slots=True, eq=False)
class RecordingResult:
    """The contents of the files by name, and the values of `SUMMARY_COLUMNS`."""

    files: dict[str, bytes]
    summary: dict[str, Any]


def process_recording(task: RecordingTask) -> RecordingResult:
    """
    Calibrate the camera of a recording, and estimate the poses in it with that camera.

    If the camera is not calibrated, each pose is estimated with a camera of its own.

    Raises
    ------
    ConfigError
        The recording cannot be read, or shows no board.

    """
    if task.version != __version__:
        raise ConfigError(f'expected p4pfr_ros {task.version} on all machines, got {__version__}')
    cv2.setNumThreads(1)  # all cores have a process
    began_s = time.monotonic()
    how = Decoding(as_grey=True, max_megapixels=task.max_megapixels)
    run = CalibrationRun(task.board, task.options)
    images: list[DetectedImage] = []
    with open_source([task.path], task.topic, task.every, task.max_megapixels) as source:
        for frame in source.frames:
            images.append(detect_in(frame.load(how), task.board))
            run.add_detected(images[-1])
    if run.calibration is None:
        raise ConfigError(f'the board was not detected in any of {len(images)} images')
    camera = _camera(run, task.path.stem)
    is_calibrated = run.calibration.state is CalibrationState.CALIBRATED
    given = Given(task.board, task.options, None, camera if is_calibrated else None)
    poses = [_pose(image, given) for image in images]
    written = camera if is_calibrated or task.force else None
    summary = _summary(run, poses) | {'seconds': round(time.monotonic() - began_s, 2)}
    return RecordingResult(_files(run, written, poses, task.moving), summary)


def _camera(run: CalibrationRun, name: str) -> Calibration | None:
    if run.fused is None or run.calibration is None:
        return None
    return Calibration.from_estimate(run.fused, run.calibration.image_size, name)


def _pose(image: DetectedImage, given: Given) -> ImageEstimate | FailedImage:
    reason = image.detection if isinstance(image.detection, str) else ''
    if given.calibration is not None and not reason:
        reason = uncalibrated_size(given.calibration.image_size, image.image_size)
    if reason or isinstance(image.detection, str):
        return FailedImage(image.name, reason, None, image.stamp_ns, image.recording)
    return estimate_detection(image, image.image_size, image.detection, given)


def _summary(run: CalibrationRun, poses: Sequence[ImageEstimate | FailedImage]) -> dict[str, Any]:
    assert run.calibration is not None
    summary = {
        'state': run.calibration.state.name.lower(),
        'images': len(poses),
        'views': len(run.keyframes),
        'poses': sum(isinstance(pose, ImageEstimate) for pose in poses),
        'coverage': run.coverage,
    }
    if run.fused is None:
        return summary
    return summary | {
        'focal_px': run.fused.camera.focal_px,
        'sigma_focal_px': run.fused.focal_sigma_px,
        'rms_px': run.fused.rms_px,
        'projection_sigma_px': run.fused.projection_sigma_px,
    }


def _files(
    run: CalibrationRun,
    camera: Calibration | None,
    poses: Sequence[ImageEstimate | FailedImage],
    moving: str,
) -> dict[str, bytes]:
    """Return the contents of the files by name."""
    from p4pfr_ros.report.plots import write_report  # imports matplotlib: slow

    lines = [tum_line(pose, index, moving) for index, pose in enumerate(poses)]
    trajectory = [TUM_HEADINGS[moving], *(line for line in lines if line is not None)]
    files = {
        CSV: csv_text(CSV_COLUMNS, map(csv_row, poses)).encode(),
        TUM: ('\n'.join(trajectory) + '\n').encode(),
    }
    with TemporaryDirectory() as folder:
        if camera is not None:
            save_calibration(Path(folder, CAMERA), camera)
        if run.calibration is not None and run.records:
            write_report(Path(folder, REPORT), run.calibration, run.records)
        return files | {path.name: path.read_bytes() for path in sorted(Path(folder).iterdir())}


def csv_text(columns: Iterable[str], rows: Iterable[Iterable[Any]]) -> str:
    """Return a table as comma-separated values."""
    text = io.StringIO()
    writer = csv.writer(text, lineterminator='\n')
    writer.writerow(columns)
    writer.writerows(rows)
    return text.getvalue()
