# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""
Real nodes as processes, and a peer that communicates with them over DDS.

Each peer has its own namespace, so that tests running at the same time do not interfere. There
are no fixed sleeps: a peer spins until a condition holds.
"""

from __future__ import annotations

import os
from pathlib import Path
import signal
import subprocess
import sys
import time
import warnings

import pytest

with warnings.catch_warnings():
    # The parser of message files in the ROS wheels imports a deprecated module.
    warnings.simplefilter('ignore', DeprecationWarning)
    import rosidl_generator_py  # noqa: F401

from p4pfr_ros.kernels.processes import are_compiled, compile_all
import p4pfr_ros.ros  # noqa: F401  (names the ament index)
import rclpy
from rclpy.qos import QoSProfile

TIMEOUT_S = 40.0
RETRY_S = 3.0


class NodeProcess:
    """One of our nodes as a process, with its output."""

    def __init__(self, name, namespace, log, parameters=(), params_file=None, remaps=()):
        self.name = name
        self._log = Path(log)
        command = [sys.executable, '-m', f'p4pfr_ros.ros.{name}', '--ros-args']
        command += ['-r', f'__ns:={namespace}']
        for remap in remaps:
            command += ['-r', remap]
        if params_file is not None:
            command += ['--params-file', str(params_file)]
        for key, value in dict(parameters).items():
            command += ['-p', f'{key}:={value}']
        with self._log.open('wb') as stream:
            self.process = subprocess.Popen(
                command, stdin=subprocess.DEVNULL, stdout=stream, stderr=subprocess.STDOUT
            )

    @property
    def output(self):
        """The output of the process."""
        return self._log.read_text(errors='replace')

    def stop(self, number=signal.SIGINT):
        """Send a signal; return the exit status."""
        if self.process.poll() is None:
            self.process.send_signal(number)
        return self.wait()

    def wait(self):
        """Wait until it exits; return the exit status."""
        try:
            return self.process.wait(TIMEOUT_S)
        except subprocess.TimeoutExpired:
            self.process.kill()
            self.process.wait()
            raise


class Peer:
    """A node in this process that publishes, subscribes, calls services and starts other nodes."""

    def __init__(self, namespace, folder):
        self.namespace = namespace
        self.node = rclpy.create_node('peer', namespace=namespace)
        self.processes = []
        self._folder = folder

    def start(self, name, **options):
        """Start a node in our namespace and wait until it logs that it is ready."""
        log = self._folder / f'{name}_{len(self.processes)}.log'
        process = NodeProcess(name, self.namespace, log, **options)
        self.processes.append(process)
        self.until(lambda: process.process.poll() is not None or 'ready' in process.output)
        assert process.process.poll() is None, process.output
        return process

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
        """Stop our processes, one by one."""
        for process in self.processes:
            process.stop()
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
