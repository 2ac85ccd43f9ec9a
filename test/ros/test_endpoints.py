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
