# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""detector_node: images in, the points of each board out."""

from __future__ import annotations

from collections.abc import Sequence
import time
from typing import Any

import cv2
import numpy as np
from p4pfr_ros.detection import detect, Detection
from p4pfr_ros.kernels.warm_up import warm_up_detection
from p4pfr_ros.report.drawing import annotate
from rclpy.logging import LoggingSeverity
from rclpy.node import Node
from sensor_msgs.msg import Image, PointCloud2
from std_msgs.msg import Header

from .conversions import cloud_msg, image_msg, ImageArray
from .parameters.board_file import required_boards
from .parameters.declare import Parameters
from .parameters.image_node_options import DetectorNodeOptions
from .runtime.endpoints import advertise, has_subscribers
from .runtime.image_stream import ImageMessage, ImageStream
from .runtime.kernel_start import KernelStart
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
        cv2.setNumThreads(options.opencv_threads)
        self._boards = list(required_boards(self.get_name(), options.board_file).values())
        # Each board is searched near its place in the image before.
        self._before: list[Detection | None] = [None] * len(self._boards)
        self._misses = CauseLog(self.get_logger(), LoggingSeverity.INFO)
        self._correspondences = advertise(self, PointCloud2, 'correspondences')
        self._annotated = advertise(self, Image, '~/image_annotated')
        kernels = KernelStart(self, warm_up_detection)  # no image waits for the compiler
        self._images = ImageStream(self, options.image, kernels, self._on_image)
        kernels.when_ready(lambda: self.get_logger().info('ready'))

    def _on_image(self, msg: ImageMessage) -> None:
        if not has_subscribers(self._correspondences, self._annotated):
            return
        options = self._config.options
        # Only the annotated image needs colour.
        as_grey = not has_subscribers(self._annotated)
        image = self._images.decoded(msg, options.image, as_grey=as_grey)
        if isinstance(image, Rejected):
            return
        began_s = time.monotonic()
        detections = [
            detect(image, board, near=before, min_marker_px=options.min_marker_px)
            for board, before in zip(self._boards, self._before, strict=True)
        ]
        self._before = [None if each.reason else each for each in detections]
        self._publish(msg.header, image, detections)
        self._images.processed(began_s, detected=any(not each.reason for each in detections))

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
