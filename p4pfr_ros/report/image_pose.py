# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""The pose of the board in one image of a sequence, as JSON, CSV, or a line of a trajectory."""

from __future__ import annotations

from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

from p4pfr_ros import (
    BoardShape,
    CameraInfoModel,
    DivisionCamera,
    estimate_pose,
    EstimateOptions,
    Observability,
    PoseEstimate,
    Solution,
    Status,
)
from p4pfr_ros.boards import Board
from p4pfr_ros.boards.shape_in_use import shape_in_use
from p4pfr_ros.boards.symmetry import with_turned_poses
from p4pfr_ros.core.geometry import Array
from p4pfr_ros.detection import detect, Detection
from p4pfr_ros.files.calibration import Calibration
from p4pfr_ros.files.image_sources import NamedImage, seconds
from p4pfr_ros.files.images import ImageArray, uncalibrated_size, write_image
from p4pfr_ros.report.drawing import annotate

CSV_COLUMNS = (
    'image',
    'stamp_s',
    'x_m',
    'y_m',
    'z_m',
    'qx',
    'qy',
    'qz',
    'qw',
    'tilt_deg',
    'distance_m',
    'focal_px',
    'k',
    'sigma_distance_m',
    'sigma_focal_px',
    'sigma_k',
    'rms_px',
    'points',
    'inliers',
    'candidates',
    'status',
    'reason',
)
# First line of a trajectory, by what moves: camera_from_board or its inverse.
TUM_HEADINGS = {
    'camera': '# board_from_camera: timestamp tx ty tz qx qy qz qw',
    'board': '# camera_from_board: timestamp tx ty tz qx qy qz qw',
}
_ALL = Observability(direction=True, distance=True, focal=True, distortion=True)


@dataclass(frozen=True, slots=True)
class FailedImage:
    """An image without an estimate, and why; status: of the estimation, if there was one."""

    name: str
    reason: str
    status: Status | None = None
    stamp_ns: int | None = None
    recording: str = ''


@dataclass(frozen=True, slots=True, eq=False)
class ImageEstimate:
    """
    An image (width and height in pixels) and its estimate; model is the estimate's.

    camera_is_given: by --camera; has_board_shape: so is the shape of the board.
    """

    name: str
    image_size: tuple[int, int]
    model: Solution
    estimate: PoseEstimate
    camera_is_given: bool
    has_board_shape: bool
    stamp_ns: int | None = None
    recording: str = ''

    @property
    def candidates(self) -> list[Solution]:
        """All solutions of an ambiguous view, the best first; none if it is unambiguous."""
        alternatives = list(self.estimate.alternatives)
        return [self.model, *alternatives] if alternatives else []


@dataclass(frozen=True, slots=True, eq=False)
class Given:
    """What is given for all images; calibration: of the camera, if it is known."""

    board: Board
    options: EstimateOptions
    center_px: tuple[float, float] | None
    calibration: Calibration | None

    def camera_and_shape(
        self, board_points: Array
    ) -> tuple[DivisionCamera | CameraInfoModel | None, BoardShape | None]:
        """Return the known camera, and the shape of the board from its calibration."""
        if self.calibration is None:
            return None, None
        known = self.calibration.estimate
        if known is None:
            return self.calibration.model, None
        return known.camera, shape_in_use(known, self.board.name, board_points)


def estimate_image(
    named: NamedImage, given: Given, draw_folder: Path | None = None
) -> ImageEstimate | FailedImage:
    """
    Detect the board in an image and estimate its pose; draw the result if requested.

    Raises
    ------
    ConfigError
        The drawing cannot be written.

    """
    image = named.image
    if isinstance(image, str):
        return _failed(named, image)
    height, width = image.shape[:2]
    if given.calibration is not None:
        wrong_size = uncalibrated_size(given.calibration.image_size, (width, height))
        if wrong_size:
            return _failed(named, wrong_size)
    detection = detect(image, given.board)
    result = estimate_detection(named, (width, height), detection, given)
    if draw_folder is not None:
        path = draw_folder / f'{named.file_stem}_pose.png'
        write_image(path, _drawn(image, detection, result, given.board))
    return result


def estimate_detection(
    named: NamedImage, image_size: tuple[int, int], detection: Detection, given: Given
) -> ImageEstimate | FailedImage:
    """Estimate the pose of a detected board; the image itself is not used."""
    if detection.reason:
        return _failed(named, detection.reason)
    camera, shape = given.camera_and_shape(detection.board_points)
    estimate = estimate_pose(
        detection.image_points,
        detection.board_points,
        image_size=image_size,
        center_px=given.center_px,
        camera=camera,
        board_shape=shape,
        options=given.options,
    )
    estimate, _ = with_turned_poses(estimate, given.board.turns)
    if estimate.model is None:
        return _failed(named, estimate.status.value, estimate.status)
    return ImageEstimate(
        named.name,
        image_size,
        estimate.model,
        estimate,
        camera_is_given=camera is not None,
        has_board_shape=shape is not None,
        stamp_ns=named.stamp_ns,
        recording=named.recording,
    )


def _failed(named: NamedImage, reason: str, status: Status | None = None) -> FailedImage:
    return FailedImage(named.name, reason, status, named.stamp_ns, named.recording)


def _drawn(
    image: ImageArray, detection: Detection, result: ImageEstimate | FailedImage, board: Board
) -> ImageArray:
    if isinstance(result, ImageEstimate):
        return annotate(image, detection, result.model, board)
    return annotate(image, replace(detection, reason=result.reason))


def as_json(result: ImageEstimate | FailedImage) -> dict[str, Any]:
    """Return the result as a JSON object without NaN."""
    if isinstance(result, FailedImage):
        line: dict[str, Any] = {'image': result.name, 'reason': result.reason}
        return line if result.status is None else line | {'status': result.status.name.lower()}
    estimate = result.estimate
    observable, limits = estimate.observable, estimate.focal_limits
    return {
        'image': result.name,
        'stamp_s': None if result.stamp_ns is None else float(seconds(result.stamp_ns)),
        'image_size': list(result.image_size),
        'status': estimate.status.name.lower(),
        **_solution_as_json(result.model, observable),
        'sigma': _sigmas(result),
        'focal_limits': None if limits is None else asdict(limits),
        'rms_px': estimate.rms_px,
        'points': len(estimate.inliers),
        'inliers': int(estimate.inliers.sum()),
        'uses_board_shape': result.has_board_shape,
        'not_observable': list(observable.undetermined),
        'candidates': [_solution_as_json(candidate, _ALL) for candidate in result.candidates],
    }


def _sigmas(result: ImageEstimate) -> dict[str, float | None]:
    """Return the standard deviations of what is estimated and determined."""
    estimate, is_free = result.estimate, not result.camera_is_given
    observable = estimate.observable
    return {
        'distance_m': estimate.distance_sigma if observable.distance else None,
        'focal_px': estimate.focal_sigma_px if observable.focal and is_free else None,
        'k': estimate.k_sigma if observable.distortion and is_free else None,
    }


def _solution_as_json(solution: Solution, observable: Observability) -> dict[str, Any]:
    pose, camera = solution.camera_from_board, solution.camera
    return {
        'position_m': pose.translation.tolist() if observable.distance else None,
        'quaternion_xyzw': pose.quaternion_xyzw().tolist() if observable.direction else None,
        'tilt_deg': pose.tilt_deg if observable.direction else None,
        'distance_m': pose.distance if observable.distance else None,
        'focal_px': camera.focal_px if observable.focal else None,
        'k': camera.k if observable.distortion else None,
        'center_px': list(camera.center_px),
    }


def csv_row(result: ImageEstimate | FailedImage) -> list[Any]:
    """Return the values of `CSV_COLUMNS`; None for what is not determined."""
    stamp = None if result.stamp_ns is None else seconds(result.stamp_ns)
    values: dict[str, Any] = {'image': result.name, 'stamp_s': stamp}
    if isinstance(result, FailedImage):
        status = None if result.status is None else result.status.name.lower()
        values |= {'status': status, 'reason': result.reason}
        return [values.get(column) for column in CSV_COLUMNS]
    line = as_json(result)
    values |= dict(zip(('x_m', 'y_m', 'z_m'), line['position_m'] or (), strict=False))
    values |= dict(zip(('qx', 'qy', 'qz', 'qw'), line['quaternion_xyzw'] or (), strict=False))
    values |= {f'sigma_{name}': sigma for name, sigma in line['sigma'].items()}
    values |= {'candidates': max(1, len(result.candidates))}
    return [values[c] if c in values else line.get(c) for c in CSV_COLUMNS]


def tum_line(result: ImageEstimate | FailedImage, index: int, moving: str) -> str | None:
    """
    Return the pose as a line of a trajectory in the format of TUM's RGB-D benchmark.

    Parameters
    ----------
    result
        The pose; None is returned without one, or if the view does not determine the distance.
    index
        The stamp of an image without a stamp: its number.
    moving
        'camera': the pose of the camera in the frame of the board. 'board': the reverse.

    """
    if isinstance(result, FailedImage):
        return None
    observable = result.estimate.observable
    if not (observable.direction and observable.distance):
        return None
    pose = result.model.camera_from_board
    pose = pose.inverse() if moving == 'camera' else pose
    stamp = str(index) if result.stamp_ns is None else seconds(result.stamp_ns)
    numbers = (*pose.translation, *pose.quaternion_xyzw())
    return ' '.join([stamp, *(f'{number:.9f}' for number in numbers)])
