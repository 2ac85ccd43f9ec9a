# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""Answers shown: on /tf what is known of where a board is, markers to whoever looks."""

from dataclasses import replace
import sys
import time
from types import ModuleType

from geometry_msgs.msg import TransformStamped
import numpy as np
from p4pfr_ros import estimate_pose
from p4pfr_ros.ros.conversions import Correspondences, ImageFrame
from p4pfr_ros.ros.conversions.markers import markers_msg
from p4pfr_ros.ros.conversions.poses import transform_msg
from p4pfr_ros.ros.parameters.image_node_options import PoseNodeOptions
from p4pfr_ros.ros.pose.scene import Scene
from p4pfr_ros.ros.pose.seen_board import SeenBoard
from p4pfr_ros.ros.pose.targets import MARKER
from p4pfr_ros.ros.runtime.endpoints import Endpoints
import pytest
import rclpy
import scenes
from visualization_msgs.msg import MarkerArray

PATIENCE_S = 20.0
ON_TF = replace(PoseNodeOptions(), publish_tf=True)
IMAGE_POINTS = scenes.seen(scenes.GRID)
BOARD = SeenBoard(
    scenes.header(3),
    ImageFrame(scenes.SIZE),
    MARKER,
    Correspondences(IMAGE_POINTS, scenes.GRID, np.arange(len(scenes.GRID))),
    IMAGE_POINTS,
)


@pytest.fixture(scope='module')
def estimate():
    """Return what the view tells: all of it."""
    return estimate_pose(IMAGE_POINTS, scenes.GRID, image_size=scenes.SIZE)


@pytest.fixture
def node(dds, monkeypatch):
    """Make a node that keeps what a stand-in for tf2_ros is sent, and the scene's endpoints."""

    class Broadcaster:
        """Stands in for tf2_ros's own, which only a ROS installation has."""

        def __init__(self, node):
            self.pub_tf = node.create_publisher(TransformStamped, '/tf_stand_in', 100)

        def sendTransform(self, transform):  # its name there
            node.sent.append(transform)

    module = ModuleType('tf2_ros')
    module.TransformBroadcaster = Broadcaster
    monkeypatch.setitem(sys.modules, 'tf2_ros', module)
    node = rclpy.create_node('with_scene', namespace=f'/scene_{time.monotonic_ns()}')
    node.sent, node.endpoints = [], Endpoints(node)
    yield node
    node.destroy_node()


@pytest.mark.parametrize('invert', [False, True])
def test_a_pose_is_on_tf_the_way_round_that_was_asked_for(node, estimate, invert):
    """With the names that were asked for, too."""
    options = replace(ON_TF, invert_tf=invert, board_frame='dock')
    scene = Scene(node, node.endpoints)
    assert scene.is_heard(options)
    scene.show(BOARD, estimate, options)
    pose = estimate.model.camera_from_board
    assert node.sent == [transform_msg(BOARD.header, 'dock', pose, inverse=invert)]
    parents = {False: 'a_camera', True: 'dock'}
    assert node.sent[0].header.frame_id == parents[invert]


@pytest.mark.parametrize(
    ('unknown', 'sent'),
    [('direction', 0), ('distance', 0), ('focal', 1), ('distortion', 1), (None, 1)],
)
def test_only_a_pose_that_is_known_is_on_tf(node, estimate, unknown, sent):
    """Its direction and its distance; what else a view does not tell is of no matter there."""
    known = {} if unknown is None else {unknown: False}
    observable = replace(estimate.observable, **known)
    Scene(node, node.endpoints).show(BOARD, replace(estimate, observable=observable), ON_TF)
    assert len(node.sent) == sent


def test_nothing_is_on_tf_of_a_view_without_an_answer(node, estimate):
    """Nor of any, unless it was asked for."""
    scene = Scene(node, node.endpoints)
    scene.show(BOARD, replace(estimate, model=None), ON_TF)
    scene.show(BOARD, estimate, PoseNodeOptions())
    assert not node.sent


def test_all_is_taken_down_with_the_endpoints(node, estimate):
    """A node that is configured again has no publisher more than the first time."""
    before = [publisher.topic_name for publisher in node.publishers]
    for _ in range(2):
        Scene(node, node.endpoints).show(BOARD, estimate, ON_TF)
        assert len(list(node.publishers)) == len(before) + 2
        node.endpoints.close()
        assert [publisher.topic_name for publisher in node.publishers] == before


def test_markers_are_made_for_whoever_looks(node, estimate, monkeypatch):
    """Not for nobody: that takes time; then for somebody, who gets them."""
    made, heard = [], []

    def markers(*args, **options):
        made.append(markers_msg(*args, **options))
        return made[-1]

    def spin_until(condition):
        ends_s = time.monotonic() + PATIENCE_S
        while not condition() and time.monotonic() < ends_s:
            rclpy.spin_once(node, timeout_sec=0.01)

    monkeypatch.setattr('p4pfr_ros.ros.pose.scene.markers_msg', markers)
    scene, options = Scene(node, node.endpoints), PoseNodeOptions()
    assert not scene.is_heard(options)
    scene.show(BOARD, estimate, options)
    assert not made
    node.create_subscription(MarkerArray, '~/markers', heard.append, 1)
    spin_until(lambda: scene.is_heard(options))
    scene.show(BOARD, estimate, options)
    spin_until(lambda: heard)
    assert len(made) == len(heard) == 1
    assert [m.ns for m in heard[0].markers] == [m.ns for m in made[0].markers]
