# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""What becomes of pose_node when those that it listens to die and return."""

from pathlib import Path
import signal

from geometry_msgs.msg import PoseStamped
import numpy as np
from p4pfr_ros.ros.conversions import pose_from_msg
import pytest

BOARDS = Path(__file__).resolve().parents[2] / 'config/boards'
VIEWS = 12
# Of the distance; far more than the median of a chessboard's views, far less than a wrong one's.
CLOSE = 0.01


@pytest.mark.dds
def test_poses_resume_when_detector_and_camera_return(peer):
    """Both are killed, and started again; pose_node, which nobody tells, goes on rightly."""
    poses = peer.listen(PoseStamped, 'pose_node/pose')
    truths = peer.listen(PoseStamped, 'camera_simulator/pose_true')
    board = {'board_file': BOARDS / 'chessboard_9x6_25mm.yaml'}
    parameters = {
        'detector_node': board,
        'camera_simulator': board | {'rate_hz': 10.0, 'path.speed': 5.0},
    }
    pose_node = peer.start('pose_node')
    others = [peer.start(name, parameters=parameters[name]) for name in parameters]
    _assert_right(peer, poses, truths)
    for other in others:
        assert other.stop(signal.SIGKILL) == -signal.SIGKILL
    peer.quiet()
    poses.clear()
    for other in others:
        assert poses == []
        peer.start(other.name, parameters=parameters[other.name])
    _assert_right(peer, poses, truths)
    assert pose_node.process.poll() is None


def _assert_right(peer, poses, truths):
    """Wait for some poses of which the truth has come too; they are close to it."""
    # Poses may come some time before anybody hears of a truth that is started anew.
    peer.until(lambda: len(_errors(poses, truths)) >= VIEWS)
    assert np.median(_errors(poses, truths)) < CLOSE


def _errors(poses, truths):
    """Return how far the poses (of a distance) are from the truth of the same stamp."""
    true_at = {(m.header.stamp.sec, m.header.stamp.nanosec): pose_from_msg(m) for m in truths}
    errors = []
    for msg in poses:
        true = true_at.get((msg.header.stamp.sec, msg.header.stamp.nanosec))
        if true is not None:
            away = np.linalg.norm(pose_from_msg(msg).translation - true.translation)
            errors.append(away / np.linalg.norm(true.translation))
    return errors
