# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""
A camera driver for the benchmark of the chain: publishes rendered images at a constant rate.

    python -m benchmarks.node_camera --ros-args -p board_file:=FILE -p width_px:=640 ...

The images are rendered before the first one is published, and stamped with the steady clock when
they are published.
"""

from __future__ import annotations

import time

from p4pfr_ros import DivisionCamera
from p4pfr_ros.files.boards import load_board
from p4pfr_ros.rendering import Renderer
from p4pfr_ros.ros.conversions import image_msg
from p4pfr_ros.ros.runtime.endpoints import advertise
from p4pfr_ros.ros.runtime.spin import run
from p4pfr_ros.scenes.board_path import SimulatedPath
from rclpy.clock import Clock, ClockType
from rclpy.node import Node
from sensor_msgs.msg import Image
from std_msgs.msg import Header

# Images of five seconds, shown forwards and backwards.
_IMAGES = 150
_IMAGE_RATE_HZ = 30.0
_NS = 1_000_000_000


class Camera(Node):  # type: ignore[misc]
    """Publishes mono8 images, reliably, as most drivers do."""

    def __init__(self) -> None:
        super().__init__('camera')
        self.declare_parameter('board_file', '')
        self.declare_parameter('width_px', 640)
        self.declare_parameter('height_px', 480)
        self.declare_parameter('rate_hz', 30.0)
        self._images = self._rendered()
        self._count = 0
        self._publisher = advertise(self, Image, 'image')
        steady = Clock(clock_type=ClockType.STEADY_TIME)
        period_s = 1.0 / self.get_parameter('rate_hz').value
        self.create_timer(period_s, self._publish, clock=steady)
        self.get_logger().info('ready')

    def _rendered(self) -> list[Image]:
        board = load_board(self.get_parameter('board_file').value)
        size = self.get_parameter('width_px').value, self.get_parameter('height_px').value
        camera = DivisionCamera(0.8 * size[0], (0.51 * size[0], 0.48 * size[1]), -0.25)
        renderer, path = Renderer(camera, size), SimulatedPath(board, size, 0)
        header = Header(frame_id='camera_optical_frame')
        poses = [path.at(i / _IMAGE_RATE_HZ, camera) for i in range(_IMAGES)]
        forwards = [
            image_msg(
                header, renderer.render(board, pose, blur_sigma_px=0.7, noise_sigma=2.0, seed=i)
            )
            for i, pose in enumerate(poses)
        ]
        return forwards + forwards[::-1]

    def _publish(self) -> None:
        msg = self._images[self._count % len(self._images)]
        msg.header.stamp.sec, msg.header.stamp.nanosec = divmod(time.monotonic_ns(), _NS)
        self._publisher.publish(msg)
        self._count += 1


if __name__ == '__main__':
    run(Camera)
