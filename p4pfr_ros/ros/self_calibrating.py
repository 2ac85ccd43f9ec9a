# Copyright 2026 p4pfr_ros maintainers
#
# Licensed under the Apache License, Version 2.0 (the "License");
# you may not use this file except in compliance with the License.
# You may obtain a copy of the License at
#
#     http://www.apache.org/licenses/LICENSE-2.0
#
# Unless required by applicable law or agreed to in writing, software
# distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied.
# See the License for the specific language governing permissions and
# limitations under the License.

"""The camera that is found while the robot works: made for a size, started over, kept."""

from __future__ import annotations

from collections.abc import Callable

from p4pfr_ros import (
    CalibrationOptions,
    CalibrationState,
    CameraEstimate,
    DivisionCamera,
    PoseEstimate,
    RansacOptions,
    SelfCalibration,
    Verdict,
)
from p4pfr_ros.calibration_file import Calibration
from p4pfr_ros.core.camera_info_model import CameraInfoModel
from p4pfr_ros.core.geometry import Array

from .rejections import Rejected

_CHANGED = Rejected(
    'camera_changed',
    'the camera has changed (zoom, focus, another lens): its calibration starts over',
)
_NO_CAMERA = Rejected(
    'no_camera',
    'intrinsics.mode fixed: set intrinsics.focal_px, or a calibration_file that there is, or '
    'choose self_calibrate until the camera is found',
)


class SelfCalibrating:
    """
    A ``SelfCalibration`` for the picture's size of the day.

    Parameters
    ----------
    loaded
        What to begin with, for pictures of its size.

    """

    def __init__(self, loaded: Calibration | None = None) -> None:
        self._loaded = loaded
        self._calibration: SelfCalibration | None = None
        self._settings: tuple[RansacOptions, CalibrationOptions] | None = None

    @property
    def state(self) -> CalibrationState:
        """How far the calibration has come."""
        calibration = self._calibration
        return CalibrationState.UNCALIBRATED if calibration is None else calibration.state

    @property
    def knows_any(self) -> bool:
        """Whether a camera was loaded or has been found."""
        return self._loaded is not None or self.fused is not None

    @property
    def fused(self) -> CameraEstimate | None:
        """The camera that all views together have given, once they have."""
        return None if self._calibration is None else self._calibration.fused

    @property
    def image_size(self) -> tuple[int, int] | None:
        """The size of the pictures that it is of, once one has come."""
        return None if self._calibration is None else self._calibration.image_size

    def make_ready(
        self, image_size: tuple[int, int], robust: RansacOptions, options: CalibrationOptions
    ) -> Rejected | None:
        """Be ready for a view in a picture of a size; say whether that is another camera's."""
        before, settings = self._calibration, (robust, options)
        if before is not None and before.image_size == image_size and settings == self._settings:
            return None
        self._settings = settings
        if before is not None and before.image_size == image_size:
            self._begin(image_size, before.fused)
            return None
        loaded = self._loaded
        begins = loaded is not None and loaded.image_size == image_size
        self._begin(image_size, loaded.estimate if loaded and begins else None)
        return None if before is None else _other_size(before.image_size, image_size)

    def answer(
        self, image_points: Array, board_points: Array, stamp_ns: int
    ) -> tuple[PoseEstimate, Callable[[], None]]:
        """Answer a view; the call that is returned learns from it. ``make_ready`` comes first."""
        calibration = self._calibration
        assert calibration is not None
        sighting = calibration.look(image_points, board_points, stamp_ns)
        early = calibration.early_answer(sighting)
        if early is not None:
            return early, lambda: calibration.learn(sighting)
        calibration.learn(sighting)
        return calibration.answer(sighting), _nothing

    def news(self) -> DivisionCamera | None:
        """Return the camera if the last view has changed it."""
        calibration = self._calibration
        if calibration is None or calibration.fused is None:
            return None
        is_new = calibration.verdict in (Verdict.KEPT, Verdict.RESTARTED)
        return calibration.fused.camera if is_new else None

    def remark(self) -> Rejected | None:
        """Say whether the last view was of another camera than those before it."""
        calibration = self._calibration
        changed = calibration is not None and calibration.verdict is Verdict.RESTARTED
        return _CHANGED if changed else None

    def known_camera(
        self, image_size: tuple[int, int]
    ) -> DivisionCamera | CameraInfoModel | Rejected:
        """Return the camera as it is known now, for who does not want it to change."""
        if self.image_size == image_size and self.fused is not None:
            return self.fused.camera
        loaded = self._loaded
        if loaded is None:
            return _NO_CAMERA
        if loaded.image_size != image_size:
            return _other_size(loaded.image_size, image_size)
        return loaded.model if loaded.estimate is None else loaded.estimate.camera

    def reset(self) -> None:
        """Forget what was found, and what was loaded."""
        self._loaded = None
        if self._calibration is not None:
            self._calibration.reset()

    def _begin(self, image_size: tuple[int, int], known: CameraEstimate | None) -> None:
        assert self._settings is not None
        robust, options = self._settings
        self._calibration = SelfCalibration(image_size, options=options, robust=robust)
        if known is not None:
            self._calibration.adopt(known)


def _nothing() -> None:
    """Learn no more."""


def _other_size(expected: tuple[int, int], got: tuple[int, int]) -> Rejected:
    (w, h), (width, height) = expected, got
    return Rejected(
        'image_size',
        f'the camera was calibrated in pictures of {w}x{h} px, and now they are of '
        f'{width}x{height}: taken for another one',
    )
