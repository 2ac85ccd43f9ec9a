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

"""
The bare transport, for comparison: a node that answers at once, with a message like pose_node's.

    python -m benchmarks.node_echo --ros-args -p qos_overrides...
"""

from __future__ import annotations

from typing import Any

from geometry_msgs.msg import PolygonStamped, PoseWithCovarianceStamped
from p4pfr_ros.ros.endpoints import advertise, subscribe
from p4pfr_ros.ros.spin import run
from rclpy.node import Node
from sensor_msgs.msg import PointCloud2


class Echo(Node):  # type: ignore[misc]
    """Hears what pose_node hears; its answer has the question's header, and nothing else."""

    def __init__(self) -> None:
        super().__init__('pose_node')
        self._answer = PoseWithCovarianceStamped()
        self._publisher = advertise(self, PoseWithCovarianceStamped, '~/pose_with_covariance')
        subscribe(self, PolygonStamped, 'corners', self._on_message)
        subscribe(self, PointCloud2, 'correspondences', self._on_message)
        self.get_logger().info('ready')

    def _on_message(self, msg: Any) -> None:
        self._answer.header = msg.header
        self._publisher.publish(self._answer)


if __name__ == '__main__':
    run(Echo)
