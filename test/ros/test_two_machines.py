# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""Camera and detector on one machine, pose_node on another, with only a network between them."""

import os
from pathlib import Path
import signal
import subprocess
import sys

from namespaces import Machines, why_not
from node_process import NodeProcess, until
import pytest

IMPOSSIBLE = why_not()
pytestmark = [pytest.mark.dds, pytest.mark.skipif(bool(IMPOSSIBLE), reason=IMPOSSIBLE)]

BOARD = Path(__file__).resolve().parents[2] / 'config/boards/chessboard_9x6_25mm.yaml'
# Inside the namespaces there is no other network than the cable.
ENVIRONMENT = os.environ | {'ROS_AUTOMATIC_DISCOVERY_RANGE': 'SUBNET'}
POSES = 10
# A chessboard of 54 points of 16 bytes in each message.
BYTES_PER_POSE = 54 * 16

# Prints a letter for each pose and each calibrated camera that arrives.
LISTENER = """
import rclpy
from geometry_msgs.msg import PoseStamped
from rclpy.qos import DurabilityPolicy, QoSProfile
from sensor_msgs.msg import CameraInfo

rclpy.init()
node = rclpy.create_node('listener')
latched = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
show = lambda letter: lambda _: print(letter, end='', flush=True)
node.create_subscription(PoseStamped, 'pose_node/pose', show('p'), 10)
node.create_subscription(CameraInfo, 'pose_node/camera_info', show('c'), latched)
rclpy.spin(node)
"""


class Robot:
    """Starts our nodes, and listeners, on two machines."""

    def __init__(self, machines, folder):
        self._machines, self._folder = machines, folder
        self._processes = []

    def start(self, machine, name, **parameters):
        """Start a node."""
        log = self._folder / f'{len(self._processes)}.log'
        inside = self._machines.inside(machine)
        node = NodeProcess(name, '/', log, parameters, inside=inside, env=ENVIRONMENT)
        self._processes.append(node.process)
        return node

    def listen(self, machine):
        """Start a listener; return a function that counts what it has received by its letter."""
        log = self._folder / f'{len(self._processes)}.log'
        command = [*self._machines.inside(machine), sys.executable, '-c', LISTENER]
        with log.open('wb') as stream:
            process = subprocess.Popen(command, env=ENVIRONMENT, stdout=stream)
        self._processes.append(process)
        return lambda letter: log.read_text().count(letter)

    def close(self):
        """End all."""
        for process in self._processes:
            process.kill()
            process.wait()


@pytest.fixture
def machines():
    """Give two machines."""
    two = Machines()
    yield two
    two.close()


@pytest.fixture
def robot(machines, tmp_path):
    """Give the nodes' starter."""
    robot = Robot(machines, tmp_path)
    yield robot
    robot.close()


def test_nodes_on_two_machines_survive_each_other(robot, machines):
    """SIGKILL and return of either node; who comes late receives the latched camera."""
    heard = robot.listen('left')
    pose_node = robot.start('right', 'pose_node')
    detector = robot.start('left', 'detector_node', board_file=BOARD)
    camera = {'board_file': BOARD, 'rate_hz': 10.0, 'path.speed': 5.0}
    robot.start('left', 'camera_simulator', **camera)
    until(lambda: heard('p') >= POSES and heard('c'), pose_node, detector)
    assert machines.received_bytes('right') > POSES * BYTES_PER_POSE

    assert detector.stop(signal.SIGKILL) == -signal.SIGKILL
    late = robot.listen('left')
    until(lambda: late('c'), pose_node)
    assert late('p') == 0
    detector = robot.start('left', 'detector_node', board_file=BOARD)
    until(lambda: late('p') >= POSES, pose_node, detector)

    assert pose_node.stop(signal.SIGKILL) == -signal.SIGKILL
    before = late('p')
    pose_node = robot.start('right', 'pose_node')
    until(lambda: late('p') >= before + POSES, pose_node, detector)
