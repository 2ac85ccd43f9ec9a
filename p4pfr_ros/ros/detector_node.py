# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""detector_node: pictures in, the points of each board out."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from p4pfr_ros.detection import detect, Detection
from p4pfr_ros.report.drawing import annotate
from rclpy.node import Node
from sensor_msgs.msg import CompressedImage, Image, PointCloud2
from std_msgs.msg import Header

from .conversions import (
    cloud_msg,
    image_from_compressed,
    image_from_msg,
    image_msg,
    ImageArray,
)
from .parameters.board_file import required_boards
from .parameters.declare import Parameters
from .parameters.image_node_options import DetectorNodeOptions
from .runtime.endpoints import advertise, is_heard, subscribe
from .runtime.rejections import Rejected, Rejections
from .runtime.spin import run


class DetectorNode(Node):  # type: ignore[misc]
    """
    Finds the points of one board, or of several, in each picture.

    Each board that is found gives one message, with the header of the picture. Where the file
    holds several boards, the field ``board`` says which one it is: its place there, from 0.

    Parameters
    ----------
    of_node
        What every node can be told, such as ``parameter_overrides``.

    """

    def __init__(self, **of_node: Any) -> None:
        super().__init__('detector_node', **of_node)
        options = Parameters(self, DetectorNodeOptions()).options
        self._boards = list(required_boards(self.get_name(), options.board_file).values())
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

    def _look_at(self, header: Header, picture: ImageArray | Rejected) -> None:
        if isinstance(picture, Rejected):
            self._rejections.add(picture)
        elif is_heard(self._correspondences, self._annotated):
            self._publish(header, picture, [detect(picture, board) for board in self._boards])

    def _publish(self, header: Header, picture: ImageArray, detections: list[Detection]) -> None:
        for board, found in enumerate(detections):
            if not found.reason:
                self._correspondences.publish(
                    cloud_msg(
                        header,
                        found.image_points,
                        found.board_points,
                        found.ids,
                        board if len(detections) > 1 else None,
                    )
                )
        together = _together(detections)
        if together.reason:
            self._misses.add(Rejected('no_board', together.reason))
        if is_heard(self._annotated):
            self._annotated.publish(image_msg(header, annotate(picture, together)))


def _together(detections: list[Detection]) -> Detection:
    """Return all points of all boards; where there are none, all reasons."""
    found = [detection for detection in detections if not detection.reason]
    return Detection(
        np.concatenate([detection.image_points for detection in detections]),
        np.concatenate([detection.board_points for detection in detections]),
        np.concatenate([detection.ids for detection in detections]),
        '' if found else '; '.join(detection.reason for detection in detections),
    )


def main(args: Sequence[str] | None = None) -> None:
    """Run detector_node until SIGINT or SIGTERM."""
    run(DetectorNode, args)


if __name__ == '__main__':
    main()
