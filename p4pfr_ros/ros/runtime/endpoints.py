# Copyright 2026 p4pfr_ros maintainers
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

from p4pfr_ros.files.yaml_fields import ConfigError
from rclpy.client import Client
from rclpy.clock import Clock, ClockType
from rclpy.exceptions import NameValidationException
from rclpy.node import Node
from rclpy.publisher import Publisher
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from rclpy.subscription import Subscription

from .overrides import overridable, PUBLISHER, SUBSCRIPTION

_SENSOR_DEPTH = 5
_OUTPUT_DEPTH = 10


def subscribe(
    node: Node,
    message_type: type[Any],
    topic: str,
    callback: Callable[[Any], None],
    depth: int = _SENSOR_DEPTH,
) -> Subscription:
    """
    Subscribe to a sensor's data; ``depth`` messages may wait, the oldest is dropped first.

    Raises
    ------
    ConfigError
        The user overrides a policy by a value that it cannot have.

    """
    # Overrides are written into the profile: each endpoint needs one of its own.
    qos = QoSProfile(depth=depth, reliability=ReliabilityPolicy.BEST_EFFORT)
    overrides = overridable(node, topic, SUBSCRIPTION)
    return node.create_subscription(
        message_type, topic, callback, qos, qos_overriding_options=overrides
    )


def advertise(
    node: Node, message_type: type[Any], topic: str, *, latched: bool = False
) -> Publisher:
    """
    Make a reliable publisher; a latched one tells its last message to whoever comes late.

    Raises
    ------
    ConfigError
        The user overrides a policy by a value that it cannot have.

    """
    qos = QoSProfile(depth=_OUTPUT_DEPTH, reliability=ReliabilityPolicy.RELIABLE)
    if latched:
        qos = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
    overrides = overridable(node, topic, PUBLISHER)
    return node.create_publisher(message_type, topic, qos, qos_overriding_options=overrides)


def is_heard(*publishers: Publisher) -> bool:
    """Return whether anybody subscribes to any of them."""
    return any(publisher.get_subscription_count() > 0 for publisher in publishers)


def is_awaited(publisher: Publisher) -> bool:
    """Return whether anybody hears a message now, or may ask for the last one later."""
    is_latched = publisher.qos_profile.durability is DurabilityPolicy.TRANSIENT_LOCAL
    return is_latched or is_heard(publisher)


class Endpoints:
    """
    What a node makes to talk to others, and takes down again as a whole.

    Parameters
    ----------
    node
        Whose they are.

    """

    def __init__(self, node: Node) -> None:
        self._node = node
        self._destroyers: list[Callable[[], object]] = []

    def subscribe(
        self, message_type: type[Any], topic: str, callback: Callable[[Any], None]
    ) -> None:
        """Subscribe to a sensor's data."""
        made = subscribe(self._node, message_type, topic, callback)
        self._destroyers.append(lambda: self._node.destroy_subscription(made))

    def advertise(
        self, message_type: type[Any], topic: str, *, latched: bool = False
    ) -> Publisher:
        """Make a reliable publisher."""
        made = advertise(self._node, message_type, topic, latched=latched)
        self._destroyers.append(lambda: self._node.destroy_publisher(made))
        return made

    def serve(
        self, service_type: type[Any], name: str, callback: Callable[[Any, Any], Any]
    ) -> None:
        """Offer a service."""
        made = self._node.create_service(service_type, name, callback)
        self._destroyers.append(lambda: self._node.destroy_service(made))

    def client(self, service_type: type[Any], name: str, *, parameter: str) -> Client:
        """
        Make the client of somebody's service.

        Raises
        ------
        ConfigError
            No service can have that name: names the node, and the parameter that says it.

        """
        try:
            made = self._node.create_client(service_type, name)
        except (NameValidationException, ValueError) as error:  # an unknown {substitution}
            why = str(error).splitlines()[0].removeprefix('Invalid service name: ')
            raise ConfigError(
                f'{self._node.get_name()}: {parameter}: expected the name of a service, '
                f'got {name!r}: {why.rstrip(":")}'
            ) from None
        self._destroyers.append(lambda: self._node.destroy_client(made))
        return made

    def every(self, period_s: float, callback: Callable[[], None]) -> None:
        """Call something again and again, also while simulated time stands still."""
        steady = Clock(clock_type=ClockType.STEADY_TIME)
        made = self._node.create_timer(period_s, callback, clock=steady)
        self._destroyers.append(lambda: self._node.destroy_timer(made))

    def add(self, destroy: Callable[[], object]) -> None:
        """Take along something that was made elsewhere: ``destroy`` takes it down."""
        self._destroyers.append(destroy)

    def close(self) -> None:
        """Take all of them down, the last one first."""
        while self._destroyers:
            self._destroyers.pop()()
