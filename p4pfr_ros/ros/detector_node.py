# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""detector_node: images in, the points of each board out."""

from __future__ import annotations

from collections.abc import Sequence
import time
from typing import Any

import cv2
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
import numpy as np
from p4pfr_ros.detection import detect, Detection
from p4pfr_ros.files.images import Decoding
from p4pfr_ros.kernels.warm_up import warm_up_detection
from p4pfr_ros.report.drawing import annotate
from rclpy.clock import Clock, ClockType
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
from .parameters.image_node_options import DetectorNodeOptions, ImageTopicOptions
from .runtime.endpoints import advertise, has_subscribers
from .runtime.following import FollowingSubscription
from .runtime.image_health import ImageHealth
from .runtime.kernel_start import KernelStart
from .runtime.rejections import CauseLog, Rejected
from .runtime.spin import run

# Period of /diagnostics.
_PERIOD_S = 1.0


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
        self._rejections = CauseLog(self.get_logger())
        self._frame_id = ''
        self._misses = CauseLog(self.get_logger(), LoggingSeverity.INFO)
        self._correspondences = advertise(self, PointCloud2, 'correspondences')
        self._annotated = advertise(self, Image, '~/image_annotated')
        self._diagnostics = advertise(self, DiagnosticArray, '/diagnostics')
        self._health = ImageHealth(time.monotonic())
        self._kernels = KernelStart(self, warm_up_detection)  # no image waits for the compiler
        self._images = self._subscribed(options.image)
        self.create_timer(_PERIOD_S, self._report, clock=Clock(clock_type=ClockType.STEADY_TIME))
        self._kernels.when_ready(lambda: self.get_logger().info('ready'))

    def _subscribed(self, image: ImageTopicOptions) -> FollowingSubscription:
        # Depth 1: if images arrive faster than they are processed, the newest is the useful one.
        kind, topic, callback = (
            (CompressedImage, 'image/compressed', self._on_compressed)
            if image.transport == 'compressed'
            else (Image, 'image', self._on_image)
        )
        return FollowingSubscription(
            self, kind, topic, callback, depth=1, reliability=image.reliability
        )

    def _on_image(self, msg: Image) -> None:
        self._received(msg.header)
        if has_subscribers(self._correspondences, self._annotated):
            self._process(msg.header, image_from_msg(msg, self._decoding))

    def _on_compressed(self, msg: CompressedImage) -> None:
        self._received(msg.header)
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

    def _received(self, header: Header) -> None:
        self._frame_id = header.frame_id
        stamp_s = header.stamp.sec + 1e-9 * header.stamp.nanosec
        self._health.received(time.monotonic(), stamp_s)

    def _report(self) -> None:
        """Publish /diagnostics."""
        status = self._health.status(
            time.monotonic(),
            qos=self._images.qos.reliability.name.lower().replace('_', ' '),
            publishers=self._images.publisher_count,
            rejections=self._rejections.counts,
        )
        if self._kernels.pending:
            status.level, status.message = DiagnosticStatus.WARN, self._kernels.pending
        status.name = f'{self.get_fully_qualified_name()[1:]}: images'
        status.hardware_id = self._frame_id
        header = Header(stamp=self.get_clock().now().to_msg())
        self._diagnostics.publish(DiagnosticArray(header=header, status=[status]))

    def _process(self, header: Header, image: ImageArray | Rejected) -> None:
        pending = self._kernels.pending
        if pending:  # interpreted, an image would take minutes
            image = Rejected('compiling', pending)
        if isinstance(image, Rejected):
            self._rejections.add(image)
            return
        began_s = time.monotonic()
        min_marker_px = self._config.options.min_marker_px
        detections = [
            detect(image, board, near=before, min_marker_px=min_marker_px)
            for board, before in zip(self._boards, self._before, strict=True)
        ]
        self._before = [None if each.reason else each for each in detections]
        self._publish(header, image, detections)
        self._health.processed(
            time.monotonic() - began_s, detected=any(not each.reason for each in detections)
        )

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
