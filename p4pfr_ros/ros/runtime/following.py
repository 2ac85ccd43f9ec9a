# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""
A subscription that takes the QoS which its publishers offer, and follows them when they change.

Best effort matches every publisher, but loses large messages: DDS splits an image into hundreds of
fragments, and one lost fragment loses the image. Reliable requests them again, but receives
nothing from a best-effort publisher. So a subscription begins with best effort and becomes
reliable when all publishers are, as ``ros2 topic echo`` does. Likewise it becomes transient local,
so that it receives the last message of a latched publisher that published before it existed.

This module stands alone: discovery is no concern of the nodes.
"""

from __future__ import annotations

from collections.abc import Callable
from copy import copy
from typing import Any

from rclpy.clock import Clock, ClockType
from rclpy.node import Node
from rclpy.qos import (
    DurabilityPolicy,
    qos_check_compatible,
    QoSCompatibility,
    QoSProfile,
    ReliabilityPolicy,
)

from .endpoints import SENSOR_DEPTH, subscribe
from .overrides import is_overridden, SUBSCRIPTION

# Publishers are compared this often: a query of the local graph, some tens of microseconds.
_PERIOD_S = 0.25

AUTO = 'auto'
_RELIABILITY = {
    'reliable': ReliabilityPolicy.RELIABLE,
    'best_effort': ReliabilityPolicy.BEST_EFFORT,
}
RELIABILITIES = (AUTO, *_RELIABILITY)


class FollowingSubscription:
    """
    Subscribes to a topic with the reliability and durability that its publishers offer.

    Parameters
    ----------
    node
        The node of the subscription.
    message_type, topic, callback
        As for ``Node.create_subscription``.
    depth
        Length of the queue.
    reliability
        ``auto``, or ``reliable`` or ``best_effort`` to force one. A QoS override of the policy
        takes precedence.
    only_latched
        Whether to become reliable for latched publishers only: a small message is not lost, and
        subscribing again may lose one.

    Raises
    ------
    ConfigError
        A QoS override has an invalid value.

    """

    def __init__(
        self,
        node: Node,
        message_type: type[Any],
        topic: str,
        callback: Callable[[Any], None],
        *,
        depth: int = SENSOR_DEPTH,
        reliability: str = AUTO,
        only_latched: bool = False,
    ) -> None:
        self._node, self._type, self._callback = node, message_type, callback
        self._only_latched = only_latched
        self._subscription = subscribe(node, message_type, topic, callback, depth)
        self._forced = {
            policy
            for policy in ('reliability', 'durability')
            if is_overridden(node, topic, SUBSCRIPTION, policy)
        }
        if reliability != AUTO and 'reliability' not in self._forced:
            self._forced.add('reliability')
            self._replace(reliability=_RELIABILITY[reliability])
        steady = Clock(clock_type=ClockType.STEADY_TIME)
        self._timer = node.create_timer(_PERIOD_S, self._follow, clock=steady)

    @property
    def qos(self) -> QoSProfile:
        """The QoS of the subscription now."""
        return self._subscription.qos_profile

    @property
    def topic(self) -> str:
        """The full name of the topic, after remapping."""
        return str(self._subscription.topic_name)

    @property
    def publisher_count(self) -> int:
        """The number of publishers on the topic, whether they match or not."""
        return int(self._node.count_publishers(self._subscription.topic_name))

    @property
    def incompatible_count(self) -> int:
        """The number of publishers whose messages a forced policy keeps away."""
        return sum(
            qos_check_compatible(qos, self.qos)[0] == QoSCompatibility.ERROR
            for qos in self._offered()
        )

    def destroy(self) -> None:
        """Unsubscribe."""
        self._node.destroy_timer(self._timer)
        self._node.destroy_subscription(self._subscription)

    def _follow(self) -> None:
        offered = self._offered()
        if not offered:
            return
        # A stricter policy than one publisher offers does not match it.
        latched = all(qos.durability is DurabilityPolicy.TRANSIENT_LOCAL for qos in offered)
        reliable = all(qos.reliability is ReliabilityPolicy.RELIABLE for qos in offered)
        reliable &= latched or not self._only_latched
        self._replace(
            reliability=ReliabilityPolicy.RELIABLE if reliable else ReliabilityPolicy.BEST_EFFORT,
            durability=(
                DurabilityPolicy.TRANSIENT_LOCAL if latched else DurabilityPolicy.VOLATILE
            ),
            unless=self._forced,
        )

    def _offered(self) -> list[QoSProfile]:
        """Return the QoS of each publisher on the topic."""
        topic = self._subscription.topic_name
        return [info.qos_profile for info in self._node.get_publishers_info_by_topic(topic)]

    def _replace(self, unless: frozenset[str] | set[str] = frozenset(), **policies: Any) -> None:
        """Subscribe again with other policies, if they differ from the present ones."""
        changed = {
            name: value
            for name, value in policies.items()
            if name not in unless and getattr(self.qos, name) is not value
        }
        if not changed:
            return
        qos = copy(self.qos)
        for name, value in changed.items():
            setattr(qos, name, value)
        topic = self._subscription.topic_name
        self._node.destroy_subscription(self._subscription)
        # Without overriding options: the parameters are declared, and hold the first policies.
        self._subscription = self._node.create_subscription(self._type, topic, self._callback, qos)
        words = ', '.join(value.name.lower().replace('_', ' ') for value in changed.values())
        self._node.get_logger().info(f'{topic}: subscribed again: {words}')
