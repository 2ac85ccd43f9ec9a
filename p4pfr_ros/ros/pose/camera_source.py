# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""The camera for each observation, by ``intrinsics.mode``, and the estimate with it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

from p4pfr_ros import (
    BoardShape,
    CalibrationOptions,
    CalibrationState,
    CameraEstimate,
    CameraInfoModel,
    DivisionCamera,
    estimate_pose,
    EstimateOptions,
    PoseEstimate,
    SelfCalibration,
    Verdict,
)
from p4pfr_ros.boards.shape_in_use import shape_in_use
from p4pfr_ros.files.calibration import Calibration

from .camera_check import CameraCheck
from .inputs import BoardObservation, Inputs
from ..parameters.pose_options import (
    CAMERA_INFO,
    FIXED,
    PER_FRAME,
    PoseNodeOptions,
    SELF_CALIBRATE,
)
from ..runtime.rejections import Notice, Rejected

# An estimate also holds where the lens was seen, and the shapes of the boards.
KnownCamera = CameraEstimate | DivisionCamera | CameraInfoModel

# Number of image sizes whose cameras are stored.
_MAX_SIZES = 8

_CHANGED = Notice(
    'camera_changed',
    'the camera has changed (zoom, focus, another lens): calibration restarted',
)
_NO_CAMERA = Rejected(
    'no_camera',
    'intrinsics.mode fixed: no camera. Set intrinsics.focal_px, point calibration_file to an '
    'existing file, or start with mode self_calibrate',
)


class CameraSource:
    """
    Selects the camera for an observation.

    Parameters
    ----------
    calibrations
        The cameras of the modes self_calibrate and fixed.
    inputs
        The camera of the mode camera_info.

    """

    def __init__(self, calibrations: CalibrationBySize, inputs: Inputs) -> None:
        self._calibrations, self._inputs = calibrations, inputs

    def camera_for(
        self, observation: BoardObservation, options: PoseNodeOptions
    ) -> SelfCalibration | KnownCamera | Rejected | None:
        """
        Return the camera for an observation.

        A SelfCalibration is to be updated with the observation. None means that the camera is
        estimated from the observation alone.
        """
        image_size, given = observation.frame.size, options.intrinsics
        if given.mode == SELF_CALIBRATE:
            return self._calibrations.select(image_size, options.robust, options.calibration)
        if given.mode == PER_FRAME:
            return None
        if given.mode == CAMERA_INFO:
            return self._inputs.camera_model()
        return self._fixed(image_size, options)

    def known(self, image_size: tuple[int, int], options: PoseNodeOptions) -> KnownCamera | None:
        """Return the camera in use for images of this size, if it is known without a view."""
        mode = options.intrinsics.mode
        if mode == SELF_CALIBRATE:
            return self._calibrations.estimated(image_size)
        if mode != FIXED:
            return None
        camera = self._fixed(image_size, options)
        return None if isinstance(camera, Rejected) else camera

    def _fixed(
        self, image_size: tuple[int, int], options: PoseNodeOptions
    ) -> KnownCamera | Rejected:
        given = options.intrinsics
        if given.focal_px > 0.0:
            center_px = options.image.center_px(image_size)
            return DivisionCamera(
                given.focal_px,
                center_px,
                given.k,
                given.k2,
                given.k3,
                given.k4,
                given.aspect,
                given.p1,
                given.p2,
            )
        return self._calibrations.known_camera(image_size)


def estimate_with(
    camera: SelfCalibration | KnownCamera | None,
    observation: BoardObservation,
    options: PoseNodeOptions,
    check: CameraCheck,
    on_pose: Callable[[PoseEstimate], object],
) -> PoseEstimate:
    """
    Estimate the pose of a board, and update a SelfCalibration.

    ``check`` withholds the poses of a given camera that does not fit the images.

    ``on_pose`` is called once with the estimate that is returned; while a SelfCalibration is
    CALIBRATED and the view agrees, that is before the update, which takes longer than the pose.
    """
    image_points, board_points = observation.image_points, observation.points.board_points
    image_size, name = observation.frame.size, observation.target.name
    if isinstance(camera, SelfCalibration):
        stamp_ns = observation.stamp_ns
        return camera.update(image_points, board_points, stamp_ns, board=name, on_pose=on_pose)
    if camera is not None:
        shape = _shape(camera, observation)
        if isinstance(camera, CameraEstimate):
            camera = camera.camera
        estimate = estimate_pose(
            image_points,
            board_points,
            image_size=image_size,
            camera=camera,
            board_shape=shape,
            options=options.robust,
        )
        board = observation.target.prefix
        estimate = check.judged(camera, image_size, board, image_points, estimate)
    else:
        estimate = estimate_pose(
            image_points,
            board_points,
            image_size=image_size,
            center_px=options.image.center_px(image_size),
            options=options.robust,
        )
    on_pose(estimate)
    return estimate


def on_real_board(
    camera: SelfCalibration | KnownCamera | None, observation: BoardObservation
) -> BoardObservation:
    """Return an observation with its points on the real board, if the shape is known."""
    shape = _shape(camera, observation)
    if shape is None:
        return observation
    return replace(observation, surface_points=shape.points(observation.points.board_points))


def _shape(
    camera: SelfCalibration | KnownCamera | None, observation: BoardObservation
) -> BoardShape | None:
    """Return the shape of the observed board from the calibration in use."""
    estimate = camera.fused if isinstance(camera, SelfCalibration) else camera
    if not isinstance(estimate, CameraEstimate):
        return None
    return shape_in_use(estimate, observation.target.name, observation.points.board_points)


def camera_to_publish(
    camera: SelfCalibration | KnownCamera | None, estimate: PoseEstimate, mode: str
) -> KnownCamera | None:
    """Return the camera in use after an estimate; None if it is unknown, or from camera_info."""
    if isinstance(camera, SelfCalibration):
        return camera.fused
    if mode == CAMERA_INFO:
        return None
    if camera is not None:
        return camera
    observable = estimate.observable
    if estimate.model is None or not (observable.focal and observable.distortion):
        return None
    return estimate.model.camera


class CalibrationBySize:
    """
    Holds one SelfCalibration per image size and switches when the size changes.

    Of other sizes only the estimated camera is stored; it is loaded when the size returns.

    Parameters
    ----------
    loaded
        The calibration of the file, for images of its size.

    Attributes
    ----------
    restarted
        Whether the last view belongs to another camera than the view before it.

    """

    def __init__(self, loaded: Calibration | None = None) -> None:
        self.restarted = False
        self._loaded = loaded
        self._calibration: SelfCalibration | None = None
        self._settings: tuple[EstimateOptions, CalibrationOptions] | None = None
        self._notice: Notice | None = None
        self._estimates: dict[tuple[int, int], CameraEstimate] = {}
        if loaded is not None and loaded.estimate is not None:
            self._estimates[loaded.image_size] = loaded.estimate

    @property
    def state(self) -> CalibrationState:
        """The state of the current calibration."""
        calibration = self._calibration
        return CalibrationState.UNCALIBRATED if calibration is None else calibration.state

    @property
    def fused(self) -> CameraEstimate | None:
        """The camera that is estimated from all views; None while it is unknown."""
        return None if self._calibration is None else self._calibration.fused

    @property
    def missing(self) -> tuple[str, ...]:
        """What would make the camera CALIBRATED, as advice; empty if it is."""
        return () if self._calibration is None else self._calibration.missing

    @property
    def image_size(self) -> tuple[int, int] | None:
        """The image size of the current calibration; None before the first view."""
        return None if self._calibration is None else self._calibration.image_size

    @property
    def has_camera(self) -> bool:
        """Whether a camera was loaded or estimated, of any image size."""
        return self._loaded is not None or bool(self._estimates) or self.fused is not None

    def select(
        self, image_size: tuple[int, int], robust: EstimateOptions, options: CalibrationOptions
    ) -> SelfCalibration:
        """Return the calibration to update with a view of this size; new options replace it."""
        before, settings = self._calibration, (robust, options)
        self._notice, self.restarted = None, False
        if before is None:
            self._notice = self._wrong_size(image_size)
            return self._start(image_size, settings)
        if before.image_size == image_size and settings == self._settings:
            return before
        if before.fused is not None:
            self._store(before.image_size, before.fused)
        if before.image_size != image_size:
            again = image_size in self._estimates
            self._notice = Notice('image_size', _size_text(before.image_size, image_size, again))
            self.restarted = True
        return self._start(image_size, settings)

    def finish_view(self) -> Notice | None:
        """
        After an update: return a notice if the camera or the image size has changed.

        If the camera has changed, the stored cameras of other sizes are dropped.
        """
        calibration = self._calibration
        if calibration is None or calibration.verdict is not Verdict.RESTARTED:
            return self._notice
        self._estimates.clear()
        self.restarted = True
        return self._notice or _CHANGED

    def estimated(self, image_size: tuple[int, int]) -> CameraEstimate | None:
        """Return the estimated camera for images of this size, loaded ones included."""
        if self.image_size == image_size and self.fused is not None:
            return self.fused
        return self._estimates.get(image_size)

    def known_camera(self, image_size: tuple[int, int]) -> KnownCamera | Rejected:
        """Return the loaded or estimated camera for images of this size."""
        estimated, loaded = self.estimated(image_size), self._loaded
        if estimated is not None:
            return estimated
        if loaded is not None and loaded.image_size == image_size:
            return loaded.model
        wrong_size = self._wrong_size(image_size)
        return Rejected(wrong_size.cause, wrong_size.reason) if wrong_size else _NO_CAMERA

    def reset(self) -> None:
        """Drop all estimated cameras and the loaded one."""
        self._loaded, self.restarted = None, False
        self._estimates.clear()
        if self._calibration is not None:
            self._calibration.reset()

    def _start(
        self, image_size: tuple[int, int], settings: tuple[EstimateOptions, CalibrationOptions]
    ) -> SelfCalibration:
        self._settings = robust, options = settings
        self._calibration = SelfCalibration(image_size, options=options, robust=robust)
        stored = self._estimates.get(image_size)
        if stored is not None:
            self._calibration.load(stored)
        return self._calibration

    def _store(self, image_size: tuple[int, int], estimate: CameraEstimate) -> None:
        self._estimates.pop(image_size, None)
        self._estimates[image_size] = estimate
        if len(self._estimates) > _MAX_SIZES:
            del self._estimates[next(iter(self._estimates))]

    def _wrong_size(self, image_size: tuple[int, int]) -> Notice | None:
        """Return a notice if there are cameras, but none for images of this size."""
        sizes = [*self._estimates]
        if self._loaded is not None:
            sizes.append(self._loaded.image_size)
        if not sizes or image_size in sizes:
            return None
        return Notice('image_size', _size_text(sizes[-1], image_size))


def _size_text(expected: tuple[int, int], got: tuple[int, int], again: bool = False) -> str:
    (w, h), (width, height) = expected, got
    camera = 'the earlier camera of that size' if again else 'another camera'
    return (
        f'the camera was calibrated with images of {w}x{h} px, but the images now have '
        f'{width}x{height} px: treated as {camera}'
    )
