# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""What ``ros2 run`` does: find an executable in ament's index, start it, stop it."""

from pathlib import Path
import signal
import subprocess
import time

from ament_index_python.packages import get_package_prefix, get_package_share_directory
import pytest
from rcl_interfaces.srv import GetParameters
import rclpy

pytestmark = pytest.mark.dds

# The nodes, and the file of parameters that is theirs.
NODES = {
    'pose_node': 'pose_node',
    'lifecycle_pose_node': 'pose_node',
    'detector_node': 'detector_node',
    'camera_simulator': 'camera_simulator',
}

# A node that is the first on its machine compiles the kernels.
PATIENCE_S = 100.0
ASK_AGAIN_S = 3.0


@pytest.fixture
def observer(dds):
    """Give a node that looks at the others."""
    node = rclpy.create_node('observer')
    yield node
    node.destroy_node()


@pytest.mark.parametrize('number', [signal.SIGINT, signal.SIGTERM], ids=lambda n: n.name)
@pytest.mark.parametrize('name', NODES)
def test_node_answers_and_ends_cleanly(name, number, observer):
    share = Path(get_package_share_directory('p4pfr_ros'))
    arguments = ['--ros-args', '--params-file', share / f'config/{NODES[name]}.yaml']
    if NODES[name] != 'pose_node':
        arguments += ['-p', f'board_file:={share}/config/boards/chessboard_9x6_25mm.yaml']
    executable = Path(get_package_prefix('p4pfr_ros'), 'lib', 'p4pfr_ros', name)
    process = subprocess.Popen([executable, *arguments])
    try:
        wait_for_answer(observer, name, process)
        process.send_signal(number)
        assert process.wait(PATIENCE_S) == 0
    finally:
        process.kill()
        process.wait()


def wait_for_answer(observer, name, process):
    """Return once the node's own parameter service has answered: it is there and it spins."""
    client = observer.create_client(GetParameters, f'/{name}/get_parameters')
    request = GetParameters.Request(names=['use_sim_time'])
    ends_s = time.monotonic() + PATIENCE_S
    asks_s = 0.0
    answers = []
    while not any(answer.done() for answer in answers):
        assert process.poll() is None, f'{name} ended by itself: {process.returncode}'
        assert time.monotonic() < ends_s, f'{name} did not answer'
        # A service can be seen before it sees its client, and then its answer is lost: ask again.
        if time.monotonic() > asks_s and client.service_is_ready():
            answers.append(client.call_async(request))
            asks_s = time.monotonic() + ASK_AGAIN_S
        rclpy.spin_once(observer, timeout_sec=0.05)
    answer = next(answer for answer in answers if answer.done())
    assert len(answer.result().values) == 1
