# SPDX-License-Identifier: Apache-2.0
"""pose_node: corners of a marker or board in, pose and camera out."""

from __future__ import annotations

from collections.abc import Sequence

from geometry_msgs.msg import PolygonStamped, PoseStamped, PoseWithCovarianceStamped
from p4pfr_ros import estimate_pose, PoseEstimate
from rclpy.node import Node
from sensor_msgs.msg import CameraInfo, PointCloud2
from std_msgs.msg import Header

from .conversions import (
    camera_info_division_msg,
    Correspondences,
    correspondences_from_cloud,
    correspondences_from_polygon,
    image_frame_from_msg,
    ImageFrame,
    pose_msg,
    pose_with_covariance_msg,
)
from .endpoints import advertise, is_heard, subscribe
from .options import PoseNodeOptions
from .parameters import Parameters
from .rejections import Rejected, Rejections
from .spin import run
from .warm_up import warm_up

_NO_SIZE = Rejected(
    'no_image_size',
    'the size of the picture is not known: publish camera_info (its K may be 0) or set the '
    'parameters image.width_px and image.height_px',
)


class PoseNode(Node):  # type: ignore[misc]
    """
    Estimates, for each view of a marker or board, its pose, the focal length and the distortion.

    Header, stamp and frame of an answer are those of the message that it answers.
    """

    def __init__(self) -> None:
        super().__init__('pose_node')
        self._config = Parameters(self, PoseNodeOptions())
        self._rejections = Rejections(lambda text: self.get_logger().warning(text))
        self._frame: ImageFrame | None = None
        self._pose = advertise(self, PoseStamped, '~/pose')
        self._pose_with_covariance = advertise(
            self, PoseWithCovarianceStamped, '~/pose_with_covariance'
        )
        self._camera_info = advertise(self, CameraInfo, '~/camera_info_division')
        # Nobody's first message shall wait for the compiler.
        warm_up()
        subscribe(self, CameraInfo, 'camera_info', self._on_camera_info)
        subscribe(self, PolygonStamped, 'corners', self._on_corners)
        subscribe(self, PointCloud2, 'correspondences', self._on_correspondences)
        self.get_logger().info('ready')

    def _on_camera_info(self, msg: CameraInfo) -> None:
        frame = image_frame_from_msg(msg)
        if isinstance(frame, Rejected):
            self._rejections.add(frame)
        else:
            self._frame = frame

    def _on_corners(self, msg: PolygonStamped) -> None:
        marker = self._config.options.marker
        points = correspondences_from_polygon(msg, marker.size_m, marker.corner_order)
        self._answer(msg.header, points)

    def _on_correspondences(self, msg: PointCloud2) -> None:
        self._answer(msg.header, correspondences_from_cloud(msg))

    def _answer(self, header: Header, points: Correspondences | Rejected) -> None:
        frame = self._image_frame()
        if isinstance(points, Rejected):
            self._rejections.add(points)
        elif frame is None:
            self._rejections.add(_NO_SIZE)
        elif is_heard(self._pose, self._pose_with_covariance, self._camera_info):
            estimate = estimate_pose(
                frame.full_from_sent(points.image_points),
                points.board_points,
                image_size=frame.size,
                options=self._config.options.robust.ransac(),
            )
            self._publish(header, frame, estimate)

    def _image_frame(self) -> ImageFrame | None:
        """Return the latest camera_info's frame; before the first, that of the parameters."""
        if self._frame is not None:
            return self._frame
        size = self._config.options.image
        known = size.width_px > 0 and size.height_px > 0
        return ImageFrame((size.width_px, size.height_px)) if known else None

    def _publish(self, header: Header, frame: ImageFrame, estimate: PoseEstimate) -> None:
        model = estimate.model
        if model is None:
            self._rejections.add(Rejected(estimate.stop.name.lower(), estimate.stop.value))
            return
        pose = model.camera_from_board
        self._pose.publish(pose_msg(header, pose))
        self._pose_with_covariance.publish(
            pose_with_covariance_msg(header, pose, estimate.covariance[:6, :6])
        )
        self._camera_info.publish(camera_info_division_msg(header, frame, model.camera))


def main(args: Sequence[str] | None = None) -> None:
    """Run pose_node until SIGINT or SIGTERM."""
    run(PoseNode, args)


if __name__ == '__main__':
    main()
