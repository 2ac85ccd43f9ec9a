# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""
Real nodes as processes, and a peer that talks to them over DDS.

Every test module gets a namespace of its own, so nothing that runs at the same time can be
mistaken for it. Nothing sleeps for luck: a peer spins until a condition holds.
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
    # The ROS wheels' parser of message files imports a module that Python has deprecated.
    warnings.simplefilter('ignore', DeprecationWarning)
    import rosidl_generator_py  # noqa: F401

import p4pfr_ros.ros  # noqa: F401  (names the ament index)
import rclpy
from rclpy.qos import QoSProfile

PATIENCE_S = 40.0
ASK_AGAIN_S = 3.0


class NodeProcess:
    """One of our nodes as a process; its output is kept."""

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
        """Everything that the process has printed."""
        return self._log.read_text(errors='replace')

    def stop(self, number=signal.SIGINT):
        """Send a signal; return the exit status."""
        if self.process.poll() is None:
            self.process.send_signal(number)
        return self.wait()

    def wait(self):
        """Wait for the end; return the exit status."""
        try:
            return self.process.wait(PATIENCE_S)
        except subprocess.TimeoutExpired:
            self.process.kill()
            self.process.wait()
            raise


class Peer:
    """The other side of the conversation: publishes, listens, waits."""

    def __init__(self, namespace, folder):
        self.namespace = namespace
        self.node = rclpy.create_node('peer', namespace=namespace)
        self.processes = []
        self._folder = folder

    def start(self, name, **options):
        """Start a node in our namespace and wait until it says that it is ready."""
        log = self._folder / f'{name}_{len(self.processes)}.log'
        process = NodeProcess(name, self.namespace, log, **options)
        self.processes.append(process)
        self.until(lambda: process.process.poll() is not None or 'ready' in process.output)
        assert process.process.poll() is None, process.output
        return process

    def publisher(self, message_type, topic, depth=50):
        """Make a reliable publisher."""
        return self.node.create_publisher(message_type, topic, QoSProfile(depth=depth))

    def listen(self, message_type, topic, depth=50):
        """Return a list that fills itself with the messages of a topic."""
        heard = []
        self.node.create_subscription(message_type, topic, heard.append, QoSProfile(depth=depth))
        return heard

    def call(self, service_type, name, **request):
        """Ask a service, again if need be; return its answer."""
        client = self.node.create_client(service_type, name)
        answers, asks_s = [], [0.0]

        def ask():
            # It can be seen before it sees its client, and then its answer is lost.
            if client.service_is_ready() and time.monotonic() > asks_s[-1] + ASK_AGAIN_S:
                answers.append(client.call_async(service_type.Request(**request)))
                asks_s.append(time.monotonic())

        self.until(lambda: any(answer.done() for answer in answers), meanwhile=ask)
        self.node.destroy_client(client)
        return next(answer.result() for answer in answers if answer.done())

    def until(self, condition, patience_s=PATIENCE_S, meanwhile=None, every_s=0.1):
        """Spin until a condition holds, calling ``meanwhile`` now and then."""
        ends_s = time.monotonic() + patience_s
        next_s = 0.0
        while not condition():
            assert time.monotonic() < ends_s, 'waited in vain\n' + self.outputs()
            if meanwhile is not None and time.monotonic() >= next_s:
                next_s = time.monotonic() + every_s
                meanwhile()
            rclpy.spin_once(self.node, timeout_sec=0.02)

    def quiet(self, seconds=0.3):
        """Spin for a while: what should not come has had the time to."""
        ends_s = time.monotonic() + seconds
        while time.monotonic() < ends_s:
            rclpy.spin_once(self.node, timeout_sec=0.02)

    def outputs(self):
        """Return what all our processes have printed."""
        return '\n'.join(f'--- {p.name}\n{p.output}' for p in self.processes)

    def close(self):
        """Status our processes, one by one."""
        for process in self.processes:
            process.stop()
        self.node.destroy_node()


@pytest.fixture(scope='session')
def dds():
    """Make ROS live in this process."""
    rclpy.init()
    yield
    rclpy.try_shutdown()


def _peer(request, tmp_path_factory):
    folder = tmp_path_factory.mktemp('nodes')
    name = request.node.name.split('.')[0].split('[')[0].split('/')[-1]
    return Peer(f'/{name}_{os.getpid()}_{time.monotonic_ns()}', folder)


@pytest.fixture(scope='module')
def module_peer(request, dds, tmp_path_factory):
    """One peer, and what it started, for all tests of a module."""
    peer = _peer(request, tmp_path_factory)
    yield peer
    peer.close()


@pytest.fixture
def peer(request, dds, tmp_path_factory):
    """One peer, and what it started, for one test."""
    peer = _peer(request, tmp_path_factory)
    yield peer
    peer.close()
