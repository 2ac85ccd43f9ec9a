# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""Poses on /tf: the transform, with and without ``tf2_ros``."""

import sys
from types import ModuleType

from geometry_msgs.msg import TransformStamped
import numpy as np
from p4pfr_ros import Pose
from p4pfr_ros.ros.conversions.poses import transform_msg
from p4pfr_ros.ros.pose.outputs import Transforms
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


def test_a_transform_maps_points_of_the_child_to_the_parent():
    """The parent is the header's frame, the child the board frame."""
    msg = transform_msg(scenes.header(3), 'board', POSE)
    assert (msg.header.frame_id, msg.child_frame_id) == ('a_camera', 'board')
    assert msg.header.stamp == scenes.header(3).stamp
    np.testing.assert_allclose(
        pose_of(msg).transform(POINT_ON_BOARD), POSE.transform(POINT_ON_BOARD), atol=1e-12
    )


def test_an_inverse_transform_has_the_camera_as_its_child():
    """Names and numbers are inverted together; the given header is not modified."""
    header = scenes.header(3)
    msg = transform_msg(header, 'board', POSE, inverse=True)
    assert (msg.header.frame_id, msg.child_frame_id) == ('board', 'a_camera')
    assert msg.header.stamp == header.stamp
    assert header == scenes.header(3)
    np.testing.assert_allclose(
        pose_of(msg).transform(POSE.transform(POINT_ON_BOARD)), POINT_ON_BOARD, atol=1e-12
    )


class _Broadcaster:
    """Records transforms instead of tf2_ros, which only a ROS installation has."""

    def __init__(self, node):
        self.pub_tf = node.create_publisher(TransformStamped, '/tf_stand_in', 100)
        self.sent = node.sent = []

    def sendTransform(self, transform):  # the name in tf2_ros
        self.sent.append(transform)


@pytest.fixture
def node(dds, monkeypatch):
    """Give a node with a recorded log."""
    node = rclpy.create_node('with_transforms')
    logged = node.logged = []
    monkeypatch.setattr(
        type(node.get_logger()),
        'log',
        lambda _, text, severity, **__: logged.append((severity, text)),
    )
    yield node
    node.destroy_node()


@pytest.fixture
def tf2_ros(monkeypatch):
    """Replace tf2_ros."""
    module = ModuleType('tf2_ros')
    module.TransformBroadcaster = _Broadcaster
    monkeypatch.setitem(sys.modules, 'tf2_ros', module)


def test_poses_are_broadcast(node, tf2_ros):
    """In either direction."""
    transforms = Transforms(node, Endpoints(node))
    transforms.publish(scenes.header(3), 'board', POSE)
    transforms.publish(scenes.header(4), 'board', POSE, inverse=True)
    assert node.sent == [
        transform_msg(scenes.header(3), 'board', POSE),
        transform_msg(scenes.header(4), 'board', POSE, inverse=True),
    ]
    assert not node.logged


def test_its_publisher_is_destroyed_with_the_endpoints(node, tf2_ros):
    """A node that is configured again has one publisher."""
    before = [publisher.topic_name for publisher in node.publishers]
    for _ in range(2):
        endpoints = Endpoints(node)
        Transforms(node, endpoints)
        assert [p.topic_name for p in node.publishers] == [*before, '/tf_stand_in']
        endpoints.close()
        assert [p.topic_name for p in node.publishers] == before


@pytest.mark.parametrize('frame_id', ['', 'board'])
def test_an_invalid_transform_is_not_sent(node, tf2_ros, frame_id):
    """An empty frame_id, or a frame that is its own parent."""
    Transforms(node, Endpoints(node)).publish(scenes.header(3, frame_id), 'board', POSE)
    assert not node.sent
    ((severity, text),) = node.logged
    assert severity == LoggingSeverity.WARN
    assert repr(frame_id) in text


def test_without_tf2_ros_one_line_is_logged(node, monkeypatch):
    """Poses are not sent, and nothing else is logged."""
    monkeypatch.setitem(sys.modules, 'tf2_ros', None)
    transforms = Transforms(node, Endpoints(node))
    transforms.publish(scenes.header(3), 'board', POSE)
    transforms.publish(scenes.header(3, ''), 'board', POSE)
    assert [text for _, text in node.logged] == [
        'tf2_ros is not installed: nothing is published on /tf'
    ]
