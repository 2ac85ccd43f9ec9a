# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""pose_node while detector and camera are killed and started again."""

from pathlib import Path
import signal

from geometry_msgs.msg import PoseStamped
import numpy as np
from p4pfr_ros.ros.conversions import pose_from_msg
import pytest

BOARDS = Path(__file__).resolve().parents[2] / 'config/boards'
VIEWS = 12
# Share of the distance; much more than the median of a chessboard, much less than a wrong pose.
MAX_ERROR = 0.01


@pytest.mark.dds
def test_poses_resume_when_detector_and_camera_return(peer):
    """Both are killed and started again; pose_node keeps running."""
    poses = peer.subscribe(PoseStamped, 'pose_node/pose')
    truths = peer.subscribe(PoseStamped, 'camera_simulator/pose_true')
    board = {'board_file': BOARDS / 'chessboard_9x6_25mm.yaml'}
    parameters = {
        'detector_node': board,
        'camera_simulator': board | {'rate_hz': 10.0, 'path.speed': 5.0},
    }
    options = {name: {'parameters': values} for name, values in parameters.items()}
    pose_node, *others = peer.start_all({'pose_node': {}} | options)
    _assert_right(peer, poses, truths)
    for other in others:
        assert other.stop(signal.SIGKILL) == -signal.SIGKILL
    peer.spin_for()
    poses.clear()
    for other in others:
        assert poses == []
        peer.start(other.name, parameters=parameters[other.name])
    _assert_right(peer, poses, truths)
    assert pose_node.process.poll() is None


def _assert_right(peer, poses, truths):
    """Wait for some poses with their truth; the median error is small."""
    # Poses may arrive before the true poses of a restarted simulator.
    peer.until(lambda: len(_errors(poses, truths)) >= VIEWS)
    assert np.median(_errors(poses, truths)) < MAX_ERROR


def _errors(poses, truths):
    """Return the position errors, as shares of the distance, of poses with a true pose."""
    true_at = {(m.header.stamp.sec, m.header.stamp.nanosec): pose_from_msg(m) for m in truths}
    errors = []
    for msg in poses:
        true = true_at.get((msg.header.stamp.sec, msg.header.stamp.nanosec))
        if true is not None:
            error_m = np.linalg.norm(pose_from_msg(msg).translation - true.translation)
            errors.append(error_m / np.linalg.norm(true.translation))
    return errors
