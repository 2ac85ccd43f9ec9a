# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""dashboard_node: calibrates the camera of a topic in front of a web page."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import partial
import time
from typing import Any

import cv2
from p4pfr_ros import CameraEstimate
from p4pfr_ros.files.yaml_fields import ConfigError
from p4pfr_ros.kernels.warm_up import warm_up, warm_up_detection
from p4pfr_ros.live.session import LiveSession, SourceState
from rclpy.node import Node
from rclpy.parameter import Parameter
from std_msgs.msg import Header
from std_srvs.srv import Trigger

from .conversions import camera_info_from_model_msg, ImageFrame
from .parameters.board_file import required_boards
from .parameters.dashboard_options import DashboardNodeOptions
from .parameters.declare import Parameters
from .pose.calibration_keeper import calibration_path, CameraInfoSetter
from .runtime.endpoints import Endpoints
from .runtime.image_stream import ImageMessage, ImageStream
from .runtime.kernel_start import KernelStart
from .runtime.rejections import Rejected
from .runtime.spin import run

# Period of checks whether the camera was saved.
_PERIOD_S = 1.0


class DashboardNode(Node):  # type: ignore[misc]
    """
    Detects boards in each image, calibrates the camera, and shows both in a web page.

    Parameters
    ----------
    **node_options
        Options of rclpy's Node, such as ``parameter_overrides``.

    """

    def __init__(self, **node_options: Any) -> None:
        super().__init__('dashboard_node', **node_options)
        self._config = Parameters(self, DashboardNodeOptions())
        options = self._config.options
        cv2.setNumThreads(options.opencv_threads)
        self._session = LiveSession(
            required_boards(self.get_name(), options.board_file),
            calibration_path(options.calibration_file, options.camera_name),
            options.camera_name,
            options=options.calibration,
            robust=options.robust,
        )
        self._endpoints = Endpoints(self)
        self._driver = CameraInfoSetter(
            self.get_logger(), self._endpoints, options.set_camera_info_service
        )
        self._sent: CameraEstimate | None = None
        self._header = Header()
        self._server = self._make_server()
        kernels = KernelStart(self, _warm_up)  # no image waits for the compiler
        self._images = ImageStream(self, options.image, kernels, self._on_image)
        self._session.set_source(SourceState.WAITING, self._images.topic)
        self._endpoints.serve(Trigger, '~/save_calibration', self._on_save)
        self._endpoints.serve(Trigger, '~/reset_calibration', self._on_reset)
        self._endpoints.every(_PERIOD_S, self._send_saved)
        self._server.start()
        kernels.when_ready(lambda: self.get_logger().info(f'ready: open {self._server.url}'))

    def _make_server(self) -> Any:
        try:
            from p4pfr_ros.live.server import LiveServer
        except ModuleNotFoundError as error:
            if error.name != 'aiohttp':
                raise
            raise ConfigError(
                f'{self.get_name()} needs aiohttp: install python3-aiohttp, or in the environment '
                'of Python pip install aiohttp'
            ) from None
        options = self._config.options
        return LiveServer(self._session, options.host, options.port, options.token)

    def destroy_node(self) -> None:
        """Stop the web server, and destroy the node."""
        self._server.stop()
        super().destroy_node()

    def _on_image(self, msg: ImageMessage) -> None:
        began_s, self._header = time.monotonic(), msg.header
        if self._session.snapshot.source is not SourceState.RUNNING:
            self._session.set_source(SourceState.RUNNING, self._images.topic)
        options = self._config.options
        image = self._images.decoded(msg, options.image, as_grey=False)
        name = f'stamp {msg.header.stamp.sec}.{msg.header.stamp.nanosec:09d}'
        if isinstance(image, Rejected):
            self._session.reject(image.reason, name)
            return
        self._session.set_options(options.calibration, options.robust)
        self._session.process(image, name)
        detected = any(not each.detection.reason for each in self._session.snapshot.boards)
        self._images.processed(began_s, detected=detected)

    def _send_saved(self) -> None:
        """Send a camera that was saved to the driver."""
        saved = self._session.saved
        if saved is not None and saved.estimate is not self._sent:
            self._sent = saved.estimate
            frame = ImageFrame(saved.image_size)
            self._driver.send(camera_info_from_model_msg(self._header, frame, saved.model))
        self._driver.send_pending()

    def _on_save(self, _: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        response.success, response.message = self._session.save()
        return response

    def _on_reset(self, _: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        self._session.reset()
        response.success, response.message = True, 'the calibration restarts'
        return response


def _warm_up() -> None:
    warm_up()
    warm_up_detection()


def main(args: Sequence[str] | None = None, parameters: Mapping[str, Any] | None = None) -> None:
    """Run dashboard_node until SIGINT or SIGTERM, with values of parameters by name."""
    given = [Parameter(name, value=value) for name, value in (parameters or {}).items()]
    run(partial(DashboardNode, parameter_overrides=given), args)


if __name__ == '__main__':
    main()
