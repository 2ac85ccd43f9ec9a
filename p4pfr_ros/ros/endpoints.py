# SPDX-License-Identifier: Apache-2.0
"""
Subscriptions and publishers as all our nodes have them.

Sensor data in (best effort: the newest matters), reliable out; history, depth, reliability and
durability of each can be overridden by ROS's own parameters, such as
``qos_overrides./image.subscription.reliability: reliable``.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from rclpy.node import Node
from rclpy.publisher import Publisher
from rclpy.qos import QoSPolicyKind, QoSProfile, ReliabilityPolicy
from rclpy.qos_overriding_options import QoSOverridingOptions
from rclpy.subscription import Subscription

_SENSOR_DEPTH = 5
_OUTPUT_DEPTH = 10
_OVERRIDABLE = (
    QoSPolicyKind.HISTORY,
    QoSPolicyKind.DEPTH,
    QoSPolicyKind.RELIABILITY,
    QoSPolicyKind.DURABILITY,
)


def subscribe(
    node: Node,
    message_type: type[Any],
    topic: str,
    callback: Callable[[Any], None],
    depth: int = _SENSOR_DEPTH,
) -> Subscription:
    """Subscribe to a sensor's data; ``depth`` messages may wait, the oldest is dropped first."""
    # Overrides are written into the profile: each endpoint needs one of its own.
    qos = QoSProfile(depth=depth, reliability=ReliabilityPolicy.BEST_EFFORT)
    overrides = QoSOverridingOptions(_OVERRIDABLE)
    return node.create_subscription(
        message_type, topic, callback, qos, qos_overriding_options=overrides
    )


def advertise(node: Node, message_type: type[Any], topic: str) -> Publisher:
    """Make a reliable publisher."""
    qos = QoSProfile(depth=_OUTPUT_DEPTH, reliability=ReliabilityPolicy.RELIABLE)
    overrides = QoSOverridingOptions(_OVERRIDABLE)
    return node.create_publisher(message_type, topic, qos, qos_overriding_options=overrides)


def is_heard(*publishers: Publisher) -> bool:
    """Return whether anybody subscribes to any of them."""
    return any(publisher.get_subscription_count() > 0 for publisher in publishers)
