# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""A node without compiled kernels answers while it compiles them."""

from pathlib import Path
import shutil
import signal
import subprocess
import sys

from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import PoseStamped
import p4pfr_ros
from p4pfr_ros.core import jit
from p4pfr_ros.ros.conversions import pose_from_msg
from pose_node_client import assert_close
import pytest
from rcl_interfaces.srv import GetParameters
import scenes
from sensor_msgs.msg import CameraInfo, PointCloud2

pytestmark = [
    pytest.mark.dds,
    pytest.mark.skipif(not jit.COMPILED, reason='nothing is compiled'),
]


@pytest.fixture
def cold_node(peer, tmp_path, monkeypatch):
    """Start a pose_node of a copy of the package without kernels, with an empty cache."""
    package = Path(p4pfr_ros.__file__).parent
    ignored = shutil.ignore_patterns('_kernels', '__pycache__')
    shutil.copytree(package, tmp_path / 'site/p4pfr_ros', ignore=ignored)
    monkeypatch.setenv('PYTHONPATH', str(tmp_path / 'site'))
    monkeypatch.setenv('NUMBA_CACHE_DIR', str(tmp_path / 'cache'))
    log = tmp_path / 'log'
    command = [sys.executable, '-m', 'p4pfr_ros.ros.pose_node']
    with log.open('wb') as stream:
        node = subprocess.Popen(
            [*command, '--ros-args', '-r', f'__ns:={peer.namespace}'],
            cwd=tmp_path,
            stdout=stream,
            stderr=subprocess.STDOUT,
        )
    yield node, log
    if node.poll() is None:
        node.kill()
        node.wait()


def test_a_node_without_kernels_answers_while_it_compiles(peer, cold_node):
    """Parameters, diagnostics and poses, before it is ready; a signal ends it at once."""
    node, log = cold_node
    reports = peer.subscribe(DiagnosticArray, '/diagnostics')
    poses = peer.subscribe(PoseStamped, 'pose_node/pose')
    camera_info = peer.publisher(CameraInfo, 'camera_info')
    clouds = peer.publisher(PointCloud2, 'correspondences')
    response = peer.call(GetParameters, 'pose_node/get_parameters', names=['intrinsics.mode'])
    assert response.values[0].string_value == 'self_calibrate'

    def publish():
        camera_info.publish(scenes.camera_info())
        clouds.publish(scenes.board_cloud(1))

    def is_reported():
        statuses = [status for report in reports for status in report.status]
        return any(
            status.message.startswith('compiling kernels, ')
            and any(value.key == 'rejected.compiling' for value in status.values)
            for status in statuses
        )

    peer.until(lambda: poses and is_reported(), meanwhile=publish)
    assert_close(pose_from_msg(poses[0]), scenes.CAMERA_FROM_BOARD)
    assert 'compiling the kernels' in log.read_text()
    assert 'ready' not in log.read_text()
    node.send_signal(signal.SIGINT)
    assert node.wait(20) == 0
    assert 'Traceback' not in log.read_text()
