# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""Tells people what becomes of pose_node's messages: in the log, and on /diagnostics."""

from __future__ import annotations

import time

from diagnostic_msgs.msg import DiagnosticArray
from p4pfr_ros import PoseEstimate
from p4pfr_ros.core.cameras.camera_info import CameraInfoModel
from rclpy.node import Node

from .health import Health
from .self_calibrating import SelfCalibrating
from ..conversions.diagnostics import diagnostics_msg
from ..runtime.endpoints import Endpoints
from ..runtime.rejections import Rejected, Rejections


class Reports:
    """
    Hears of everything, says what matters.

    Parameters
    ----------
    node
        Whose log and health it is.
    endpoints
        Makes and takes down.
    camera_name
        The hardware's id on /diagnostics.

    """

    def __init__(self, node: Node, endpoints: Endpoints, camera_name: str) -> None:
        self._node, self._camera_name = node, camera_name
        # To rclpy, a place in the code has one severity for good.
        self._rejections = Rejections(lambda text: node.get_logger().warning(text))
        self._remarks = Rejections(lambda text: node.get_logger().warning(text))
        self._health = Health(time.monotonic())
        self._publisher = endpoints.advertise(DiagnosticArray, '/diagnostics')

    def received(self, received_s: float) -> None:
        """Take note of a message with corners, by the steady clock."""
        self._health.received(received_s)

    def reject(self, rejected: Rejected) -> None:
        """Take note of a message, or a part of one, that has no answer."""
        self._rejections.add(rejected)
        self._health.rejected(time.monotonic(), rejected)

    def remark(self, remark: Rejected | None) -> None:
        """Say what people should know of a message that is answered all the same."""
        if remark is not None:
            self._remarks.add(remark)
            self._health.remarked(time.monotonic(), remark)

    def answered(self, stamp_ns: int, estimate: PoseEstimate, received_s: float) -> None:
        """Take note of an answer that has been published, or of why there is none."""
        if estimate.model is None:
            self.reject(Rejected(estimate.status.name.lower(), estimate.status.value))
            return
        now_s = time.monotonic()
        age_s = 1e-9 * (self._node.get_clock().now().nanoseconds - stamp_ns)
        self._health.answered(now_s, estimate, now_s - received_s, age_s)
        unseen = estimate.observable.undetermined
        if unseen:
            what = ', '.join(unseen)
            text = f'a view does not tell: {what} (tilt the board, bring it nearer)'
            self.remark(Rejected('not_observable', text))

    def calibrated(self, found: SelfCalibrating | None, *, restarted: bool = False) -> None:
        """Take note of how far the calibration has come; None: the mode is another."""
        fused = None if found is None else found.fused
        state = '' if found is None else found.state.value
        views = 0 if fused is None else fused.views
        self._health.calibrated(time.monotonic(), state, views, fused, restarted)

    def published(self, model: CameraInfoModel | None) -> None:
        """Take note of the model that the camera was published in, if it was."""
        if model is not None:
            self._health.camera_info(model.distortion_model, model.residual_px)

    def publish(self, *, enabled: bool) -> None:
        """Publish the health if a second has passed, or something has changed."""
        self._health.enabled = enabled
        now_s = time.monotonic()
        if self._health.due(now_s):
            status = self._health.status(now_s)
            name = f'{self._node.get_fully_qualified_name()[1:]}: pose'
            stamp = self._node.get_clock().now().to_msg()
            self._publisher.publish(diagnostics_msg(stamp, name, self._camera_name, status))
