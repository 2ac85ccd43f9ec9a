# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""Simulator, detector and pose node as processes recover the truth, with each kind of board."""

from pathlib import Path

from geometry_msgs.msg import PoseStamped
from node_process import stop_all
import numpy as np
from p4pfr_ros.core.geometry import rotation_angle_rad
from p4pfr_ros.ros.conversions import division_camera_from_msg, pose_from_msg
import pytest
from sensor_msgs.msg import CameraInfo

BOARDS = Path(__file__).resolve().parents[2] / 'config/boards'
FOCAL_PX, K = 520.0, -0.25
VIEWS = 30
# Position (share of the distance), rotation (degrees), focal length (share of it), k: ten times
# the measured median of 70 views. A marker's four points have less information than a board.
LIMITS = {
    'aprilgrid_6x6_88mm': (0.013, 0.27, 0.014, 0.037),
    'circle_grid_4x11_20mm': (0.005, 0.15, 0.006, 0.014),
    'bundle_36h11': (0.009, 0.2, 0.008, 0.018),
    'charuco_7x5_35mm': (0.004, 0.05, 0.004, 0.007),
    'chessboard_9x6_25mm': (0.002, 0.03, 0.002, 0.003),
    'marker_36h11_150mm': (0.05, 0.6, 0.05, 0.09),
    'marker_grid_4x3_50mm': (0.005, 0.1, 0.005, 0.007),
}


def test_every_board_has_limits():
    """A new board must be measured."""
    assert {path.stem for path in BOARDS.iterdir()} == set(LIMITS)


@pytest.fixture(scope='module')
def pose_node(module_peer):
    """One pose_node for all boards; the messages have the points of the board."""
    return module_peer.start('pose_node', parameters={'intrinsics.mode': 'per_frame'})


@pytest.mark.dds
@pytest.mark.parametrize('board', LIMITS)
def test_the_chain_recovers_the_truth(pose_node, module_peer, board):
    """Medians over some views, each estimated from a single image."""
    peer = module_peer
    truths = peer.subscribe(PoseStamped, 'camera_simulator/pose_true')
    poses = peer.subscribe(PoseStamped, 'pose_node/pose')
    cameras = peer.subscribe(CameraInfo, 'pose_node/camera_info_division')
    file = {'board_file': BOARDS / f'{board}.yaml'}
    lens = {'camera.focal_px': FOCAL_PX, 'camera.k': K}
    simulator = file | lens | {'rate_hz': 20.0, 'path.speed': 5.0}
    others = peer.start_all(
        {'detector_node': {'parameters': file}, 'camera_simulator': {'parameters': simulator}}
    )
    peer.until(lambda: len(_with_truth(poses, truths)) >= VIEWS)
    stop_all(others)
    true_at = {_nanoseconds(m): pose_from_msg(m) for m in truths}
    views = _with_truth(poses, truths)
    assert {m.header.frame_id for m in views} == {'camera_optical_frame'}
    errors = [_errors(pose_from_msg(m), true_at[_nanoseconds(m)]) for m in views]
    estimated = [division_camera_from_msg(m) for m in _with_truth(cameras, truths)]
    lenses = [(abs(c.focal_px / FOCAL_PX - 1.0), abs(c.k - K)) for c in estimated]
    medians = [*np.median(errors, axis=0), *np.median(lenses, axis=0)]
    assert all(np.array(medians) < LIMITS[board]), medians


def _with_truth(messages, truths):
    """Return the messages of images whose true pose is known."""
    known = {_nanoseconds(m) for m in truths}
    return [m for m in messages if _nanoseconds(m) in known]


def _errors(pose, true):
    error_m = np.linalg.norm(pose.translation - true.translation)
    error_rad = rotation_angle_rad(pose.rotation, true.rotation)
    return error_m / np.linalg.norm(true.translation), np.degrees(error_rad)


def _nanoseconds(msg):
    stamp = msg.header.stamp
    return 1_000_000_000 * stamp.sec + stamp.nanosec
