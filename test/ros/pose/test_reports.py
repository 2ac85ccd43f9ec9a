# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""What is said on /diagnostics and in the log of what became of messages; nobody else talks."""

import time

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from p4pfr_ros.ros.pose.reports import Reports
from p4pfr_ros.ros.runtime.endpoints import Endpoints
from p4pfr_ros.ros.runtime.rejections import Rejected
import pytest
import rclpy


class Told:
    """Reports of a node, and what it says on /diagnostics."""

    def __init__(self, name):
        self.node = rclpy.create_node(name)
        self.reports = Reports(self.node, Endpoints(self.node), 'front')
        self._heard = []
        self.node.create_subscription(DiagnosticArray, '/diagnostics', self._heard.append, 10)
        self._name = f'{name}: pose'

    def status(self):
        """Publish until it is heard; return the latest."""
        self._heard.clear()
        ends_s = time.monotonic() + 20.0
        while time.monotonic() < ends_s:
            self.reports.publish(enabled=True)
            rclpy.spin_once(self.node, timeout_sec=0.02)
            ours = [s for array in self._heard for s in array.status if s.name == self._name]
            if ours:
                return ours[-1]
        raise AssertionError('waited in vain')


@pytest.fixture
def told(dds):
    """Give reports of a node that nobody talks to."""
    told = Told('with_reports')
    yield told
    told.node.destroy_node()


def test_a_camera_that_has_changed_is_on_diagnostics(told):
    """It is a warning, whatever else is well; the camera's name is the hardware's."""
    told.reports.received(time.monotonic())
    told.reports.calibrated(None, restarted=True)
    status = told.status()
    assert status.level == DiagnosticStatus.WARN
    assert 'the camera has changed' in status.message
    assert status.hardware_id == 'front'


def test_a_calibration_that_was_not_saved_is_on_diagnostics(told):
    """And what is rejected stands beside it."""
    told.reports.received(time.monotonic())
    told.reports.remark(None)
    told.reports.remark(Rejected('not_saved', 'the disk is full'))
    told.reports.reject(Rejected('fields', 'expected others'))
    status = told.status()
    assert status.level == DiagnosticStatus.WARN
    assert 'not_saved: the disk is full' in status.message
    assert 'rejected, fields: expected others' in status.message
