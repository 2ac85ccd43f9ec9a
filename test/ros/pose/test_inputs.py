# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""From messages to the boards that they show; over DDS, other tests see them answered."""

import sys
from types import ModuleType

from geometry_msgs.msg import PolygonStamped
import numpy as np
from p4pfr_ros.ros.parameters.declare import Parameters
from p4pfr_ros.ros.parameters.image_node_options import PoseNodeOptions
from p4pfr_ros.ros.pose.inputs import Inputs
from p4pfr_ros.ros.pose.targets import MARKER, Targets
from p4pfr_ros.ros.runtime.rejections import Rejected
import pytest
import rclpy
from rclpy.parameter import Parameter
import scenes
from sensor_msgs.msg import PointCloud2
from test_detection_messages import AprilTagDetection, AprilTagDetectionArray, Point

BOARDS = """
boards:
  gate: {type: marker, id: 3, size_m: 0.12, dictionary: DICT_APRILTAG_36h11}
  door: {type: marker, id: 4, size_m: 0.06, dictionary: DICT_APRILTAG_36h11}
"""


class Heard:
    """Inputs of two boards, and what came of messages."""

    def __init__(self, node, folder):
        (folder / 'boards.yaml').write_text(BOARDS)
        self.answers = []
        targets = Targets(str(folder / 'boards.yaml'))
        config = Parameters(node, PoseNodeOptions())
        self.inputs = Inputs(targets, config, lambda *answer: self.answers.append(answer))


@pytest.fixture
def heard(dds, tmp_path):
    """Give inputs of a node that nobody talks to."""
    given = [Parameter('marker.size_m', value=scenes.MARKER_M)]
    node = rclpy.create_node('with_inputs', parameter_overrides=given)
    yield Heard(node, tmp_path)
    node.destroy_node()


def _detection(tag, corners):
    """Make a detection as apriltag_ros does: from the bottom left, half a pixel further."""
    points = [Point(x, y) for x, y in (corners[[3, 2, 1, 0]] + 0.5).tolist()]
    return AprilTagDetection(family='tag36h11', id=tag, corners=points)


def test_detections_are_sorted_by_board(heard):
    """One message, two boards, each with its corners in our order and its own size."""
    corners = scenes.seen(scenes.ARUCO)
    msg = AprilTagDetectionArray(
        scenes.header(5), [_detection(4, corners), _detection(3, corners), _detection(9, corners)]
    )
    heard.inputs.on_detections(msg)
    [(header, found)] = heard.answers
    assert header == msg.header
    assert [target.prefix for target, _ in found] == ['~/gate', '~/door']
    for (_, points), size_m in zip(found, (0.12, 0.06), strict=True):
        np.testing.assert_allclose(points.image_points, corners)
        np.testing.assert_allclose(np.ptp(points.board_points, axis=0), size_m)


def test_a_message_that_cannot_be_right_is_passed_on_with_its_reason(heard):
    """Whatever topic it came on."""
    heard.inputs.on_detections(
        AprilTagDetectionArray(scenes.header(1), [_detection(9, scenes.seen(scenes.ARUCO))])
    )
    heard.inputs.on_corners(scenes.polygon(2, []))
    cloud = scenes.board_cloud(3)
    cloud.data = cloud.data[:-1]
    heard.inputs.on_correspondences(cloud)
    found = [rejected for _, [rejected] in heard.answers]
    assert all(isinstance(rejected, Rejected) for rejected in found)
    assert [rejected.cause for rejected in found] == ['unknown_tags', 'point_count', 'truncated']


def test_a_bad_tag_is_passed_on_beside_the_boards_that_are_seen(heard):
    """With its reason."""
    good, bad = (_detection(tag, scenes.seen(scenes.ARUCO)) for tag in (4, 3))
    bad.corners[0] = Point(float('nan'), 1.0)
    heard.inputs.on_detections(AprilTagDetectionArray(scenes.header(1), [bad, good]))
    [(_, [rejected, (target, _)])] = heard.answers
    assert (rejected.cause, target.prefix) == ('not_finite', '~/door')


def test_a_cloud_of_nobody_knows_which_board_is_rejected(heard):
    """It is not the first one's by default."""
    heard.inputs.on_correspondences(scenes.board_cloud(3))
    [(_, [rejected])] = heard.answers
    assert rejected.cause == 'unknown_board'


class Topics:
    """What is subscribed to."""

    def __init__(self):
        self.callbacks = {}

    def subscribe(self, message_type, topic, callback):
        """Take note."""
        self.callbacks[topic] = message_type, callback


def test_detections_are_listened_to_where_their_package_and_boards_are(heard, monkeypatch):
    """The other topics always are."""
    always = {
        'corners': (PolygonStamped, heard.inputs.on_corners),
        'correspondences': (PointCloud2, heard.inputs.on_correspondences),
    }
    monkeypatch.setitem(sys.modules, 'apriltag_msgs', None)
    assert _topics(heard.inputs) == always
    package, messages = ModuleType('apriltag_msgs'), ModuleType('apriltag_msgs.msg')
    messages.AprilTagDetectionArray = AprilTagDetectionArray
    monkeypatch.setitem(sys.modules, 'apriltag_msgs', package)
    monkeypatch.setitem(sys.modules, 'apriltag_msgs.msg', messages)
    both = {'detections': (AprilTagDetectionArray, heard.inputs.on_detections)}
    assert _topics(heard.inputs) == always | both
    assert list(_topics(Inputs(Targets(''), None, None))) == list(always)


def _topics(inputs):
    topics = Topics()
    inputs.subscribe(topics)
    return topics.callbacks


def test_an_empty_array_of_detections_shows_nothing(heard):
    """It is not wrong either."""
    heard.inputs.on_detections(AprilTagDetectionArray(scenes.header(1), []))
    assert [list(found) for _, found in heard.answers] == [[]]


def test_corners_are_of_a_marker_that_no_file_knows_of(heard):
    """Though there are boards in a file."""
    heard.inputs.on_corners(scenes.polygon(2, scenes.seen(scenes.ARUCO)))
    [(_, [(target, _)])] = heard.answers
    assert target is MARKER
