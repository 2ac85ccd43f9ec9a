# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""
ROS's parameters ``qos_overrides.<topic>.<kind>.<policy>``, as our endpoints take them.

ROS takes them at their word: of a value that is none it raises errors of many kinds, and one for
a topic that a node does not have it passes over.
"""

from __future__ import annotations

from typing import Any

from p4pfr_ros.files.yaml_fields import ConfigError
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, HistoryPolicy, QoSPolicyKind, ReliabilityPolicy
from rclpy.qos_overriding_options import QoSOverridingOptions

from ..parameters.declare import given_parameters, warn_of_unknown

SUBSCRIPTION, PUBLISHER = 'subscription', 'publisher'

_CHOICES = {
    QoSPolicyKind.HISTORY: HistoryPolicy,
    QoSPolicyKind.RELIABILITY: ReliabilityPolicy,
    QoSPolicyKind.DURABILITY: DurabilityPolicy,
}
_MAX_DEPTH = 2**31 - 1  # what DDS counts in; 0 leaves the choice to it

_PREFIX = 'qos_overrides'
# Of a subscription that ROS makes only where time is simulated.
_OF_ROS = f'{_PREFIX}./clock.'


def overridable(node: Node, topic: str, kind: str) -> QoSOverridingOptions:
    """
    Let the user override history, depth, reliability and durability of an endpoint.

    Parameters
    ----------
    node
        Whose endpoint it is.
    topic
        As the endpoint is made with.
    kind
        ``SUBSCRIPTION`` or ``PUBLISHER``.

    Raises
    ------
    ConfigError
        An override is none of what its policy can be: names node, parameter and what was expected.

    """
    given = given_parameters(node)
    for policy in (QoSPolicyKind.DEPTH, *_CHOICES):
        name = f'{_PREFIX}.{node.resolve_topic_name(topic)}.{kind}.{policy.name.lower()}'
        expected = _expected(policy, given[name].value) if name in given else ''
        if expected:
            got = given[name].value
            raise ConfigError(f'{node.get_name()}: {name}: expected {expected}, got {got!r}')
    return QoSOverridingOptions((QoSPolicyKind.DEPTH, *_CHOICES))


def warn_of_unknown_overrides(node: Node) -> None:
    """Say which overrides were given for no endpoint that the node has: misspelt, most likely."""
    given = [name for name in given_parameters(node) if name.startswith(f'{_PREFIX}.')]
    known = [f'{_PREFIX}.{name}' for name in node.get_parameters_by_prefix(_PREFIX)]
    warn_of_unknown(node, [name for name in given if not name.startswith(_OF_ROS)], known)


def _expected(policy: QoSPolicyKind, value: Any) -> str:
    """Return what a policy can be, in words; nothing where the value is such a one."""
    if policy is QoSPolicyKind.DEPTH:
        is_count = isinstance(value, int) and not isinstance(value, bool)
        good = is_count and 0 <= value <= _MAX_DEPTH
        return '' if good else f'an integer from 0 to {_MAX_DEPTH}'
    names = [choice.name.lower() for choice in _CHOICES[policy] if choice.name != 'UNKNOWN']
    good = isinstance(value, str) and value.lower() in names
    return '' if good else f'one of {", ".join(names)}'
