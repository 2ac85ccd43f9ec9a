# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""
The real demo.launch.py, started by launch_testing; needs a ROS installation (.ci/jazzy).

    launch_test .ci/demo.launch_test.py
"""

import unittest

from ament_index_python.packages import get_package_share_directory
from geometry_msgs.msg import PoseStamped
from launch import LaunchDescription
from launch.actions import IncludeLaunchDescription
from launch.launch_description_sources import PythonLaunchDescriptionSource
import launch_testing
from launch_testing.actions import ReadyToTest
from launch_testing.asserts import assertExitCodes
import rclpy
from sensor_msgs.msg import CameraInfo

TIMEOUT_S = 300.0


def generate_test_description():
    """Start the demo."""
    path = f'{get_package_share_directory("p4pfr_ros")}/launch/demo.launch.py'
    demo = IncludeLaunchDescription(PythonLaunchDescriptionSource(path))
    return LaunchDescription([demo, ReadyToTest()])


class TestDemo(unittest.TestCase):
    """While it runs."""

    def setUp(self):
        """Create a node that listens."""
        rclpy.init()
        self.node = rclpy.create_node('listener')

    def tearDown(self):
        """Stop it."""
        self.node.destroy_node()
        rclpy.shutdown()

    def test_poses_and_a_camera_are_published(self):
        """The whole chain works, from the simulated image to the pose."""
        poses, cameras = [], []
        self.node.create_subscription(PoseStamped, '/pose_node/pose', poses.append, 10)
        self.node.create_subscription(CameraInfo, '/pose_node/camera_info', cameras.append, 10)
        clock = self.node.get_clock()
        ends = clock.now().nanoseconds + TIMEOUT_S * 1e9
        while not (len(poses) >= 5 and any(camera.k[0] > 0.0 for camera in cameras)):
            assert clock.now().nanoseconds < ends, f'{len(poses)} poses'
            rclpy.spin_once(self.node, timeout_sec=0.1)
        assert poses[0].header.frame_id == 'camera_optical_frame'
        assert poses[0].pose.position.z > 0.0


@launch_testing.post_shutdown_test()
class TestAfterwards(unittest.TestCase):
    """After it was stopped."""

    def test_all_nodes_exit_cleanly(self, proc_info):
        """Without an error."""
        assertExitCodes(proc_info)
