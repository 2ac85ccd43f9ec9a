# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""The images of a topic, raw or compressed: received, decoded, counted, and on /diagnostics."""

from __future__ import annotations

from collections.abc import Callable
import time
from typing import TypeAlias

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from p4pfr_ros.files.images import Decoding
from rclpy.clock import Clock, ClockType
from rclpy.node import Node
from sensor_msgs.msg import CompressedImage, Image
from std_msgs.msg import Header

from .endpoints import advertise
from .following import FollowingSubscription
from .image_health import ImageHealth
from .kernel_start import KernelStart
from .rejections import CauseLog, Rejected
from ..conversions import image_from_compressed, image_from_msg, ImageArray
from ..parameters.image_node_options import ImageTopicOptions

# Period of /diagnostics.
_PERIOD_S = 1.0

ImageMessage: TypeAlias = Image | CompressedImage


class ImageStream:
    """
    Subscribes to images, decodes them on request, and reports their rate and rejections.

    Parameters
    ----------
    node
        The node of the subscription.
    options
        The parameters of the topic at the start.
    kernels
        Until they are compiled, images are rejected: interpreted, one would take minutes.
    on_image
        The callback of the subscription.

    Raises
    ------
    ConfigError
        A QoS override has an invalid value.

    """

    def __init__(
        self,
        node: Node,
        options: ImageTopicOptions,
        kernels: KernelStart,
        on_image: Callable[[ImageMessage], None],
    ) -> None:
        self._node, self._kernels, self._on_image = node, kernels, on_image
        self._frame_id = ''
        self._rejections = CauseLog(node.get_logger())
        self._health = ImageHealth(time.monotonic())
        is_compressed = options.transport == 'compressed'
        # Depth 1: if images arrive faster than they are processed, the newest is the useful one.
        self._subscription = FollowingSubscription(
            node,
            CompressedImage if is_compressed else Image,
            'image/compressed' if is_compressed else 'image',
            self._receive,
            depth=1,
            reliability=options.reliability,
        )
        self._diagnostics = advertise(node, DiagnosticArray, '/diagnostics')
        node.create_timer(_PERIOD_S, self._report, clock=Clock(clock_type=ClockType.STEADY_TIME))

    @property
    def topic(self) -> str:
        """The full name of the topic, after remapping."""
        return self._subscription.topic

    def decoded(
        self, msg: ImageMessage, options: ImageTopicOptions, *, as_grey: bool
    ) -> ImageArray | Rejected:
        """Decode an image; a rejection is counted and logged."""
        how = Decoding(
            as_grey=as_grey,
            by_content=options.deep_levels == 'content',
            max_megapixels=options.max_megapixels,
        )
        image: ImageArray | Rejected
        pending = self._kernels.pending
        if pending:
            image = Rejected('compiling', pending)
        elif isinstance(msg, CompressedImage):
            image = image_from_compressed(msg, how)
        else:
            image = image_from_msg(msg, how)
        if isinstance(image, Rejected):
            self._rejections.add(image)
        return image

    def processed(self, began_s: float, *, detected: bool) -> None:
        """Record that an image was searched for boards since a time of ``time.monotonic``."""
        self._health.processed(time.monotonic() - began_s, detected=detected)

    def _receive(self, msg: ImageMessage) -> None:
        stamp = msg.header.stamp
        self._frame_id = msg.header.frame_id
        self._health.received(time.monotonic(), stamp.sec + 1e-9 * stamp.nanosec)
        self._on_image(msg)

    def _report(self) -> None:
        """Publish /diagnostics."""
        status = self._health.status(
            time.monotonic(),
            qos=self._subscription.qos.reliability.name.lower().replace('_', ' '),
            publishers=self._subscription.publisher_count,
            incompatible=self._subscription.incompatible_count,
            rejections=self._rejections.counts,
        )
        pending = self._kernels.pending
        if pending:
            status.level, status.message = DiagnosticStatus.WARN, pending
        status.name = f'{self._node.get_fully_qualified_name()[1:]}: images'
        status.hardware_id = self._frame_id
        header = Header(stamp=self._node.get_clock().now().to_msg())
        self._diagnostics.publish(DiagnosticArray(header=header, status=[status]))
