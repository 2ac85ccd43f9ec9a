# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""What nobody should send, to a node in this process: no message is lost, and none is fatal."""

import time

from geometry_msgs.msg import PoseArray, PoseWithCovarianceStamped
import hostile
import numpy as np
from p4pfr_ros.ros.conversions import correspondences_from_cloud
from p4pfr_ros.ros.pose_node import PoseNode
from p4pfr_ros.ros.runtime.rejections import Rejected
import pytest
import rclpy
from rclpy.parameter import Parameter
import scenes
from sensor_msgs.msg import CameraInfo
from visualization_msgs.msg import MarkerArray

FUZZED = 40
CALIBRATED = scenes.camera_info()
CALIBRATED.k = np.array([520.0, 0.0, 319.5, 0.0, 520.0, 239.5, 0.0, 0.0, 1.0])
CALIBRATED.distortion_model, CALIBRATED.d = 'plumb_bob', [0.0] * 5


def test_a_fuzzed_cloud_is_read_as_it_is_written_or_rejected():
    """Whatever the layout says is what is read: number by number, the slow way."""
    rng = np.random.default_rng(6)
    answered, causes = 0, set()
    for _ in range(3000):
        msg = hostile.fuzzed_cloud(rng, scenes.header(1))
        points = correspondences_from_cloud(msg)
        if isinstance(points, Rejected):
            causes.add(points.cause)
            continue
        answered += 1
        read = np.hstack([points.image_points, points.board_points])
        np.testing.assert_array_equal(read, hostile.read_slowly(msg))
    assert 300 < answered < 2700
    assert causes >= {'fields', 'layout', 'truncated', 'point_count', 'not_finite', 'out_of_range'}


class Victim:
    """A pose_node in this process, whose answers are heard, and which is told by plain calls."""

    def __init__(self):
        self.node, self._ears = PoseNode(), rclpy.create_node('ears')
        topics = {
            'pose_with_covariance': PoseWithCovarianceStamped,
            'alternatives': PoseArray,
            'markers': MarkerArray,
            'camera_info': CameraInfo,
        }
        for name, message_type in topics.items():
            self._ears.create_subscription(message_type, f'/pose_node/{name}', lambda _: None, 1)
        ends_s = time.monotonic() + 10.0
        while not all(self.node.count_subscribers(f'/pose_node/{name}') for name in topics):
            assert time.monotonic() < ends_s
        work = self.node._work
        self.on_camera_info = work._answering.on_camera_info
        self.inputs, self.health = work._inputs, work._reports._health

    def set(self, **values):
        """Set parameters; two underscores stand for the point."""
        named = [Parameter(name.replace('__', '.'), value=v) for name, v in values.items()]
        assert self.node.set_parameters_atomically(named).successful

    def close(self):
        """Take it down."""
        self.node.destroy_node()
        self._ears.destroy_node()


@pytest.fixture(scope='module')
def victim(dds):
    """One for all modes."""
    victim = Victim()
    yield victim
    victim.close()


@pytest.mark.parametrize('mode', ['self_calibrate', 'per_frame', 'fixed', 'camera_info'])
def test_fuzzed_camera_infos_corners_and_clouds_are_each_answered_or_counted(victim, mode):
    """In any order; afterwards the node is as well as before."""
    rng, health = np.random.default_rng(4), victim.health
    victim.set(intrinsics__mode=mode, intrinsics__focal_px=520.0, marker__size_m=scenes.MARKER_M)
    victim.set(intrinsics__k=-0.2)
    received, before = health.received_count, (health.answered_count, _of_corners(health))
    for second in range(FUZZED):
        victim.on_camera_info(hostile.fuzzed_camera_info(rng))
        victim.inputs.on_corners(hostile.fuzzed_polygon(rng, second))
        victim.inputs.on_correspondences(hostile.fuzzed_cloud(rng, scenes.header(second)))
        # Most of the above leaves a picture in which nothing can be.
        victim.on_camera_info(CALIBRATED)
        victim.inputs.on_corners(hostile.fuzzed_polygon(rng, second))
        victim.inputs.on_correspondences(scenes.board_cloud(second))
    assert health.received_count - received == 4 * FUZZED
    new = health.answered_count - before[0], _of_corners(health) - before[1]
    assert min(new) > FUZZED // 4
    assert sum(new) == 4 * FUZZED
    assert health.rejections['camera_info'] > FUZZED // 8


def _of_corners(health):
    return health.rejections.total() - health.rejections['camera_info']
