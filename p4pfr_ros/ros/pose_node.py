# SPDX-License-Identifier: Apache-2.0
"""pose_node: corners of a marker or board in, pose and camera out."""

from __future__ import annotations

from collections.abc import Sequence

from geometry_msgs.msg import PolygonStamped, PoseStamped, PoseWithCovarianceStamped
import numpy as np
from p4pfr_ros import estimate_pose, PoseEstimate
from p4pfr_ros.core.geometry import Array
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

# A corner that was fitted may lie this far outside the picture; nothing else can be seen there.
_MARGIN_PX = 2.0

_QUANTITIES = ('direction', 'distance', 'focal', 'distortion')


class PoseNode(Node):  # type: ignore[misc]
    """
    Estimates, for each view of a marker or board, its pose, the focal length and the distortion.

    Header, stamp and frame of an answer are those of the message that it answers.
    """

    def __init__(self) -> None:
        super().__init__('pose_node')
        self._config = Parameters(self, PoseNodeOptions())
        self._rejections = Rejections(lambda text: self.get_logger().warning(text))
        self._remarks = Rejections(lambda text: self.get_logger().warning(text))
        self._frame: ImageFrame | None = None
        self._frame_id = ''
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
            self._frame_id = msg.header.frame_id

    def _on_corners(self, msg: PolygonStamped) -> None:
        marker = self._config.options.marker
        points = correspondences_from_polygon(
            msg, marker.size_m, marker.corner_order, marker.pixel_center_px
        )
        self._answer(msg.header, points)

    def _on_correspondences(self, msg: PointCloud2) -> None:
        self._answer(msg.header, correspondences_from_cloud(msg))

    def _answer(self, header: Header, points: Correspondences | Rejected) -> None:
        frame = self._image_frame()
        if isinstance(points, Rejected):
            self._rejections.add(points)
        elif frame is None:
            self._rejections.add(_NO_SIZE)
        elif (outside := _outside(frame.full_from_sent(points.image_points), frame)) is not None:
            self._rejections.add(outside)
        elif is_heard(self._pose, self._pose_with_covariance, self._camera_info):
            self._remark_on_frames(header)
            estimate = estimate_pose(
                frame.full_from_sent(points.image_points),
                points.board_points,
                image_size=frame.size,
                center_px=self._config.options.image.center_px(frame.size),
                options=self._config.options.robust.ransac(),
            )
            self._publish(header, frame, estimate)

    def _remark_on_frames(self, header: Header) -> None:
        if self._frame_id not in ('', header.frame_id):
            self._remarks.add(
                Rejected(
                    'frame_id',
                    f'camera_info is of the frame {self._frame_id!r}, the corners of '
                    f'{header.frame_id!r}: is it the same camera?',
                )
            )

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
        pose, seen = model.camera_from_board, estimate.observable
        # The covariance can say that a number means nothing; the other messages cannot.
        self._pose_with_covariance.publish(
            pose_with_covariance_msg(header, pose, estimate.covariance[:6, :6])
        )
        if seen.direction and seen.distance:
            self._pose.publish(pose_msg(header, pose))
        if seen.focal and seen.distortion:
            self._camera_info.publish(camera_info_division_msg(header, frame, model.camera))
        unseen = [name for name in _QUANTITIES if not getattr(seen, name)]
        if unseen:
            self._remarks.add(
                Rejected(
                    'not_observable',
                    f'a view does not tell: {", ".join(unseen)} (tilt the board, bring it nearer)',
                )
            )


def _outside(points_px: Array, frame: ImageFrame) -> Rejected | None:
    """Say which point cannot have been seen in the picture, if one cannot."""
    width, height = frame.size
    low, high = -0.5 - _MARGIN_PX, np.array([width, height]) - 0.5 + _MARGIN_PX
    beyond = np.flatnonzero(((points_px < low) | (points_px > high)).any(axis=1))
    if beyond.size == 0:
        return None
    x, y = points_px[beyond[0]]
    return Rejected(
        'outside_picture',
        f'a point at ({x:.0f}, {y:.0f}) px cannot be in a picture of {width}x{height} px: is the '
        'camera_info that of this camera?',
    )


def main(args: Sequence[str] | None = None) -> None:
    """Run pose_node until SIGINT or SIGTERM."""
    run(PoseNode, args)


if __name__ == '__main__':
    main()
