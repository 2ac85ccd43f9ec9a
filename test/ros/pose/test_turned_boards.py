# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""A board that looks the same after a turn: its poses in the node, from image to image."""

from geometry_msgs.msg import PoseArray, PoseStamped
from in_process import publish, set_parameter
import numpy as np
from p4pfr_ros import Pose
from p4pfr_ros.boards import Chessboard
from p4pfr_ros.core.geometry import rotation_angle_rad
from p4pfr_ros.ros.conversions import cloud_msg, pose_from_msg
from p4pfr_ros.ros.pose.outputs import Outputs
from p4pfr_ros.ros.pose_node import PoseNode
import pytest
from rclpy.parameter import Parameter
import scenes

BOARDS = """
boards:
  board: {type: chessboard, columns: 7, rows: 5, square_m: 0.025}
"""
POINTS = Chessboard(columns=7, rows=5, square_m=0.025).points


@pytest.fixture
def make(dds, tmp_path, monkeypatch):
    """Make a node in mode fixed that records what it gives to its topics."""
    nodes = []

    def make(boards=BOARDS):
        path = tmp_path / 'boards.yaml'
        path.write_text(boards)
        overrides = {
            'board_file': str(path),
            'intrinsics.mode': 'fixed',
            'intrinsics.focal_px': scenes.CAMERA.focal_px,
            'intrinsics.k': scenes.CAMERA.k,
        }
        parameters = [Parameter(name, value=value) for name, value in overrides.items()]
        nodes.append(PoseNode(parameter_overrides=parameters))
        publish(nodes[-1], 'camera_info', scenes.camera_info())
        return nodes[-1]

    monkeypatch.setattr(Outputs, 'is_awaited', lambda *_: True)
    yield make
    for node in nodes:
        node.destroy_node()


def rolled(roll_deg):
    """Return a pose of the board, rotated about its z axis."""
    roll = Pose.from_rotation_vector([0.0, 0.0, np.radians(roll_deg)], np.zeros(3))
    return scenes.CAMERA_FROM_BOARD @ roll


def cloud(roll_deg, second, *, turned=False):
    """Make the cloud of a detector; turned: it began at the opposite corner."""
    points = -POINTS if turned else POINTS
    pixels = scenes.project(POINTS, rolled(roll_deg))
    return cloud_msg(scenes.header(second), pixels, points, np.arange(len(points)))


def record(monkeypatch):
    """Return the list of what is given to the topics: observation and estimate."""
    given = []
    monkeypatch.setattr(Outputs, 'publish_pose', lambda _, *arguments: given.append(arguments[:2]))
    return given


def angle_deg(estimate, roll_deg):
    rotation = estimate.model.camera_from_board.rotation
    return np.degrees(rotation_angle_rad(rotation, rolled(roll_deg).rotation))


def test_the_orientation_continues_where_the_detector_begins_at_another_corner(make, monkeypatch):
    node, given = make(), record(monkeypatch)
    for second, roll_deg in enumerate(range(0, 400, 20)):
        publish(node, 'correspondences', cloud(roll_deg, second, turned=roll_deg > 90))
        observation, estimate = given.pop()
        assert angle_deg(estimate, roll_deg) < 0.1
        [other] = estimate.alternatives
        assert rotation_angle_rad(
            other.camera_from_board.rotation, rolled(roll_deg + 180.0).rotation
        ) == pytest.approx(0.0, abs=2e-3)
        # The points of ~/markers are turned too: their residuals stay small.
        pixels = scenes.project(observation.points.board_points, estimate.model.camera_from_board)
        assert np.abs(pixels - observation.image_points).max() < 0.01


def test_after_more_than_a_second_the_detector_decides(make, monkeypatch):
    node, given = make(), record(monkeypatch)
    publish(node, 'correspondences', cloud(0.0, 1))
    publish(node, 'correspondences', cloud(0.0, 3, turned=True))
    assert [round(angle_deg(estimate, 0.0)) for _, estimate in given] == [0, 180]


def test_the_alternative_is_published(make, monkeypatch):
    node, sent = make(), []
    monkeypatch.setattr('p4pfr_ros.ros.pose.outputs.is_awaited', lambda *_: True)
    for publisher in node.publishers:
        if publisher.topic_name.endswith(('/pose', '/alternatives')):
            monkeypatch.setattr(publisher, 'publish', sent.append)
    publish(node, 'correspondences', cloud(0.0, 1))
    [pose] = [msg for msg in sent if isinstance(msg, PoseStamped)]
    [others] = [msg for msg in sent if isinstance(msg, PoseArray)]
    other = PoseStamped(pose=others.poses[0])
    turn = pose_from_msg(pose).rotation.T @ pose_from_msg(other).rotation
    np.testing.assert_allclose(turn, np.diag([-1.0, -1.0, 1.0]), atol=1e-6)


def test_the_symmetry_is_logged_once_at_the_start_and_is_no_ambiguity(make, monkeypatch):
    lines = []
    monkeypatch.setattr(
        'rclpy.impl.rcutils_logger.RcutilsLogger.warning', lambda _, text, **__: lines.append(text)
    )
    node = make()
    for second in range(3):
        publish(node, 'correspondences', cloud(0.0, second))
    [line] = [line for line in lines if 'looks the same after a turn of 180 degrees' in line]
    assert line.startswith('board: ')
    assert not any('ambiguous' in reason for reason in node._pipeline._reporter._health._reasons)
    lines.clear()
    make(BOARDS.replace('7', '8'))
    assert lines == []


@pytest.mark.parametrize('mode', ['self_calibrate', 'per_frame'])
def test_every_mode_has_the_turned_pose(make, monkeypatch, mode):
    node, given = make(), record(monkeypatch)
    assert set_parameter(node, 'intrinsics.mode', mode).successful
    for second in range(3):
        publish(node, 'correspondences', cloud(30.0, second, turned=second == 1))
        _, estimate = given.pop()
        assert angle_deg(estimate, 30.0) < 2.0
        assert len(estimate.alternatives) % 2 == 1
