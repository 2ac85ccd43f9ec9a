# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""
Subscribes to the three nodes and assembles the messages of one image.

This module stands alone: it is the only node of the demo's own process.
"""

from __future__ import annotations

from collections.abc import Callable
import functools
from typing import Any

from geometry_msgs.msg import PoseStamped
from p4pfr_ros import Solution
from rclpy.node import Node
from rclpy.qos import QoSProfile
from rclpy.time import Time
from sensor_msgs.msg import CameraInfo, Image, PointCloud2

from .views import DemoView, Record
from ..conversions import (
    correspondences_from_cloud,
    division_camera_from_msg,
    image_from_msg,
    pose_from_msg,
)
from ..runtime.rejections import Rejected

_TOPICS: dict[str, tuple[type[Any], str, Callable[[Any], Any]]] = {
    'image': (Image, 'image', image_from_msg),
    'true_pose': (PoseStamped, 'camera_simulator/pose_true', pose_from_msg),
    'points': (PointCloud2, 'correspondences', correspondences_from_cloud),
    'pose': (PoseStamped, 'pose_node/pose', pose_from_msg),
    'camera': (CameraInfo, 'pose_node/camera_info_division', division_camera_from_msg),
}
# Maximum number of incomplete views.
_MAX_INCOMPLETE = 50


class Monitor(Node):  # type: ignore[misc]
    """
    Adds each complete view, all messages with one stamp, to a record.

    Parameters
    ----------
    record
        Receives the views.

    Attributes
    ----------
    image_count
        Number of images received.

    """

    def __init__(self, record: Record) -> None:
        super().__init__('demo_monitor')
        self.image_count = 0
        self._record = record
        self._incomplete: dict[int, dict[str, Any]] = {}
        for part, (message_type, topic, convert) in _TOPICS.items():
            callback = functools.partial(self._on_message, part, convert)
            self.create_subscription(message_type, topic, callback, QoSProfile(depth=50))

    def _on_message(self, part: str, convert: Callable[[Any], Any], msg: Any) -> None:
        try:
            value = convert(msg)
        except ValueError as error:
            value = Rejected(part, f'{part}: {error}')
        if isinstance(value, Rejected):
            self.get_logger().error(value.reason)
            return
        self.image_count += part == 'image'
        stamp = Time.from_msg(msg.header.stamp)
        parts = self._incomplete.setdefault(stamp.nanoseconds, {})
        parts[part] = value
        if part == 'pose':
            now = self.get_clock().now()
            parts['latency_s'] = 1e-9 * (now.nanoseconds - stamp.nanoseconds)
        self._complete(stamp.nanoseconds, parts)

    def _complete(self, stamp_ns: int, parts: dict[str, Any]) -> None:
        if parts.keys() >= _TOPICS.keys():
            del self._incomplete[stamp_ns]
            solution = Solution(camera=parts.pop('camera'), camera_from_board=parts.pop('pose'))
            self._record.add(DemoView(estimate=solution, **parts))
        while len(self._incomplete) > _MAX_INCOMPLETE:
            del self._incomplete[min(self._incomplete)]
