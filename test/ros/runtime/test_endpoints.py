# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""QoS overrides of a node, over DDS."""

from geometry_msgs.msg import PoseStamped
import pytest
from rclpy.qos import DurabilityPolicy, QoSProfile
import scenes
from sensor_msgs.msg import CameraInfo, PointCloud2

pytestmark = pytest.mark.dds


def test_a_latched_camera_info_is_received(peer):
    """It was published once, before the node started."""
    latched = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
    info = peer.node.create_publisher(CameraInfo, 'camera_info', latched)
    info.publish(scenes.camera_info())
    override = f'qos_overrides.{peer.namespace}/camera_info.subscription'
    poses = peer.subscribe(PoseStamped, 'pose_node/pose')
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
