# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""camera_simulator: images of a moving board with its true pose, without hardware."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from geometry_msgs.msg import PoseStamped
import numpy as np
from numpy.typing import NDArray
from p4pfr_ros import DivisionCamera, Pose
from p4pfr_ros.rendering import Renderer
from p4pfr_ros.scenes.board_path import SimulatedPath
from rclpy.node import Node
from sensor_msgs.msg import CameraInfo, Image
from std_msgs.msg import Header

from .conversions import camera_info_msg, image_msg, ImageFrame, pose_msg
from .parameters.board_file import required_board
from .parameters.declare import Parameters
from .parameters.image_node_options import CameraSimulatorOptions
from .runtime.endpoints import advertise, has_subscribers
from .runtime.rejections import CauseLog, Rejected
from .runtime.spin import run


class CameraSimulator(Node):  # type: ignore[misc]
    """
    Renders a board on a known path through a camera with a known lens.

    Image, camera_info and true pose of one instant have the same stamp. The camera_info is that
    of an uncalibrated camera: image size, and K = 0. Without a subscriber no image is rendered,
    but the board keeps moving.

    Parameters
    ----------
    **node_options
        Options of rclpy's Node, such as ``parameter_overrides``.

    """

    def __init__(self, **node_options: Any) -> None:
        super().__init__('camera_simulator', **node_options)
        self._config = Parameters(self, CameraSimulatorOptions())
        options = self._config.options
        self._board = required_board(self.get_name(), options.board_file)
        self._frame = ImageFrame((options.camera.width_px, options.camera.height_px))
        self._path = SimulatedPath(self._board, self._frame.size, options.path.seed)
        self._renderer = self._make_renderer()
        self._misses = CauseLog(self.get_logger())
        self._count = 0
        self._path_time_s = 0.0
        self._image = advertise(self, Image, 'image')
        self._camera_info = advertise(self, CameraInfo, 'camera_info')
        self._pose_true = advertise(self, PoseStamped, '~/pose_true')
        self.create_timer(1.0 / options.rate_hz, self._publish_image)
        self.get_logger().info('ready')

    def _make_renderer(self) -> Renderer:
        width, height = self._frame.size
        lens = self._config.options.camera
        center_px = (0.5 * (width - 1), 0.5 * (height - 1))
        camera = DivisionCamera(lens.focal_px, center_px, lens.k)
        return Renderer(camera, self._frame.size)

    def _publish_image(self) -> None:
        options = self._config.options
        lens = options.camera
        if (lens.focal_px, lens.k) != (self._renderer.camera.focal_px, self._renderer.camera.k):
            self._renderer = self._make_renderer()
        try:
            pose = self._path.at(self._path_time_s, self._renderer.camera)
        except ValueError:
            self._misses.add(
                Rejected('no_board', 'the whole board is not visible with this lens: no image')
            )
            return
        # Rendering is almost all of the work, so it needs a subscriber. It takes longer than an
        # exposure, so the stamp is the time when the image is ready.
        image = self._rendered(pose) if has_subscribers(self._image) else None
        header = Header(stamp=self.get_clock().now().to_msg(), frame_id=lens.frame_id)
        self._camera_info.publish(camera_info_msg(header, self._frame))
        self._pose_true.publish(pose_msg(header, pose))
        if image is not None:
            self._image.publish(image_msg(header, image))
        self._count += 1
        self._path_time_s += options.path.speed / options.rate_hz

    def _rendered(self, pose: Pose) -> NDArray[np.uint8]:
        lens = self._config.options.camera
        return self._renderer.render(
            self._board,
            pose,
            blur_sigma_px=lens.blur_sigma_px,
            noise_sigma=lens.noise_sigma,
            seed=self._count,
        )


def main(args: Sequence[str] | None = None) -> None:
    """Run camera_simulator until SIGINT or SIGTERM."""
    run(CameraSimulator, args)


if __name__ == '__main__':
    main()
