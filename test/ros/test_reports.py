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

"""What is said on /diagnostics and in the log of what became of messages; nobody else talks."""

import time

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from p4pfr_ros.ros.endpoints import Endpoints
from p4pfr_ros.ros.rejections import Rejected
from p4pfr_ros.ros.reports import Reports
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
