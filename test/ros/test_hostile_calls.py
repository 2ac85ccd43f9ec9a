# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""Invalid messages to a node in this process: each is counted, and none is fatal."""

import time

from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import PoseArray, PoseWithCovarianceStamped
import hostile
from in_process import publish
import numpy as np
from p4pfr_ros.ros.conversions import correspondences_from_cloud
from p4pfr_ros.ros.pose_node import PoseNode
from p4pfr_ros.ros.runtime.rejections import Rejected
import pytest
import rclpy
from rclpy.parameter import Parameter
from rclpy.time import Time
import scenes
from sensor_msgs.msg import CameraInfo
from visualization_msgs.msg import MarkerArray

FUZZED = 40
CALIBRATED = scenes.camera_info()
CALIBRATED.k = np.array([520.0, 0.0, 319.5, 0.0, 520.0, 239.5, 0.0, 0.0, 1.0])
CALIBRATED.distortion_model, CALIBRATED.d = 'plumb_bob', [0.0] * 5


def test_a_fuzzed_cloud_is_read_according_to_its_layout_or_rejected():
    """Compared with a reader that unpacks number by number."""
    rng = np.random.default_rng(6)
    converted, causes = 0, set()
    for _ in range(3000):
        msg = hostile.fuzzed_cloud(rng, scenes.header(1))
        points = correspondences_from_cloud(msg)
        if isinstance(points, Rejected):
            causes.add(points.cause)
            continue
        converted += 1
        read = np.hstack([points.image_points, points.board_points])
        np.testing.assert_array_equal(read, hostile.read_slowly(msg))
    assert 300 < converted < 2700
    assert causes >= {'fields', 'layout', 'truncated', 'point_count', 'not_finite', 'out_of_range'}


class NodeInProcess:
    """A pose_node in this process, with subscribers, whose callbacks are called directly."""

    def __init__(self):
        self.node, self._subscriber = PoseNode(), rclpy.create_node('subscriber')
        self.statuses = []
        topics = {
            'pose_with_covariance': PoseWithCovarianceStamped,
            'alternatives': PoseArray,
            'markers': MarkerArray,
            'camera_info': CameraInfo,
        }
        for name, message_type in topics.items():
            self._subscriber.create_subscription(
                message_type, f'/pose_node/{name}', lambda _: None, 1
            )
        self._subscriber.create_subscription(
            DiagnosticArray, '/diagnostics', self._on_diagnostics, 10
        )
        ends_s = time.monotonic() + 10.0
        names = [*(f'/pose_node/{name}' for name in topics), '/diagnostics']
        while not all(self.node.count_subscribers(name) for name in names):
            assert time.monotonic() < ends_s

    def publish(self, topic, msg):
        """Call the callback of a topic."""
        publish(self.node, topic, msg)

    def set(self, **values):
        """Set parameters; two underscores stand for a point."""
        named = [Parameter(name.replace('__', '.'), value=v) for name, v in values.items()]
        assert self.node.set_parameters_atomically(named).successful

    def counts(self):
        """Return the numbers of messages received, estimated, rejected; rejected camera_infos."""
        called = self.node.get_clock().now()
        ends_s = time.monotonic() + 10.0
        while not self.statuses or self.statuses[-1][0] < called:
            assert time.monotonic() < ends_s
            rclpy.spin_once(self.node, timeout_sec=0.02)
            rclpy.spin_once(self._subscriber, timeout_sec=0.02)
        values = self.statuses[-1][1]
        infos = int(values.get('rejected.camera_info', 0))
        rejected = sum(int(n) for name, n in values.items() if name.startswith('rejected.'))
        return np.array(
            [int(values['received']), int(values['answered']), rejected - infos, infos]
        )

    def close(self):
        """Destroy both nodes."""
        self.node.destroy_node()
        self._subscriber.destroy_node()

    def _on_diagnostics(self, msg):
        stamp = Time.from_msg(msg.header.stamp)
        self.statuses += [
            (stamp, {value.key: value.value for value in status.values})
            for status in msg.status
            if status.name == 'pose_node: pose'
        ]


@pytest.fixture(scope='module')
def running(dds):
    """Give one node for all modes."""
    running = NodeInProcess()
    yield running
    running.close()


@pytest.mark.parametrize('mode', ['self_calibrate', 'per_frame', 'fixed', 'camera_info'])
def test_fuzzed_messages_are_each_estimated_or_counted(running, mode):
    """Fuzzed camera_infos, corners and clouds in any order; valid messages are processed."""
    rng = np.random.default_rng(4)
    running.set(intrinsics__mode=mode, intrinsics__focal_px=520.0, marker__size_m=scenes.MARKER_M)
    running.set(intrinsics__k=-0.2)
    before = running.counts()
    for second in range(FUZZED):
        running.publish('camera_info', hostile.fuzzed_camera_info(rng))
        running.publish('corners', hostile.fuzzed_polygon(rng, second))
        running.publish('correspondences', hostile.fuzzed_cloud(rng, scenes.header(second)))
        # Most fuzzed camera_infos have an image without the points.
        running.publish('camera_info', CALIBRATED)
        running.publish('corners', hostile.fuzzed_polygon(rng, second))
        running.publish('correspondences', scenes.board_cloud(second))
    received, estimated, rejected, infos = running.counts() - before
    assert received == 4 * FUZZED
    assert min(estimated, rejected) > FUZZED // 4
    assert estimated + rejected == 4 * FUZZED
    assert infos > FUZZED // 8
