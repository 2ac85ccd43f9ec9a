# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""The pipeline of a node in this process: subscriptions, and the order of publishing."""

import time

from apriltag import AprilTagDetectionArray, isaac_detection
from geometry_msgs.msg import PolygonStamped
from in_process import publish, set_parameter
import moving
import numpy as np
from p4pfr_ros import CalibrationState, Status
from p4pfr_ros.ros.conversions import cloud_msg
from p4pfr_ros.ros.pose import pipeline
from p4pfr_ros.ros.pose.calibration_keeper import CalibrationKeeper
from p4pfr_ros.ros.pose.outputs import Outputs
from p4pfr_ros.ros.pose_node import PoseNode
from pose_node_client import assert_close
import pytest
from rclpy.parameter import Parameter
import scenes
from sensor_msgs.msg import CameraInfo, PointCloud2

BOARDS = """
boards:
  gate: {type: chessboard, columns: 9, rows: 6, square_m: 0.025}
"""
DOCK = 'boards: {dock: {type: marker, id: 3, size_m: 0.12, dictionary: DICT_APRILTAG_36h11}}'
ALWAYS = {'camera_info': CameraInfo, 'corners': PolygonStamped, 'correspondences': PointCloud2}


@pytest.fixture
def make(dds, tmp_path):
    """Make a node, with or without a board file."""
    nodes = []

    def make(boards=''):
        path = tmp_path / 'boards.yaml'
        path.write_text(boards)
        file = str(path) if boards else ''
        nodes.append(PoseNode(parameter_overrides=[Parameter('board_file', value=file)]))
        return nodes[-1]

    yield make
    for node in nodes:
        node.destroy_node()


# Stands in for AprilTagDetectionArray, which need not be installed.
@pytest.mark.parametrize('detections', [PolygonStamped, None], ids=['installed', 'missing'])
@pytest.mark.parametrize('boards', [BOARDS, ''], ids=['boards', 'no boards'])
@pytest.mark.parametrize(
    ('topic', 'type_of'),
    [
        ('detections', 'detection_array_type'),
        ('tag_detections', 'isaac_detection_array_type'),
    ],
)
def test_detections_need_boards_and_their_package(
    make, monkeypatch, boards, detections, topic, type_of
):
    """The other topics are always subscribed to."""
    monkeypatch.setattr(pipeline, type_of, lambda: detections)
    types = {s.topic_name.lstrip('/'): s.msg_type for s in make(boards).subscriptions}
    expected = ALWAYS | ({topic: detections} if boards and detections else {})
    assert {name: types.get(name) for name in expected} == expected
    assert (topic in types) == (topic in expected)


def test_tags_of_isaac_ros_give_the_pose(make, monkeypatch):
    """From the message on tag_detections to the published pose."""
    estimates = []
    monkeypatch.setattr(pipeline, 'isaac_detection_array_type', lambda: PolygonStamped)
    monkeypatch.setattr(Outputs, 'publish_pose', lambda *given: estimates.append(given[2]))
    node = make(DOCK)
    assert set_parameter(node, 'intrinsics.focal_px', scenes.CAMERA.focal_px).successful
    assert set_parameter(node, 'intrinsics.k', scenes.CAMERA.k).successful
    assert set_parameter(node, 'intrinsics.mode', 'fixed').successful
    assert set_parameter(node, 'publish_tf', True).successful
    publish(node, 'camera_info', scenes.camera_info())
    tags = [isaac_detection(3, scenes.project(scenes.ARUCO))]
    publish(node, 'tag_detections', AprilTagDetectionArray(scenes.header(1), tags))
    [estimate] = estimates
    assert_close(estimate.model.camera_from_board, scenes.CAMERA_FROM_BOARD)


def test_a_calibrated_camera_publishes_the_pose_before_it_is_updated(make, monkeypatch):
    """Publishing a pose is the first effect of a message once the camera is calibrated."""
    node, events = make(), []
    keepers = []
    publish_pose, follow = Outputs.publish_pose, CalibrationKeeper.follow

    def recorded_publish(self, observation, estimate, options):
        fused = keepers[-1].calibrations.fused if keepers else None
        events.append(('pose', estimate.model.camera, fused))
        publish_pose(self, observation, estimate, options)

    def recorded_follow(self, observation, options):
        keepers.append(self)
        events.append(('update', self.calibrations.fused.camera, self.calibrations.fused))
        return follow(self, observation, options)

    monkeypatch.setattr(Outputs, 'publish_pose', recorded_publish)
    monkeypatch.setattr(CalibrationKeeper, 'follow', recorded_follow)
    publish(node, 'camera_info', scenes.camera_info())
    for view in moving.views(0, 60):
        publish(node, 'correspondences', view.cloud)
    assert keepers[-1].calibrations.state is CalibrationState.CALIBRATED
    changes = 0
    for view in moving.views(60, 100):
        before = keepers[-1].calibrations.fused
        events.clear()
        publish(node, 'correspondences', view.cloud)
        (first, camera, fused), (second, _, after) = events
        assert (first, second) == ('pose', 'update')
        assert camera == before.camera
        assert fused is before
        changes += after is not before
    assert changes > 0


@pytest.mark.parametrize('mode', ['self_calibrate', 'per_frame', 'fixed'])
def test_a_mirrored_board_is_a_counted_rejection_unless_it_is_two_sided(make, monkeypatch, mode):
    """The parameter robust.two_sided takes effect with the next message."""
    node, estimates = make(), []
    monkeypatch.setattr(Outputs, 'is_awaited', lambda *_: True)
    monkeypatch.setattr(Outputs, 'publish_pose', lambda *given: estimates.append(given[2]))
    assert set_parameter(node, 'intrinsics.focal_px', 520.0).successful
    assert set_parameter(node, 'intrinsics.mode', mode).successful
    publish(node, 'camera_info', scenes.camera_info())
    mirrored = scenes.GRID * [-1.0, 1.0]
    image_points, ids = scenes.project(scenes.GRID), np.arange(len(mirrored))
    msg = cloud_msg(scenes.header(1), image_points, mirrored, ids)
    health = node._pipeline._reporter._health
    publish(node, 'correspondences', msg)
    assert estimates.pop().status is Status.SEEN_FROM_BEHIND
    assert health.rejections == {'seen_from_behind': 1}
    assert 'is the corner order right?' in health.status(time.monotonic()).message
    assert set_parameter(node, 'robust.two_sided', True).successful
    publish(node, 'correspondences', msg)
    assert estimates.pop().model.camera_from_board.tilt_deg > 90.0
    assert health.rejections == {'seen_from_behind': 1}


def test_coefficients_without_a_model_are_warned_of(make, monkeypatch, capfd):
    """In the mode camera_info, which is the only one that uses them."""
    monkeypatch.setattr(Outputs, 'is_awaited', lambda *_: True)
    node, msg = make(), scenes.camera_info()
    msg.k, msg.d = np.array([520.0, 0, 319.5, 0, 520.0, 239.5, 0, 0, 1]), [0.2, 0.0, 0.0, 0.0]
    for mode, expected in (('per_frame', False), ('camera_info', True)):
        assert set_parameter(node, 'intrinsics.mode', mode).successful
        publish(node, 'camera_info', msg)
        publish(node, 'correspondences', scenes.board_cloud(1))
        assert ('[no_distortion_model: 1 so far]' in capfd.readouterr().err) is expected
