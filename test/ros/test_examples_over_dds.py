# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""The example node of examples/, over DDS."""

from contextlib import suppress
from pathlib import Path
import re
import signal
import subprocess
import sys

from geometry_msgs.msg import PoseStamped, PoseWithCovarianceStamped
import numpy as np
import pytest

ROOT = Path(__file__).resolve().parents[2]
pytestmark = pytest.mark.dds


def pose_message(second, position_sigma_m, angle_sigma_rad):
    """Make a pose, stamped with a second, with equal standard deviations along all axes."""
    message = PoseWithCovarianceStamped()
    message.header.frame_id, message.header.stamp.sec = 'camera', second
    message.pose.pose.position.z = 1.0
    variances = 3 * [position_sigma_m**2] + 3 * [angle_sigma_rad**2]
    message.pose.covariance = np.diag(variances).ravel().tolist()
    return message


@pytest.fixture
def example(peer, tmp_path):
    """Start the example node; return its process and the file that receives its output."""
    log = tmp_path / 'example.log'
    command = [sys.executable, str(ROOT / 'examples' / 'reject_uncertain.py'), '--ros-args']
    command += ['-r', f'__ns:={peer.namespace}', '-p', 'max_position_sigma_m:=0.05']
    with log.open('wb') as stream:
        process = subprocess.Popen(command, stdout=stream, stderr=subprocess.STDOUT)
    yield log
    for _ in range(20):
        # rclpy's executor may miss a signal that comes just before it waits.
        process.send_signal(signal.SIGINT)
        with suppress(subprocess.TimeoutExpired):
            assert process.wait(1.0) == 0, log.read_text()
            return
    process.kill()
    raise AssertionError(log.read_text())


def test_only_certain_poses_are_passed_on(peer, example):
    """Uncertain ones are logged; NaN and infinity are uncertain, too."""
    publisher = peer.publisher(PoseWithCovarianceStamped, 'pose_in')
    received = peer.subscribe(PoseStamped, 'pose_out')
    peer.until(
        lambda: (
            publisher.get_subscription_count()
            and peer.node.count_publishers(f'{peer.namespace}/pose_out')
        )
    )
    uncertain = [(2, 0.06, 0.01), (3, 0.01, 0.1), (4, np.nan, 0.01), (5, np.inf, 0.01)]
    for second, *sigmas in [(1, 0.04, 0.01), *uncertain, (6, 0.0, 0.0)]:
        publisher.publish(pose_message(second, *sigmas))
    peer.until(lambda: len(received) >= 2)
    peer.spin_for()
    assert [message.header.stamp.sec for message in received] == [1, 6]
    assert received[0].header.frame_id == 'camera'
    assert received[0].pose.position.z == 1.0
    assert re.search('rejected: position ± 0.060 m', example.read_text())
