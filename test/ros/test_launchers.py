# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""Executables of ``ros2 run``: found in the ament index, started and stopped."""

from pathlib import Path
import signal
import subprocess
import time

from ament_index_python.packages import get_package_prefix, get_package_share_directory
import pytest
from rcl_interfaces.srv import GetParameters
import rclpy

pytestmark = pytest.mark.dds

# The nodes, their parameter files, and a signal that the launcher passes on.
NODES = [
    ('pose_node', 'pose_node', signal.SIGINT),
    ('lifecycle_pose_node', 'pose_node', signal.SIGTERM),
    ('detector_node', 'detector_node', signal.SIGTERM),
    ('camera_simulator', 'camera_simulator', signal.SIGINT),
    ('dashboard_node', 'dashboard_node', signal.SIGTERM),
]

# The first node on a machine compiles the kernels.
TIMEOUT_S = 200.0
RETRY_S = 3.0


@pytest.fixture
def observer(dds):
    """Give a node that calls the others."""
    node = rclpy.create_node('observer')
    yield node
    node.destroy_node()


@pytest.mark.parametrize(('name', 'config', 'number'), NODES)
def test_a_node_responds_and_exits_cleanly(name, config, number, observer):
    share = Path(get_package_share_directory('p4pfr_ros'))
    arguments = ['--ros-args', '--params-file', share / f'config/{config}.yaml']
    if config != 'pose_node':
        arguments += ['-p', f'board_file:={share}/config/boards/chessboard_9x6_25mm.yaml']
    if name == 'dashboard_node':
        arguments += ['-p', 'port:=0']
    executable = Path(get_package_prefix('p4pfr_ros'), 'lib', 'p4pfr_ros', name)
    process = subprocess.Popen([executable, *arguments])
    try:
        wait_for_response(observer, name, process)
        process.send_signal(number)
        assert process.wait(TIMEOUT_S) == 0
    finally:
        process.kill()
        process.wait()


def wait_for_response(observer, name, process):
    """Return once the parameter service of the node has responded, so that it spins."""
    client = observer.create_client(GetParameters, f'/{name}/get_parameters')
    request = GetParameters.Request(names=['use_sim_time'])
    ends_s = time.monotonic() + TIMEOUT_S
    call_s = 0.0
    futures = []
    while not any(future.done() for future in futures):
        assert process.poll() is None, f'{name} exited: {process.returncode}'
        assert time.monotonic() < ends_s, f'{name} did not respond'
        # A service may be discovered before it has discovered its client; then the response is
        # lost.
        if time.monotonic() > call_s and client.service_is_ready():
            futures.append(client.call_async(request))
            call_s = time.monotonic() + RETRY_S
        rclpy.spin_once(observer, timeout_sec=0.05)
    future = next(future for future in futures if future.done())
    assert len(future.result().values) == 1
