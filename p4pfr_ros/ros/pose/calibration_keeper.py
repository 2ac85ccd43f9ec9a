# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""The calibration outside of the estimation: loaded, logged, saved, sent to the camera driver."""

from __future__ import annotations

import math
import os
from pathlib import Path
import tempfile
import time
from typing import Any
from urllib.parse import unquote

from p4pfr_ros import CalibrationState, CameraEstimate
from p4pfr_ros.files.calibration import (
    Calibration,
    is_missing,
    load_calibration,
    save_calibration,
)
from p4pfr_ros.files.printable import printable, printable_path, shown
from p4pfr_ros.files.yaml_fields import ConfigError
from p4pfr_ros.report.number_format import plus_minus, shape_text
from rclpy.task import Future
from sensor_msgs.msg import CameraInfo
from sensor_msgs.srv import SetCameraInfo

from .camera_source import CalibrationBySize
from .inputs import BoardObservation
from ..conversions import camera_info_from_model_msg
from ..parameters.pose_options import PoseNodeOptions
from ..runtime.endpoints import Endpoints
from ..runtime.rejections import Notice

# Delay before a calibration that could not be saved is saved again.
_RETRY_S = 60.0

# It is saved again when one of its standard deviations is below this share of the saved one.
_CLEARLY_BETTER = 2.0 / 3.0

_FILE_URL = 'file://'


class CameraInfoSetter:
    """
    Sends the calibration to the camera driver, as soon as its service is available.

    Parameters
    ----------
    logger
        The node's logger.
    endpoints
        Creates the client.
    service
        Name of the service; empty: nothing is sent.

    Raises
    ------
    ConfigError
        The name is not a valid service name.

    """

    def __init__(self, logger: Any, endpoints: Endpoints, service: str) -> None:
        self._logger, self._service = logger, service
        self._client: Any = None
        if service:
            parameter = 'set_camera_info_service'
            self._client = endpoints.client(SetCameraInfo, service, parameter=parameter)
        self._pending: CameraInfo | None = None

    def send(self, camera_info: CameraInfo) -> None:
        """Send a calibration now, or by ``send_pending`` if the service is not available."""
        self._pending = camera_info
        self.send_pending()

    def send_pending(self) -> None:
        """Send the pending calibration if there is one and the service is available."""
        if self._client is None or self._pending is None or not self._client.service_is_ready():
            return
        request = SetCameraInfo.Request(camera_info=self._pending)
        self._pending = None
        self._client.call_async(request).add_done_callback(self._on_response)

    def _on_response(self, future: Future) -> None:
        error = future.exception()
        if error is not None:
            self._logger.info(f'{self._service} failed: {printable(str(error))}')
            return
        response = future.result()
        result = 'accepted the calibration' if response.success else 'rejected the calibration'
        status = printable(response.status_message)
        detail = f': {status}' if status else ''
        self._logger.info(f'{self._service} {result}{detail}')


class CalibrationKeeper:
    """
    Loads the calibration at the start, follows it, saves it and sends it to the driver.

    Parameters
    ----------
    logger
        The node's logger.
    driver
        Receives the calibration once, as soon as the camera is calibrated.
    options
        The node's parameters at the start: path of the file, and the camera's name.

    Raises
    ------
    ConfigError
        The calibration file exists but is invalid.

    """

    def __init__(self, logger: Any, driver: CameraInfoSetter, options: PoseNodeOptions) -> None:
        self._logger, self._driver = logger, driver
        self._path = calibration_path(options.calibration_file, options.camera_name)
        self._camera_name = options.camera_name
        self._state: CalibrationState
        self._is_sent: bool
        self._saved: Calibration | None
        self._restart()
        loaded = self._load() if options.calibration_file else None
        if loaded is not None and loaded.estimate is not None:
            self._saved = loaded
        self.calibrations = CalibrationBySize(loaded)

    def follow(self, observation: BoardObservation, options: PoseNodeOptions) -> Notice | None:
        """
        After an update: log a new state; once CALIBRATED, send the calibration, and save it.

        Saving is optional, and repeated when the camera is clearly better than the saved one. If
        it fails, a notice is returned, and it is retried after a minute.
        """
        if self.calibrations.restarted:
            self._restart()
        before, self._state = self._state, self.calibrations.state
        if self._state is not before:
            estimate = self.calibrations.fused
            numbers = '' if estimate is None else f' ({_summary(estimate)})'
            self._logger.info(f'{self._state.value}{numbers}')
        if self._state is not CalibrationState.CALIBRATED:
            return None
        self._send(observation)
        return self._save_if_better() if options.save_when_calibrated else None

    def save(self) -> tuple[bool, str]:
        """Write the file; return whether it succeeded, and a line for people."""
        calibration = self._calibration()
        if calibration is None or calibration.estimate is None:
            return False, 'nothing to save: the camera has not been estimated yet'
        try:
            backup = save_calibration(self._path, calibration)
        except ConfigError as error:
            return False, str(error)
        self._saved = calibration
        text = f'saved to {printable_path(self._path)}: {_summary(calibration.estimate)}'
        if backup is not None:
            text += f'; the old file, by another program, is now {printable_path(backup)}'
        return True, text

    def save_at_end(self, options: PoseNodeOptions) -> None:
        """Save what the last views added to a calibrated camera, before the node ends."""
        is_calibrated = self.calibrations.state is CalibrationState.CALIBRATED
        saved = None if self._saved is None else self._saved.estimate
        if options.save_when_calibrated and is_calibrated and self.calibrations.fused != saved:
            self._logger.info(self.save()[1])

    def reset(self) -> None:
        """Drop the calibration, loaded or estimated, and restart without a camera."""
        self.calibrations.reset()
        self._restart()

    def _restart(self) -> None:
        self._state = CalibrationState.UNCALIBRATED
        # If the state alternates around its limit, the calibration is sent once.
        self._is_sent = False
        self._saved = None
        self._retry_s = -math.inf

    def _load(self) -> Calibration | None:
        if is_missing(self._path):
            return None
        calibration, path = load_calibration(self._path, self._camera_name), self._path
        if calibration.assumed:
            self._logger.warning(f'{printable_path(path)}: {calibration.assumed}')
        if calibration.estimate is None:
            what = 'for mode fixed only (written by another program)'
        else:
            what = _summary(calibration.estimate)
        self._logger.info(f'{printable_path(path)}: loaded: {what}')
        return calibration

    def _calibration(self) -> Calibration | None:
        estimate, size = self.calibrations.fused, self.calibrations.image_size
        if estimate is None or size is None:
            return None
        return Calibration.from_estimate(estimate, size, self._camera_name)

    def _send(self, observation: BoardObservation) -> None:
        if not self._is_sent:
            self._is_sent = True
            calibration = self._calibration()
            assert calibration is not None
            self._driver.send(
                camera_info_from_model_msg(
                    observation.header, observation.frame, calibration.model
                )
            )

    def _save_if_better(self) -> Notice | None:
        if time.monotonic() < self._retry_s or not self._is_clearly_better():
            return None
        saved, text = self.save()
        if saved:
            self._logger.info(text)
            return None
        self._retry_s = time.monotonic() + _RETRY_S
        return Notice('not_saved', f'save_when_calibrated: {text}')

    def _is_clearly_better(self) -> bool:
        """Return whether the camera is worth saving, compared with the saved one."""
        saved, fused = self._saved, self.calibrations.fused
        if saved is None or saved.estimate is None or fused is None:
            return True
        if saved.image_size != self.calibrations.image_size:
            return True
        return (
            fused.focal_sigma_px < _CLEARLY_BETTER * saved.estimate.focal_sigma_px
            or fused.projection_sigma_px < _CLEARLY_BETTER * saved.estimate.projection_sigma_px
        )


def calibration_path(calibration_file: str, camera_name: str) -> Path:
    """
    Return the path of the calibration file, with the naming rules of camera_info_manager.

    ``calibration_file`` is a path or a file:// URL; ``~``, ``${ROS_HOME}`` and ``${NAME}`` (the
    camera's name) are expanded. If it is empty, the path is camera_info_manager's default.

    Raises
    ------
    ConfigError
        It is a URL of another scheme, or begins with ~ and the name of no user.

    """
    ros_home = os.environ.get('ROS_HOME') or f'{_home()}/.ros'
    given = calibration_file or f'{ros_home}/camera_info/{camera_name}.yaml'
    path = unquote(given.removeprefix(_FILE_URL)) if given.startswith(_FILE_URL) else given
    if '://' in path:
        raise ConfigError(
            f'calibration_file: expected a path or a file:// URL, got {shown(given)}'
        )
    expanded = path.replace('${ROS_HOME}', ros_home).replace('${NAME}', camera_name)
    try:
        return Path(expanded).expanduser()
    except RuntimeError:
        raise ConfigError(
            f'calibration_file: expected a path, got {shown(given)}: ~ is unknown, set HOME'
        ) from None


def _home() -> str:
    """Return the home directory; in a container without one, that of temporary files."""
    try:
        return str(Path.home())
    except RuntimeError:
        return tempfile.gettempdir()


def _summary(estimate: CameraEstimate) -> str:
    camera = estimate.camera
    x, y = map(plus_minus, camera.center_px, estimate.center_sigma_px)
    parts = [
        f'focal length {plus_minus(camera.focal_px, estimate.focal_sigma_px)} px',
        f'centre {x}, {y} px',
        f'k {plus_minus(camera.k, estimate.k_sigma)}',
    ]
    if camera.aspect != 1.0:
        parts.append(f'fy/fx {plus_minus(camera.aspect, estimate.aspect_sigma)}')
    if not math.isnan(estimate.projection_sigma_px):
        parts.append(f'projection {estimate.projection_sigma_px:.2g} px at most where seen')
    for name, shape in estimate.board_shapes.items():
        parts.append(f'{f"board {name}".strip()} {shape_text(shape)}')
    parts.append('1 view' if estimate.views == 1 else f'{estimate.views} views')
    return ', '.join(parts)
