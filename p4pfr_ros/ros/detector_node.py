# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""detector_node: images in, the points of each board out."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from p4pfr_ros.detection import detect, Detection
from p4pfr_ros.files.images import Decoding
from p4pfr_ros.report.drawing import annotate
from rclpy.logging import LoggingSeverity
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
from .runtime.endpoints import advertise, has_subscribers, subscribe
from .runtime.rejections import CauseLog, Rejected
from .runtime.spin import run


class DetectorNode(Node):  # type: ignore[misc]
    """
    Detects one or several boards in each image.

    Each detected board is published as one message with the header of the image. With several
    boards in the file, the field ``board`` is the index of the board there, from 0.

    Parameters
    ----------
    **node_options
        Options of rclpy's Node, such as ``parameter_overrides``.

    """

    def __init__(self, **node_options: Any) -> None:
        super().__init__('detector_node', **node_options)
        self._config = Parameters(self, DetectorNodeOptions())
        options = self._config.options
        self._boards = list(required_boards(self.get_name(), options.board_file).values())
        self._rejections = CauseLog(self.get_logger())
        self._misses = CauseLog(self.get_logger(), LoggingSeverity.INFO)
        self._correspondences = advertise(self, PointCloud2, 'correspondences')
        self._annotated = advertise(self, Image, '~/image_annotated')
        # Depth 1: if images arrive faster than they are processed, the newest is the useful one.
        if options.image.transport == 'compressed':
            subscribe(self, CompressedImage, 'image/compressed', self._on_compressed, depth=1)
        else:
            subscribe(self, Image, 'image', self._on_image, depth=1)
        self.get_logger().info('ready')

    def _on_image(self, msg: Image) -> None:
        if has_subscribers(self._correspondences, self._annotated):
            self._process(msg.header, image_from_msg(msg, self._decoding))

    def _on_compressed(self, msg: CompressedImage) -> None:
        if has_subscribers(self._correspondences, self._annotated):
            self._process(msg.header, image_from_compressed(msg, self._decoding))

    @property
    def _decoding(self) -> Decoding:
        """Only the annotated image needs colour."""
        options = self._config.options.image
        return Decoding(
            as_grey=not has_subscribers(self._annotated),
            by_content=options.deep_levels == 'content',
            max_megapixels=options.max_megapixels,
        )

    def _process(self, header: Header, image: ImageArray | Rejected) -> None:
        if isinstance(image, Rejected):
            self._rejections.add(image)
        else:
            self._publish(header, image, [detect(image, board) for board in self._boards])

    def _publish(self, header: Header, image: ImageArray, detections: list[Detection]) -> None:
        for index, detection in enumerate(detections):
            if not detection.reason:
                self._correspondences.publish(
                    cloud_msg(
                        header,
                        detection.image_points,
                        detection.board_points,
                        detection.ids,
                        index if len(detections) > 1 else None,
                    )
                )
        merged = _merged(detections)
        if merged.reason:
            self._misses.add(Rejected('no_board', merged.reason))
        if has_subscribers(self._annotated):
            self._annotated.publish(image_msg(header, annotate(image, merged)))


def _merged(detections: list[Detection]) -> Detection:
    """Return points and rejected candidates of all boards; without points, all reasons."""
    is_detected = any(not detection.reason for detection in detections)
    return Detection(
        np.concatenate([detection.image_points for detection in detections]),
        np.concatenate([detection.board_points for detection in detections]),
        np.concatenate([detection.ids for detection in detections]),
        '' if is_detected else '; '.join(detection.reason for detection in detections),
        tuple(candidate for detection in detections for candidate in detection.rejected),
    )


def main(args: Sequence[str] | None = None) -> None:
    """Run detector_node until SIGINT or SIGTERM."""
    run(DetectorNode, args)


if __name__ == '__main__':
    main()
