# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""Events of a node on /diagnostics."""

import time

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from p4pfr_ros import CalibrationOptions, EstimateOptions
from p4pfr_ros.ros.pose.camera_source import CalibrationBySize
from p4pfr_ros.ros.pose.health import HealthReporter
from p4pfr_ros.ros.runtime.endpoints import Endpoints
from p4pfr_ros.ros.runtime.rejections import Notice, Rejected
import pytest
import rclpy


class Reported:
    """A reporter, and the messages that it publishes on /diagnostics."""

    def __init__(self, name):
        self.node = rclpy.create_node(name)
        self.reporter = HealthReporter(self.node, Endpoints(self.node), 'front')
        self._received = []
        self.node.create_subscription(DiagnosticArray, '/diagnostics', self._received.append, 10)
        self._name = f'{name}: pose'

    def status(self):
        """Publish until a status of the node is received; return the latest."""
        self._received.clear()
        ends_s = time.monotonic() + 20.0
        while time.monotonic() < ends_s:
            self.reporter.publish(enabled=True)
            rclpy.spin_once(self.node, timeout_sec=0.02)
            ours = [s for array in self._received for s in array.status if s.name == self._name]
            if ours:
                return ours[-1]
        raise AssertionError('timeout')


@pytest.fixture
def reported(dds):
    """Give the reporter of a node."""
    reported = Reported('with_reporter')
    yield reported
    reported.node.destroy_node()


def test_a_changed_camera_is_on_diagnostics(reported):
    """It is a warning; the camera's name is the hardware_id."""
    reported.reporter.received(time.monotonic())
    calibrations = CalibrationBySize()
    for width in (640, 641):
        calibrations.select((width, 480), EstimateOptions(), CalibrationOptions())
    assert calibrations.restarted
    reported.reporter.calibrated(calibrations)
    status = reported.status()
    assert status.level == DiagnosticStatus.WARN
    assert 'the camera has changed' in status.message
    assert status.hardware_id == 'front'


def test_a_calibration_that_was_not_saved_is_on_diagnostics(reported):
    """Together with a rejection."""
    reported.reporter.received(time.monotonic())
    reported.reporter.warn(Notice('not_saved', 'the disk is full'))
    reported.reporter.reject(Rejected('fields', 'expected others'))
    status = reported.status()
    assert status.level == DiagnosticStatus.WARN
    assert 'not_saved: the disk is full' in status.message
    assert 'rejected (fields): expected others' in status.message
