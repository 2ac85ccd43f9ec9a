# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""Poses onto /tf: the transform, and what happens with and without ``tf2_ros``."""

import sys
from types import ModuleType

from geometry_msgs.msg import TransformStamped
import numpy as np
from p4pfr_ros import Pose
from p4pfr_ros.ros.conversions.poses import transform_msg
from p4pfr_ros.ros.pose.transforms import Transforms
from p4pfr_ros.ros.runtime.endpoints import Endpoints
import pytest
import rclpy
from rclpy.logging import LoggingSeverity
import scenes

POSE = scenes.CAMERA_FROM_BOARD
POINT_ON_BOARD = np.array([0.02, -0.05, 0.01])


def pose_of(msg):
    """Return parent_from_child."""
    t, q = msg.transform.translation, msg.transform.rotation
    return Pose.from_quaternion_xyzw([q.x, q.y, q.z, q.w], [t.x, t.y, t.z])


def test_a_transform_takes_points_of_the_child_to_the_parent():
    """The board is the child of the camera that the header names."""
    msg = transform_msg(scenes.header(3), 'board', POSE)
    assert (msg.header.frame_id, msg.child_frame_id) == ('a_camera', 'board')
    assert msg.header.stamp == scenes.header(3).stamp
    np.testing.assert_allclose(
        pose_of(msg).transform(POINT_ON_BOARD), POSE.transform(POINT_ON_BOARD), atol=1e-12
    )


def test_an_inverse_transform_has_the_camera_as_its_child():
    """Names and numbers change sides together, and the header that came stays as it is."""
    header = scenes.header(3)
    msg = transform_msg(header, 'board', POSE, inverse=True)
    assert (msg.header.frame_id, msg.child_frame_id) == ('board', 'a_camera')
    assert msg.header.stamp == header.stamp
    assert header == scenes.header(3)
    np.testing.assert_allclose(
        pose_of(msg).transform(POSE.transform(POINT_ON_BOARD)), POINT_ON_BOARD, atol=1e-12
    )


class _Broadcaster:
    """Stands in for tf2_ros's own, which only a ROS installation has; it keeps what it is sent."""

    def __init__(self, node):
        self.pub_tf = node.create_publisher(TransformStamped, '/tf_stand_in', 100)
        self.sent = node.sent = []

    def sendTransform(self, transform):  # its name there
        self.sent.append(transform)


@pytest.fixture
def node(dds, monkeypatch):
    """Make a node whose log is kept."""
    node = rclpy.create_node('with_transforms')
    said = node.said = []
    monkeypatch.setattr(
        type(node.get_logger()),
        'log',
        lambda _, text, severity, **__: said.append((severity, text)),
    )
    yield node
    node.destroy_node()


@pytest.fixture
def tf2_ros(monkeypatch):
    """Make a stand-in for tf2_ros."""
    module = ModuleType('tf2_ros')
    module.TransformBroadcaster = _Broadcaster
    monkeypatch.setitem(sys.modules, 'tf2_ros', module)


def test_poses_are_broadcast(node, tf2_ros):
    """In the way that was asked for."""
    transforms = Transforms(node, Endpoints(node))
    transforms.send(scenes.header(3), 'board', POSE)
    transforms.send(scenes.header(4), 'board', POSE, inverse=True)
    assert node.sent == [
        transform_msg(scenes.header(3), 'board', POSE),
        transform_msg(scenes.header(4), 'board', POSE, inverse=True),
    ]
    assert not node.said


def test_its_publisher_is_taken_down_with_the_others(node, tf2_ros):
    """As often as it is made: a node that is configured again has one."""
    before = [publisher.topic_name for publisher in node.publishers]
    for _ in range(2):
        endpoints = Endpoints(node)
        Transforms(node, endpoints)
        assert [p.topic_name for p in node.publishers] == [*before, '/tf_stand_in']
        endpoints.close()
        assert [p.topic_name for p in node.publishers] == before


@pytest.mark.parametrize('frame_id', ['', 'board'])
def test_a_transform_that_no_listener_takes_is_not_sent(node, tf2_ros, frame_id):
    """A frame without a name, and one that is its own parent."""
    Transforms(node, Endpoints(node)).send(scenes.header(3, frame_id), 'board', POSE)
    assert not node.sent
    ((severity, text),) = node.said
    assert severity == LoggingSeverity.WARN
    assert repr(frame_id) in text


def test_without_tf2_ros_one_line_says_so(node, monkeypatch):
    """And that is all: poses are sent in vain, without a word."""
    monkeypatch.setitem(sys.modules, 'tf2_ros', None)
    transforms = Transforms(node, Endpoints(node))
    transforms.send(scenes.header(3), 'board', POSE)
    transforms.send(scenes.header(3, ''), 'board', POSE)
    assert [text for _, text in node.said] == [
        'tf2_ros is not installed: nothing is published on /tf'
    ]
