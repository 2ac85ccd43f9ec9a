# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""
The services of pose_node.

This module stands alone: services are not on the path of a message, which ``pipeline`` shows.
"""

from __future__ import annotations

from rclpy.node import Node
from rclpy.parameter import Parameter
from std_srvs.srv import SetBool, Trigger

from .calibration_keeper import CalibrationKeeper
from .health import HealthReporter
from .outputs import Outputs
from ..runtime.endpoints import Endpoints


class Services:
    """
    ``~/set_enabled``, ``~/save_calibration`` and ``~/reset_calibration``.

    Parameters
    ----------
    node
        The node with the parameter ``enabled``.
    endpoints
        Creates the services.
    keeper
        Saves and resets the calibration.
    outputs, reporter
        Publish that the camera is unknown after a reset.

    """

    def __init__(
        self,
        node: Node,
        endpoints: Endpoints,
        keeper: CalibrationKeeper,
        outputs: Outputs,
        reporter: HealthReporter,
    ) -> None:
        self._node, self._keeper = node, keeper
        self._outputs, self._reporter = outputs, reporter
        endpoints.serve(SetBool, '~/set_enabled', self._on_set_enabled)
        endpoints.serve(Trigger, '~/save_calibration', self._on_save)
        endpoints.serve(Trigger, '~/reset_calibration', self._on_reset)

    def _on_set_enabled(
        self, request: SetBool.Request, response: SetBool.Response
    ) -> SetBool.Response:
        # Set through the parameter, so that both always agree.
        [result] = self._node.set_parameters([Parameter('enabled', value=request.data)])
        response.success = result.successful
        response.message = result.reason or ('enabled' if request.data else 'disabled')
        return response

    def _on_save(self, _: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        response.success, response.message = self._keeper.save()
        return response

    def _on_reset(self, _: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        self._keeper.reset()
        self._outputs.retract_camera(self._node.get_clock().now().to_msg())
        self._reporter.calibrated(self._keeper.calibrations)
        response.success, response.message = True, 'calibration reset'
        return response
