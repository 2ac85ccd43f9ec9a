# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""Nodes as processes: start, signals, errors and exit status."""

from pathlib import Path
import signal
import subprocess
import sys
import time

import pytest
from rcl_interfaces.srv import SetParameters
from rclpy.parameter import Parameter

pytestmark = pytest.mark.dds

BOARD = 'boards: {board: {type: chessboard, columns: 9, rows: 6, square_m: 0.025}}\n'
# The nodes and their parameter files.
NODES = {
    'pose_node': 'pose_node',
    'lifecycle_pose_node': 'pose_node',
    'detector_node': 'detector_node',
    'camera_simulator': 'camera_simulator',
    'dashboard_node': 'dashboard_node',
}


@pytest.fixture
def board_file(tmp_path):
    """Write a board file."""
    path = tmp_path / 'board.yaml'
    path.write_text(BOARD)
    return path


def required(name, board_file):
    """Return the parameters that a node cannot start without, and a port that is free."""
    parameters = {} if NODES[name] == 'pose_node' else {'board_file': board_file}
    return parameters | ({'port': 0} if name == 'dashboard_node' else {})


@pytest.mark.parametrize('number', [signal.SIGINT, signal.SIGTERM], ids=lambda n: n.name)
@pytest.mark.parametrize('name', NODES)
def test_a_node_reads_its_config_file_and_exits_cleanly(peer, board_file, name, number):
    """config/<node>.yaml has no unknown parameter; on a signal status 0 and no traceback."""
    config = Path(__file__).parents[2] / f'config/{NODES[name]}.yaml'
    parameters = required(name, board_file)
    node = peer.start(name, params_file=config, parameters=parameters)
    assert node.stop(number) == 0, node.output
    assert 'unknown parameter' not in node.output
    assert 'Traceback' not in node.output
    assert 'rror' not in node.output


SIGNALLED = """
import os, signal, sys, time
import rclpy
from rclpy.node import Node
from p4pfr_ros.ros.runtime.spin import run

def make():
    if '{stage}' == 'before the node':
        os.kill(os.getpid(), signal.{number})
    node = Node('early')
    if '{stage}' == 'after it':
        os.kill(os.getpid(), signal.{number})
    if '{stage}' == 'while spinning':
        node.create_timer(0.01, lambda: os.kill(os.getpid(), signal.{number}))
    if '{stage}' == 'while busy':
        ends = time.monotonic() + 60.0
        os.kill(os.getpid(), signal.{number})
        while time.monotonic() < ends:
            pass
        print('was not interrupted')
    return node

run(make)
print('ended')
"""


@pytest.mark.parametrize('stage', ['before the node', 'after it', 'while busy', 'while spinning'])
@pytest.mark.parametrize('number', ['SIGINT', 'SIGTERM'])
def test_a_signal_at_any_stage_exits_cleanly(number, stage):
    """A launch file may be interrupted while nodes start."""
    script = SIGNALLED.format(number=number, stage=stage)
    done = subprocess.run(
        [sys.executable, '-c', script], capture_output=True, text=True, timeout=200, check=False
    )
    assert (done.returncode, done.stdout, done.stderr) == (0, 'ended\n', '')


def test_a_signal_at_any_time_of_the_start_exits_cleanly(tmp_path):
    """With increasing delays, until the node is running."""
    for delay_s in (0.0, 0.01, 0.03, 0.06, 0.1, 0.2):
        process = subprocess.Popen(
            [
                sys.executable,
                '-c',
                'from p4pfr_ros.ros import pose_node; print("imported", flush=True); '
                'pose_node.main()',
            ],
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
        )
        assert process.stdout.readline() == 'imported\n'
        time.sleep(0.02 + delay_s)
        process.send_signal(signal.SIGTERM)
        errors = process.communicate(timeout=200)[1]
        assert process.returncode == 0, (delay_s, errors)


def _exits(name, *arguments):
    command = [sys.executable, '-m', f'p4pfr_ros.ros.{name}', '--ros-args', *arguments]
    done = subprocess.run(command, capture_output=True, text=True, timeout=200, check=False)
    return done.returncode, done.stderr.strip()


@pytest.mark.parametrize('name', ['detector_node', 'camera_simulator'])
def test_a_missing_board_file_is_an_error(name):
    """One line, exit status 1."""
    expected = f'{name}: board_file: expected the path of a board YAML, got none'
    assert _exits(name) == (1, expected)


def test_an_invalid_board_file_is_an_error_of_one_line(tmp_path):
    """It names file and key; markers are checked before the first image."""
    path = tmp_path / 'board.yaml'
    path.write_text(BOARD.replace('columns', 'colums'))
    status, line = _exits('detector_node', '-p', f'board_file:={path}')
    assert status == 1
    assert line.startswith(f'{path}: boards.board.colums: ')
    assert '\n' not in line
    path.write_text('boards: {b: {type: marker, id: 9999, size_m: 0.1, dictionary: DICT_4X4_50}}')
    status, line = _exits('detector_node', '-p', f'board_file:={path}')
    assert (status, line.startswith(f'{path}: boards.b.id: expected')) == (1, True)


def test_an_invalid_parameter_is_an_error_of_one_line():
    """It names node and parameter."""
    status, line = _exits('pose_node', '-p', 'marker.size_m:=-1.0')
    assert status == 1
    assert line.startswith('pose_node: marker.size_m: ')
    assert '\n' not in line


@pytest.mark.parametrize(
    'arguments', [('--params-file', '/there/is/none.yaml'), ('-r', '__node:=no-name'), ('-p',)]
)
def test_invalid_ros_arguments_exit_with_status_1(arguments):
    """For launch files."""
    status, output = _exits('pose_node', *arguments)
    assert status == 1
    assert output.splitlines()[-1].startswith('ROS arguments: ')


def test_parameter_services_validate_changes(peer):
    """The response of a rejected change has the reason."""
    peer.start('pose_node')
    changes = [
        Parameter('marker.corner_order', value='clockwise'),
        Parameter('robust.threshold_px', value=0.0),
        Parameter('robust.threshold_px', value=3.0),
    ]
    messages = [change.to_parameter_msg() for change in changes]
    response = peer.call(SetParameters, 'pose_node/set_parameters', parameters=messages)
    order, threshold, good = response.results
    assert 'expected one of aruco_cw_from_top_left, apriltag_ccw' in order.reason
    assert 'robust.threshold_px out of range' in threshold.reason
    assert [order.successful, threshold.successful, good.successful] == [False, False, True]


def test_a_misspelt_parameter_is_warned_of(peer):
    """ROS itself ignores it silently."""
    node = peer.start('pose_node', parameters={'marker.size': 0.1})
    assert 'unknown parameter marker.size is ignored (did you mean marker.size_m?)' in node.output
