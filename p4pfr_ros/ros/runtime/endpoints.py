# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""
Subscriptions, publishers, services and timers with the defaults of our nodes.

Subscriptions use the QoS of sensor data (best effort, short queue), publishers are reliable.
ROS parameters such as ``qos_overrides./image.subscription.reliability: reliable`` override
history, depth, reliability and durability of each.
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

SENSOR_DEPTH = 5
_OUTPUT_DEPTH = 10


def subscribe(
    node: Node,
    message_type: type[Any],
    topic: str,
    callback: Callable[[Any], None],
    depth: int = SENSOR_DEPTH,
) -> Subscription:
    """
    Subscribe to sensor data; the queue holds ``depth`` messages and drops the oldest first.

    Raises
    ------
    ConfigError
        A QoS override has an invalid value.

    """
    # rclpy writes the overrides into the profile, so each endpoint needs its own.
    qos = QoSProfile(depth=depth, reliability=ReliabilityPolicy.BEST_EFFORT)
    overrides = overridable(node, topic, SUBSCRIPTION)
    return node.create_subscription(
        message_type, topic, callback, qos, qos_overriding_options=overrides
    )


def advertise(
    node: Node, message_type: type[Any], topic: str, *, latched: bool = False
) -> Publisher:
    """
    Create a reliable publisher; late subscribers of a latched one receive its last message.

    Raises
    ------
    ConfigError
        A QoS override has an invalid value.

    """
    qos = QoSProfile(depth=_OUTPUT_DEPTH, reliability=ReliabilityPolicy.RELIABLE)
    if latched:
        qos = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
    overrides = overridable(node, topic, PUBLISHER)
    return node.create_publisher(message_type, topic, qos, qos_overriding_options=overrides)


def has_subscribers(*publishers: Publisher) -> bool:
    """Return whether any of the publishers has a subscriber."""
    return any(publisher.get_subscription_count() > 0 for publisher in publishers)


def is_awaited(*publishers: Publisher) -> bool:
    """Return whether any of the publishers has a subscriber, or is latched for later ones."""
    return any(
        publisher.qos_profile.durability is DurabilityPolicy.TRANSIENT_LOCAL
        or publisher.get_subscription_count() > 0
        for publisher in publishers
    )


class Endpoints:
    """
    Creates endpoints of a node, and destroys them together.

    Parameters
    ----------
    node
        The node of the endpoints.

    """

    def __init__(self, node: Node) -> None:
        self._node = node
        self._destroyers: list[Callable[[], object]] = []

    def subscribe(
        self, message_type: type[Any], topic: str, callback: Callable[[Any], None]
    ) -> None:
        """Subscribe to sensor data."""
        subscription = subscribe(self._node, message_type, topic, callback)
        self._destroyers.append(lambda: self._node.destroy_subscription(subscription))

    def advertise(
        self, message_type: type[Any], topic: str, *, latched: bool = False
    ) -> Publisher:
        """Create a reliable publisher."""
        publisher = advertise(self._node, message_type, topic, latched=latched)
        self._destroyers.append(lambda: self._node.destroy_publisher(publisher))
        return publisher

    def serve(
        self, service_type: type[Any], name: str, callback: Callable[[Any, Any], Any]
    ) -> None:
        """Offer a service."""
        service = self._node.create_service(service_type, name, callback)
        self._destroyers.append(lambda: self._node.destroy_service(service))

    def client(self, service_type: type[Any], name: str, *, parameter: str) -> Client:
        """
        Create the client of a service.

        Raises
        ------
        ConfigError
            The name is not a valid service name; the message names the node and the parameter
            that holds it.

        """
        try:
            client = self._node.create_client(service_type, name)
        except (NameValidationException, ValueError) as error:  # an unknown {substitution}
            why = str(error).splitlines()[0].removeprefix('Invalid service name: ')
            raise ConfigError(
                f'{self._node.get_name()}: {parameter}: expected the name of a service, '
                f'got {name!r}: {why.rstrip(":")}'
            ) from None
        self._destroyers.append(lambda: self._node.destroy_client(client))
        return client

    def every(self, period_s: float, callback: Callable[[], None]) -> None:
        """Create a timer on the steady clock, which is independent of simulated time."""
        steady = Clock(clock_type=ClockType.STEADY_TIME)
        timer = self._node.create_timer(period_s, callback, clock=steady)
        self._destroyers.append(lambda: self._node.destroy_timer(timer))

    def add(self, destroy: Callable[[], object]) -> None:
        """Destroy an endpoint that was created elsewhere with the others."""
        self._destroyers.append(destroy)

    def close(self) -> None:
        """Destroy all endpoints, the last one first."""
        while self._destroyers:
            self._destroyers.pop()()
