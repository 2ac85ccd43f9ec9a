# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""
The echo node, for comparison: replies immediately, with the message type of pose_node.

    python -m benchmarks.node_echo --ros-args -p qos_overrides...
"""

from __future__ import annotations

from typing import Any

from geometry_msgs.msg import PolygonStamped, PoseWithCovarianceStamped
from p4pfr_ros.ros.runtime.endpoints import advertise, subscribe
from p4pfr_ros.ros.runtime.spin import run
from rclpy.node import Node
from sensor_msgs.msg import PointCloud2


class Echo(Node):  # type: ignore[misc]
    """Subscribes to the topics of pose_node; replies with a pose that has only the header set."""

    def __init__(self) -> None:
        super().__init__('pose_node')
        self._reply = PoseWithCovarianceStamped()
        self._publisher = advertise(self, PoseWithCovarianceStamped, '~/pose_with_covariance')
        subscribe(self, PolygonStamped, 'corners', self._on_message)
        subscribe(self, PointCloud2, 'correspondences', self._on_message)
        self.get_logger().info('ready')

    def _on_message(self, msg: Any) -> None:
        self._reply.header = msg.header
        self._publisher.publish(self._reply)


if __name__ == '__main__':
    run(Echo)
