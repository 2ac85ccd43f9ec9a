# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""The services that pose_node offers, and the one that it calls."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from rclpy.node import Node
from rclpy.parameter import Parameter
from rclpy.task import Future
from sensor_msgs.msg import CameraInfo
from sensor_msgs.srv import SetCameraInfo
from std_srvs.srv import SetBool, Trigger

from ..runtime.endpoints import Endpoints


class Services:
    """
    ``~/set_enabled``, ``~/save_calibration`` and ``~/reset_calibration``.

    Parameters
    ----------
    node
        Whose parameter ``enabled`` is changed.
    endpoints
        Makes and takes down.
    save
        Returns whether it went well, and a line for people.
    reset
        Starts the calibration over.

    """

    def __init__(
        self,
        node: Node,
        endpoints: Endpoints,
        save: Callable[[], tuple[bool, str]],
        reset: Callable[[], object],
    ) -> None:
        self._node, self._save, self._reset = node, save, reset
        endpoints.serve(SetBool, '~/set_enabled', self._on_set_enabled)
        endpoints.serve(Trigger, '~/save_calibration', self._on_save)
        endpoints.serve(Trigger, '~/reset_calibration', self._on_reset)

    def _on_set_enabled(
        self, request: SetBool.Request, response: SetBool.Response
    ) -> SetBool.Response:
        # The parameter says the same as the service, whoever has changed it.
        [result] = self._node.set_parameters([Parameter('enabled', value=request.data)])
        response.success = result.successful
        response.message = result.reason or ('enabled' if request.data else 'disabled')
        return response

    def _on_save(self, _: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        response.success, response.message = self._save()
        return response

    def _on_reset(self, _: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        self._reset()
        response.success, response.message = True, 'the calibration starts over'
        return response


class CameraInfoSetter:
    """
    Tells the camera's driver of its calibration, as soon as the driver can be told.

    Parameters
    ----------
    endpoints
        Makes and takes down.
    service
        The name of its service; empty: nobody is told.
    say
        Takes a line for people.

    Raises
    ------
    ConfigError
        No service can have that name.

    """

    def __init__(self, endpoints: Endpoints, service: str, say: Callable[[str], object]) -> None:
        self._client: Any = None
        if service:
            parameter = 'set_camera_info_service'
            self._client = endpoints.client(SetCameraInfo, service, parameter=parameter)
        self._service, self._say = service, say
        self._to_tell: CameraInfo | None = None

    def tell(self, camera_info: CameraInfo) -> None:
        """Have the driver told, now or when its service is there."""
        self._to_tell = camera_info
        self.try_again()

    def try_again(self) -> None:
        """Tell what there is to tell, if the service is there."""
        if self._client is None or self._to_tell is None or not self._client.service_is_ready():
            return
        request = SetCameraInfo.Request(camera_info=self._to_tell)
        self._to_tell = None
        self._client.call_async(request).add_done_callback(self._on_answer)

    def _on_answer(self, future: Future) -> None:
        error = future.exception()
        if error is not None:
            self._say(f'{self._service} failed: {error}')
            return
        response = future.result()
        verdict = 'took the calibration' if response.success else 'refused the calibration'
        said = f': {response.status_message}' if response.status_message else ''
        self._say(f'{self._service} {verdict}{said}')
