# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""
Parameters given when a node starts: unknown names, and QoS overrides.

ROS itself does not validate ``qos_overrides.<topic>.<kind>.<policy>``: an invalid value raises
one of many exceptions, and an override for a topic that the node does not have is ignored.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping
from difflib import get_close_matches
from typing import Any

from p4pfr_ros.files.yaml_fields import ConfigError
from rclpy.node import Node
from rclpy.parameter import Parameter
from rclpy.qos import DurabilityPolicy, HistoryPolicy, QoSPolicyKind, ReliabilityPolicy
from rclpy.qos_overriding_options import QoSOverridingOptions

SUBSCRIPTION, PUBLISHER = 'subscription', 'publisher'

_CHOICES = {
    QoSPolicyKind.HISTORY: HistoryPolicy,
    QoSPolicyKind.RELIABILITY: ReliabilityPolicy,
    QoSPolicyKind.DURABILITY: DurabilityPolicy,
}
_MAX_DEPTH = 2**31 - 1  # DDS counts in int32; 0 means the default of the middleware

_PREFIX = 'qos_overrides'
# ROS creates this subscription only if use_sim_time is set.
_CLOCK = f'{_PREFIX}./clock.'


def given_parameters(node: Node) -> Mapping[str, Parameter]:
    """Return the parameters that a node was given at its start, declared or not, by name."""
    # rclpy has no public access to them.
    given: Mapping[str, Parameter] = getattr(node, '_parameter_overrides', {})
    return given


def warn_of_unknown(node: Node, given: Iterable[str], known: Collection[str]) -> None:
    """Log a warning for each given name that is not known; most often it is misspelt."""
    for name in given:
        if name not in known:
            near = get_close_matches(name, known, n=1)
            hint = f' (did you mean {near[0]}?)' if near else ''
            node.get_logger().warning(f'unknown parameter {name} is ignored{hint}')


def warn_of_unknown_overrides(node: Node) -> None:
    """Log a warning for each QoS override that no endpoint of the node uses."""
    given = [name for name in given_parameters(node) if name.startswith(f'{_PREFIX}.')]
    known = [f'{_PREFIX}.{name}' for name in node.get_parameters_by_prefix(_PREFIX)]
    warn_of_unknown(node, [name for name in given if not name.startswith(_CLOCK)], known)


def overridable(node: Node, topic: str, kind: str) -> QoSOverridingOptions:
    """
    Let the user override history, depth, reliability and durability of an endpoint.

    Parameters
    ----------
    node
        The node of the endpoint.
    topic
        The topic name that the endpoint is created with.
    kind
        ``SUBSCRIPTION`` or ``PUBLISHER``.

    Raises
    ------
    ConfigError
        The value of an override is invalid; the message names node, parameter and valid values.

    """
    given = given_parameters(node)
    for policy in (QoSPolicyKind.DEPTH, *_CHOICES):
        name = f'{_PREFIX}.{node.resolve_topic_name(topic)}.{kind}.{policy.name.lower()}'
        expected = _expected(policy, given[name].value) if name in given else ''
        if expected:
            got = given[name].value
            raise ConfigError(f'{node.get_name()}: {name}: expected {expected}, got {got!r}')
    return QoSOverridingOptions((QoSPolicyKind.DEPTH, *_CHOICES))


def is_overridden(node: Node, topic: str, kind: str, policy: str) -> bool:
    """Return whether the user overrides a policy of an endpoint."""
    name = f'{_PREFIX}.{node.resolve_topic_name(topic)}.{kind}.{policy}'
    return name in given_parameters(node)


def _expected(policy: QoSPolicyKind, value: Any) -> str:
    """Return the valid values of a policy as text; an empty text if the value is valid."""
    if policy is QoSPolicyKind.DEPTH:
        is_count = isinstance(value, int) and not isinstance(value, bool)
        valid = is_count and 0 <= value <= _MAX_DEPTH
        return '' if valid else f'an integer from 0 to {_MAX_DEPTH}'
    names = [choice.name.lower() for choice in _CHOICES[policy] if choice.name != 'UNKNOWN']
    valid = isinstance(value, str) and value.lower() in names
    return '' if valid else f'one of {", ".join(names)}'
