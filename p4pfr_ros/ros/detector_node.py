# SPDX-License-Identifier: Apache-2.0
"""detector_node: pictures in, the board's points out."""

from __future__ import annotations

from collections.abc import Sequence

from p4pfr_ros.detection import detect, Detection
from p4pfr_ros.drawing import annotate
from rclpy.node import Node
from sensor_msgs.msg import CompressedImage, Image, PointCloud2
from std_msgs.msg import Header

from .board import required_board
from .conversions import (
    cloud_msg,
    image_from_compressed,
    image_from_msg,
    image_msg,
    Picture,
)
from .endpoints import advertise, is_heard, subscribe
from .options import DetectorNodeOptions
from .parameters import Parameters
from .rejections import Rejected, Rejections
from .spin import run


class DetectorNode(Node):  # type: ignore[misc]
    """Finds the points of one board in each picture; the header stays that of the picture."""

    def __init__(self) -> None:
        super().__init__('detector_node')
        options = Parameters(self, DetectorNodeOptions()).options
        self._board = required_board(self.get_name(), options.board_file)
        self._rejections = Rejections(lambda text: self.get_logger().warning(text))
        self._misses = Rejections(lambda text: self.get_logger().info(text))
        self._correspondences = advertise(self, PointCloud2, 'correspondences')
        self._annotated = advertise(self, Image, '~/image_annotated')
        # Where pictures come faster than they are looked at, an old one is of no use.
        if options.image.transport == 'compressed':
            subscribe(self, CompressedImage, 'image/compressed', self._on_compressed, depth=1)
        else:
            subscribe(self, Image, 'image', self._on_image, depth=1)
        self.get_logger().info('ready')

    def _on_image(self, msg: Image) -> None:
        self._look_at(msg.header, image_from_msg(msg))

    def _on_compressed(self, msg: CompressedImage) -> None:
        self._look_at(msg.header, image_from_compressed(msg))

    def _look_at(self, header: Header, picture: Picture | Rejected) -> None:
        if isinstance(picture, Rejected):
            self._rejections.add(picture)
        elif is_heard(self._correspondences, self._annotated):
            self._publish(header, picture, detect(picture, self._board))

    def _publish(self, header: Header, picture: Picture, detection: Detection) -> None:
        if detection.reason:
            self._misses.add(Rejected('no_board', detection.reason))
        else:
            self._correspondences.publish(
                cloud_msg(header, detection.image_points, detection.board_points, detection.ids)
            )
        if is_heard(self._annotated):
            annotated = annotate(picture, detection, board=self._board)
            self._annotated.publish(image_msg(header, annotated))


def main(args: Sequence[str] | None = None) -> None:
    """Run detector_node until SIGINT or SIGTERM."""
    run(DetectorNode, args)


if __name__ == '__main__':
    main()
