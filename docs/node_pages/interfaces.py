# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""Topics and services of a running node, with their types and QoS."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
import enum
import os

import p4pfr_ros.ros  # noqa: F401  (sets AMENT_PREFIX_PATH)
import rclpy
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy

_NAMESPACE = '/here'


class Role(enum.Enum):
    """The role of an endpoint for its node."""

    IN = enum.auto()
    OUT = enum.auto()
    SERVICE = enum.auto()
    CLIENT = enum.auto()


@dataclass(frozen=True, slots=True)
class Endpoint:
    """
    A topic or service of a node.

    Parameters
    ----------
    role
        Its role for the node.
    name
        The name before remapping: ``name``, ``~/name`` or ``/name``.
    type
        Such as sensor_msgs/Image.
    qos
        As text; empty for services.

    """

    role: Role
    name: str
    type: str
    qos: str = ''


def endpoints_of(make_node: Callable[[], Node], parameters: Mapping[str, str]) -> set[Endpoint]:
    """
    Create a node and list its endpoints, except those of every rclpy node.

    Discovery is off, so that other nodes do not interfere.
    """
    with _ros(parameters):
        bare, node = Node('bare'), make_node()
        try:
            return _all_of(node) - _all_of(bare)
        finally:
            node.destroy_node()
            bare.destroy_node()


@contextmanager
def _ros(parameters: Mapping[str, str]) -> Iterator[None]:
    os.environ['ROS_AUTOMATIC_DISCOVERY_RANGE'] = 'OFF'
    given = [word for item in parameters.items() for word in ('-p', ':='.join(item))]
    quiet = ['--log-level', 'warn']
    rclpy.init(args=['--ros-args', '-r', f'__ns:={_NAMESPACE}', *quiet, *given])
    try:
        yield
    finally:
        rclpy.shutdown()


def _all_of(node: Node) -> set[Endpoint]:
    """List the endpoints of a node in the graph; the depth of a queue comes from the node."""
    name, namespace = node.get_name(), node.get_namespace()
    ours = {end.topic_name: end.qos_profile for end in (*node.publishers, *node.subscriptions)}
    topics = (
        (Role.OUT, node.get_publisher_names_and_types_by_node, node.get_publishers_info_by_topic),
        (
            Role.IN,
            node.get_subscriber_names_and_types_by_node,
            node.get_subscriptions_info_by_topic,
        ),
    )
    services = (
        (Role.SERVICE, node.get_service_names_and_types_by_node),
        (Role.CLIENT, node.get_client_names_and_types_by_node),
    )
    endpoints = set()
    for role, listing, infos in topics:
        for topic, types in listing(name, namespace):
            qos = ours.get(topic) or infos(topic)[0].qos_profile
            endpoints.add(
                Endpoint(role, _unresolved(topic, node), _short(types[0]), _qos_text(qos))
            )
    for role, listing in services:
        for service, types in listing(name, namespace):
            endpoints.add(Endpoint(role, _unresolved(service, node), _short(types[0])))
    return endpoints


def _unresolved(name: str, node: Node) -> str:
    """Return the name in the code of the node for a resolved name."""
    own = f'{node.get_fully_qualified_name()}/'
    if name.startswith(own):
        return '~/' + name.removeprefix(own)
    return name.removeprefix(f'{_NAMESPACE}/')


def _short(type_name: str) -> str:
    package, _, name = type_name.split('/')
    return f'{package}/{name}'


def _qos_text(qos: QoSProfile) -> str:
    reliable = qos.reliability is ReliabilityPolicy.RELIABLE
    words = ['reliable' if reliable else 'best effort']
    if qos.depth > 0:
        words.append(f'depth {qos.depth}')
    if qos.durability is DurabilityPolicy.TRANSIENT_LOCAL:
        words.append('transient local')
    return ', '.join(words)
