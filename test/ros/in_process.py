# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""Calls the callbacks and services of a node in this process, without DDS."""

from rclpy.parameter import Parameter


def publish(node, topic, msg):
    """Call the callback of a subscription with a message."""
    [subscription] = [s for s in node.subscriptions if s.topic_name.endswith(f'/{topic}')]
    subscription.callback(msg)


def call(node, name, **request):
    """Call a service of the node; return the response."""
    [service] = [s for s in node.services if s.srv_name.endswith(f'/{name}')]
    return service.callback(service.srv_type.Request(**request), service.srv_type.Response())


def set_parameter(node, name, value):
    """Set one parameter; return the result."""
    [result] = node.set_parameters([Parameter(name, value=value)])
    return result
