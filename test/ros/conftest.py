# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""
Real nodes as processes, and a peer that communicates with them over DDS.

Each peer has its own namespace, so that tests running at the same time do not interfere. There
are no fixed sleeps: a peer spins until a condition holds.
"""

from __future__ import annotations

from contextlib import suppress
import os
import time
import warnings

from node_process import NodeProcess, stop_all, TIMEOUT_S
import pytest

with warnings.catch_warnings(), suppress(ImportError):
    # The parser of message files in the ROS wheels imports a deprecated module. A ROS that is
    # installed from packages may not have it.
    warnings.simplefilter('ignore', DeprecationWarning)
    import rosidl_generator_py  # noqa: F401

from p4pfr_ros.kernels.processes import are_compiled, compile_all
import p4pfr_ros.ros  # noqa: F401  (names the ament index)
import rclpy
from rclpy.qos import QoSProfile

RETRY_S = 3.0


class Peer:
    """A node in this process that publishes, subscribes, calls services and starts other nodes."""

    def __init__(self, namespace, folder):
        self.namespace = namespace
        self.node = rclpy.create_node('peer', namespace=namespace)
        self.processes = []
        self._folder = folder

    def start(self, name, **options):
        """Start a node in our namespace and wait until it logs that it is ready."""
        [process] = self.start_all({name: options})
        return process

    def start_all(self, options):
        """Start nodes at the same time, by name and options; wait until all are ready."""
        started = []
        for name, of_node in options.items():
            log = self._folder / f'{name}_{len(self.processes)}.log'
            started.append(NodeProcess(name, self.namespace, log, **of_node))
            self.processes.append(started[-1])
        for node in started:
            self.until(lambda n=node: n.process.poll() is not None or 'ready' in n.output)
            assert node.process.poll() is None, node.output
        return started

    def publisher(self, message_type, topic, depth=50):
        """Create a reliable publisher."""
        return self.node.create_publisher(message_type, topic, QoSProfile(depth=depth))

    def subscribe(self, message_type, topic, depth=50):
        """Subscribe; return the list that receives the messages."""
        received = []
        self.node.create_subscription(
            message_type, topic, received.append, QoSProfile(depth=depth)
        )
        return received

    def call(self, service_type, name, **request):
        """Call a service, repeatedly if needed; return its response."""
        client = self.node.create_client(service_type, name)
        futures, called_s = [], [0.0]

        def call():
            # A service may be discovered before it has discovered its client; then the response
            # is lost.
            if client.service_is_ready() and time.monotonic() > called_s[-1] + RETRY_S:
                futures.append(client.call_async(service_type.Request(**request)))
                called_s.append(time.monotonic())

        self.until(lambda: any(future.done() for future in futures), meanwhile=call)
        self.node.destroy_client(client)
        return next(future.result() for future in futures if future.done())

    def until(self, condition, timeout_s=TIMEOUT_S, meanwhile=None, every_s=0.1):
        """Spin until a condition holds, calling ``meanwhile`` periodically."""
        ends_s = time.monotonic() + timeout_s
        next_s = 0.0
        while not condition():
            assert time.monotonic() < ends_s, 'timeout\n' + self.outputs()
            if meanwhile is not None and time.monotonic() >= next_s:
                next_s = time.monotonic() + every_s
                meanwhile()
            rclpy.spin_once(self.node, timeout_sec=0.02)

    def spin_for(self, seconds=0.3):
        """Spin for a time, so that an unexpected message would arrive."""
        ends_s = time.monotonic() + seconds
        while time.monotonic() < ends_s:
            rclpy.spin_once(self.node, timeout_sec=0.02)

    def outputs(self):
        """Return the output of all our processes."""
        return '\n'.join(f'--- {p.name}\n{p.output}' for p in self.processes)

    def close(self):
        """Stop our processes."""
        stop_all(self.processes)
        self.node.destroy_node()


@pytest.fixture(scope='session', autouse=True)
def _stored_kernels():
    """Compile the kernels, unless they are stored; otherwise nodes reject the first messages."""
    if not are_compiled():
        compile_all(lambda _: None)


@pytest.fixture(scope='session')
def dds():
    """Initialise ROS in this process."""
    rclpy.init()
    yield
    rclpy.try_shutdown()


def _peer(request, tmp_path_factory):
    folder = tmp_path_factory.mktemp('nodes')
    name = request.node.name.split('.')[0].split('[')[0].split('/')[-1]
    return Peer(f'/{name}_{os.getpid()}_{time.monotonic_ns()}', folder)


@pytest.fixture(scope='module')
def module_peer(request, dds, tmp_path_factory):
    """One peer and its processes for all tests of a module."""
    peer = _peer(request, tmp_path_factory)
    yield peer
    peer.close()


@pytest.fixture
def peer(request, dds, tmp_path_factory):
    """One peer and its processes for one test."""
    peer = _peer(request, tmp_path_factory)
    yield peer
    peer.close()
