# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""The camera that is found while the robot works: made for a size, started over, kept."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from p4pfr_ros import (
    CalibrationOptions,
    CalibrationState,
    CameraEstimate,
    DivisionCamera,
    EstimateOptions,
    PoseEstimate,
    SelfCalibration,
    Verdict,
)
from p4pfr_ros.core.cameras.camera_info import CameraInfoModel
from p4pfr_ros.core.geometry import Array
from p4pfr_ros.files.calibration import Calibration

from ..runtime.rejections import Rejected

Known = DivisionCamera | CameraInfoModel

# Cameras of so many sizes of pictures are remembered.
_MOST_SIZES = 8

_CHANGED = Rejected(
    'camera_changed',
    'the camera has changed (zoom, focus, another lens): its calibration starts over',
)
_NO_CAMERA = Rejected(
    'no_camera',
    'intrinsics.mode fixed: set intrinsics.focal_px, or a calibration_file that there is, or '
    'choose self_calibrate until the camera is found',
)


@dataclass(frozen=True, slots=True, eq=False)
class News:
    """
    What a view has brought besides its pose.

    camera
        The one that is in use now, as far as it is known.
    remark
        What people should hear of.
    restarted
        Whether the camera was taken for another one than before.
    """

    camera: Known | None = None
    remark: Rejected | None = None
    restarted: bool = False


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
        self._settings: tuple[EstimateOptions, CalibrationOptions] | None = None
        self._known_by_size: dict[tuple[int, int], CameraEstimate] = {}
        if loaded is not None and loaded.estimate is not None:
            self._known_by_size[loaded.image_size] = loaded.estimate

    @property
    def state(self) -> CalibrationState:
        """How far the calibration has come."""
        calibration = self._calibration
        return CalibrationState.UNCALIBRATED if calibration is None else calibration.state

    @property
    def knows_any(self) -> bool:
        """Whether a camera was loaded or has been found."""
        known = self._known_by_size or self.fused is not None
        return self._loaded is not None or bool(known)

    @property
    def fused(self) -> CameraEstimate | None:
        """The camera that all views together have given, once they have."""
        return None if self._calibration is None else self._calibration.fused

    @property
    def image_size(self) -> tuple[int, int] | None:
        """The size of the pictures that it is of, once one has come."""
        return None if self._calibration is None else self._calibration.image_size

    def make_ready(
        self, image_size: tuple[int, int], robust: EstimateOptions, options: CalibrationOptions
    ) -> News:
        """Be ready for a view in a picture of a size; say whether that is another camera's."""
        before, settings = self._calibration, (robust, options)
        if before is None:
            self._begin(image_size, settings)
            return News(remark=self._not_of_this_size(image_size))
        if before.image_size == image_size and settings == self._settings:
            return News()
        if before.fused is not None:
            self._remember(before.image_size, before.fused)
        self._begin(image_size, settings)
        if before.image_size == image_size:
            return News()
        again = image_size in self._known_by_size
        return News(remark=_other_size(before.image_size, image_size, again), restarted=True)

    def answer(
        self, image_points: Array, board_points: Array, stamp_ns: int
    ) -> tuple[PoseEstimate, Callable[[], News]]:
        """Answer a view; the call that is returned learns from it. ``make_ready`` comes first."""
        calibration = self._calibration
        assert calibration is not None
        estimate = calibration.update(image_points, board_points, stamp_ns)
        news = self._news(calibration)
        return estimate, lambda: news

    def known_camera(self, image_size: tuple[int, int]) -> Known | Rejected:
        """Return the camera as it is known now, for who does not want it to change."""
        if self.image_size == image_size and self.fused is not None:
            return self.fused.camera
        known, loaded = self._known_by_size.get(image_size), self._loaded
        if known is not None:
            return known.camera
        if loaded is not None and loaded.image_size == image_size:
            return loaded.model
        return self._not_of_this_size(image_size) or _NO_CAMERA

    def reset(self) -> None:
        """Forget what was found, and what was loaded."""
        self._loaded = None
        self._known_by_size.clear()
        if self._calibration is not None:
            self._calibration.reset()

    def _begin(
        self, image_size: tuple[int, int], settings: tuple[EstimateOptions, CalibrationOptions]
    ) -> None:
        self._settings = robust, options = settings
        self._calibration = SelfCalibration(image_size, options=options, robust=robust)
        known = self._known_by_size.get(image_size)
        if known is not None:
            self._calibration.load(known)

    def _remember(self, image_size: tuple[int, int], estimate: CameraEstimate) -> None:
        self._known_by_size.pop(image_size, None)
        self._known_by_size[image_size] = estimate
        if len(self._known_by_size) > _MOST_SIZES:
            del self._known_by_size[next(iter(self._known_by_size))]

    def _news(self, calibration: SelfCalibration) -> News:
        fused, restarted = calibration.fused, calibration.verdict is Verdict.RESTARTED
        if restarted:  # so has what pictures of other sizes had told of it
            self._known_by_size.clear()
        camera = None if fused is None else fused.camera
        return News(camera, _CHANGED if restarted else None, restarted)

    def _not_of_this_size(self, image_size: tuple[int, int]) -> Rejected | None:
        """Say that there is a camera, but not one of pictures of this size."""
        known = [*self._known_by_size]
        if self._loaded is not None:
            known.append(self._loaded.image_size)
        return None if image_size in known or not known else _other_size(known[-1], image_size)


def _other_size(expected: tuple[int, int], got: tuple[int, int], again: bool = False) -> Rejected:
    (w, h), (width, height) = expected, got
    taken_for = 'the one of which pictures came before' if again else 'another one'
    return Rejected(
        'image_size',
        f'the camera was calibrated in pictures of {w}x{h} px, and now they are of '
        f'{width}x{height}: taken for {taken_for}',
    )
