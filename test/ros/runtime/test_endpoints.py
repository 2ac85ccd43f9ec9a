# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""What a node hears and says can be tuned from outside, by ROS's own parameters."""

from geometry_msgs.msg import PoseStamped
import pytest
from rclpy.qos import DurabilityPolicy, QoSProfile
import scenes
from sensor_msgs.msg import CameraInfo, PointCloud2

pytestmark = pytest.mark.dds


def test_a_camera_info_that_was_said_once_is_heard(peer):
    """A latched topic: published before the node was there, and never again."""
    latched = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
    info = peer.node.create_publisher(CameraInfo, 'camera_info', latched)
    info.publish(scenes.camera_info())
    override = f'qos_overrides.{peer.namespace}/camera_info.subscription'
    poses = peer.listen(PoseStamped, 'pose_node/pose')
    cloud = peer.publisher(PointCloud2, 'correspondences')
    misspelt = f'{override}.depht'
    node = peer.start(
        'pose_node',
        parameters={
            f'{override}.durability': 'transient_local',
            f'{override}.reliability': 'reliable',
            misspelt: 9,
        },
    )
    peer.until(lambda: poses, meanwhile=lambda: cloud.publish(scenes.board_cloud(1)))
    hint = f'(did you mean {override}.depth?)'
    assert node.output.count('unknown parameter') == 1
    assert f'unknown parameter {misspelt} is ignored {hint}' in node.output
