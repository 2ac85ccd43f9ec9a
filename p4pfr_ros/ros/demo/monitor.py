# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""Listens to the three nodes and puts together what belongs to one picture."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from geometry_msgs.msg import PoseStamped
from p4pfr_ros import Solution
from rclpy.node import Node
from rclpy.qos import QoSProfile
from rclpy.time import Time
from sensor_msgs.msg import CameraInfo, Image, PointCloud2

from .views import View
from ..conversions import (
    correspondences_from_cloud,
    division_camera_from_msg,
    image_from_msg,
    pose_from_msg,
)
from ..runtime.rejections import Rejected

_TOPICS = {
    'picture': (Image, 'image', image_from_msg),
    'true_pose': (PoseStamped, 'camera_simulator/pose_true', pose_from_msg),
    'points': (PointCloud2, 'correspondences', correspondences_from_cloud),
    'pose': (PoseStamped, 'pose_node/pose', pose_from_msg),
    'camera': (CameraInfo, 'pose_node/camera_info_division', division_camera_from_msg),
}
# Pictures that may wait for the rest of their view.
_MOST_OPEN = 50


class Monitor(Node):  # type: ignore[misc]
    """
    Calls ``on_view`` with each complete view: the messages of one stamp, converted.

    ``pictures`` counts those that came, answered or not.
    """

    def __init__(self, on_view: Callable[[View], None]) -> None:
        super().__init__('demo_monitor')
        self.pictures = 0
        self._on_view = on_view
        self._open: dict[int, dict[str, Any]] = {}
        for part, (message_type, topic, convert) in _TOPICS.items():
            self.create_subscription(
                message_type, topic, self._listener(part, convert), QoSProfile(depth=50)
            )

    def _listener(self, part: str, convert: Callable[[Any], Any]) -> Callable[[Any], None]:
        def listen(msg: Any) -> None:
            try:
                value = convert(msg)
            except ValueError as error:
                value = Rejected(part, f'{part}: {error}')
            if isinstance(value, Rejected):
                self.get_logger().error(value.reason)
                return
            self.pictures += part == 'picture'
            stamp = Time.from_msg(msg.header.stamp)
            parts = self._open.setdefault(stamp.nanoseconds, {})
            parts[part] = value
            if part == 'pose':
                now = self.get_clock().now()
                parts['latency_s'] = 1e-9 * (now.nanoseconds - stamp.nanoseconds)
            self._close(stamp.nanoseconds, parts)

        return listen

    def _close(self, stamp_ns: int, parts: dict[str, Any]) -> None:
        if parts.keys() >= _TOPICS.keys():
            del self._open[stamp_ns]
            solution = Solution(camera=parts.pop('camera'), camera_from_board=parts.pop('pose'))
            self._on_view(View(estimate=solution, **parts))
        while len(self._open) > _MOST_OPEN:
            del self._open[min(self._open)]
