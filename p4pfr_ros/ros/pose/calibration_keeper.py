# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""Loads the calibration, watches it grow, saves it, and passes it on when it is good."""

from __future__ import annotations

from collections.abc import Callable
import math
import time

from p4pfr_ros import CalibrationState, CameraEstimate
from p4pfr_ros.files.calibration import Calibration, load_calibration, save_calibration
from p4pfr_ros.files.yaml_fields import ConfigError
from p4pfr_ros.report.number_format import plus_minus
from sensor_msgs.msg import CameraInfo
from std_msgs.msg import Header

from .calibration_path import calibration_path
from .self_calibrating import SelfCalibrating
from ..conversions import camera_info_from_model_msg, ImageFrame
from ..parameters.pose_options import PoseNodeOptions
from ..runtime.rejections import Rejected

# After which a calibration that could not be saved is tried again.
_AGAIN_S = 60.0


class CalibrationKeeper:
    """
    Looks after the calibration that ``found`` makes.

    Parameters
    ----------
    options
        Of the node: where the file is.
    tell
        Takes the CameraInfo of a calibration that has become good.
    say
        Takes a line for people.

    Raises
    ------
    ConfigError
        The file is there, and it is no calibration.

    """

    def __init__(
        self,
        options: PoseNodeOptions,
        tell: Callable[[CameraInfo], object],
        say: Callable[[str], object],
    ) -> None:
        self._path = calibration_path(options.calibration_file, options.camera_name)
        self._camera_name = options.camera_name
        self._tell, self._say = tell, say
        self._state: CalibrationState
        self._is_passed_on: bool
        self._forget()
        self.found = SelfCalibrating(self._load() if options.calibration_file else None)

    def look_after(
        self, header: Header, frame: ImageFrame, options: PoseNodeOptions, *, restarted: bool
    ) -> Rejected | None:
        """
        After a view: say how far it is; once it is good, pass it on, and save it if asked.

        Where saving failed it is tried again after a while; what is returned says why.
        """
        if restarted:
            self._forget()
        before, self._state = self._state, self.found.state
        if self._state is not before:
            estimate = self.found.fused
            numbers = '' if estimate is None else f': {_in_words(estimate)}'
            self._say(f'calibration: {self._state.value}{numbers}')
        if self._state is not CalibrationState.CALIBRATED:
            return None
        # A state that wavers about its limit is passed on once, and saved once.
        if not self._is_passed_on:
            self._is_passed_on = True
            calibration = self._calibration()
            assert calibration is not None
            self._tell(camera_info_from_model_msg(header, frame, calibration.model))
        wanted = options.save_when_calibrated and not self._is_saved
        return self._save_unasked() if wanted and time.monotonic() >= self._try_again_s else None

    def _save_unasked(self) -> Rejected | None:
        self._is_saved, text = self.save()
        if self._is_saved:
            self._say(text)
            return None
        self._try_again_s = time.monotonic() + _AGAIN_S
        return Rejected('not_saved', f'save_when_calibrated: {text}')

    def save(self) -> tuple[bool, str]:
        """Write the file; return whether that went well, and a line for people."""
        calibration = self._calibration()
        if calibration is None or calibration.estimate is None:
            return False, 'nothing to save: no calibration has been found yet'
        try:
            save_calibration(self._path, calibration)
        except ConfigError as error:
            return False, str(error)
        return True, f'saved to {self._path}: {_in_words(calibration.estimate)}'

    def reset(self) -> None:
        """Start over, as if nothing had been seen or loaded."""
        self.found.reset()
        self._forget()

    def _forget(self) -> None:
        self._state = CalibrationState.UNCALIBRATED
        self._is_passed_on = self._is_saved = False
        self._try_again_s = -math.inf

    def _load(self) -> Calibration | None:
        if not self._path.exists():
            return None
        calibration = load_calibration(self._path)
        if calibration.estimate is None:
            self._say(f'{self._path}: loaded, for the mode fixed: it is of another program')
        else:
            self._say(f'{self._path}: loaded: {_in_words(calibration.estimate)}')
        return calibration

    def _calibration(self) -> Calibration | None:
        estimate, size = self.found.fused, self.found.image_size
        if estimate is None or size is None:
            return None
        return Calibration.from_estimate(estimate, size, self._camera_name)


def _in_words(estimate: CameraEstimate) -> str:
    camera = estimate.camera
    x, y = map(plus_minus, camera.center_px, estimate.center_sigma_px)
    views = '1 view' if estimate.views == 1 else f'{estimate.views} views'
    return (
        f'focal length {plus_minus(camera.focal_px, estimate.focal_sigma_px)} px, centre {x}, {y} '
        f'px, k {plus_minus(camera.k, estimate.k_sigma)}, {views}'
    )
