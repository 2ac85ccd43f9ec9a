# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""Poses on /tf if the view determines them, and markers for subscribers."""

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
from p4pfr_ros.ros.parameters.pose_options import PoseNodeOptions
from p4pfr_ros.ros.pose.inputs import BoardObservation, MARKER
from p4pfr_ros.ros.pose.outputs import SceneOutputs
from p4pfr_ros.ros.runtime.endpoints import Endpoints
import pytest
import rclpy
import scenes
from visualization_msgs.msg import MarkerArray

TIMEOUT_S = 100.0
ON_TF = replace(PoseNodeOptions(), publish_tf=True)
IMAGE_POINTS = scenes.project(scenes.GRID)
OBSERVATION = BoardObservation(
    scenes.header(3),
    ImageFrame(scenes.SIZE),
    MARKER,
    Correspondences(IMAGE_POINTS, scenes.GRID, np.arange(len(scenes.GRID))),
    IMAGE_POINTS,
)


@pytest.fixture(scope='module')
def estimate():
    """Return an estimate that determines all quantities."""
    return estimate_pose(IMAGE_POINTS, scenes.GRID, image_size=scenes.SIZE)


@pytest.fixture
def node(dds, monkeypatch):
    """Give a node with endpoints and a replacement for tf2_ros that records transforms."""

    class Broadcaster:
        """Replaces that of tf2_ros, which only a ROS installation has."""

        def __init__(self, node):
            self.pub_tf = node.create_publisher(TransformStamped, '/tf_stand_in', 100)

        def sendTransform(self, transform):  # the name in tf2_ros
            node.sent.append(transform)

    module = ModuleType('tf2_ros')
    module.TransformBroadcaster = Broadcaster
    monkeypatch.setitem(sys.modules, 'tf2_ros', module)
    node = rclpy.create_node('with_scene', namespace=f'/scene_{time.monotonic_ns()}')
    node.sent, node.endpoints = [], Endpoints(node)
    yield node
    node.destroy_node()


@pytest.mark.parametrize('invert', [False, True])
def test_a_pose_is_on_tf_in_either_direction(node, estimate, invert):
    """With the frame of the parameters."""
    options = replace(ON_TF, invert_tf=invert, board_frame='dock')
    scene = SceneOutputs(node, node.endpoints)
    assert scene.is_awaited(options)
    scene.publish(OBSERVATION, estimate, options)
    pose = estimate.model.camera_from_board
    assert node.sent == [transform_msg(OBSERVATION.header, 'dock', pose, inverse=invert)]
    parents = {False: 'a_camera', True: 'dock'}
    assert node.sent[0].header.frame_id == parents[invert]


@pytest.mark.parametrize(
    ('undetermined', 'sent'),
    [('direction', 0), ('distance', 0), ('focal', 1), ('distortion', 1), (None, 1)],
)
def test_only_an_observable_pose_is_on_tf(node, estimate, undetermined, sent):
    """Direction and distance must be determined; focal length and distortion need not be."""
    changes = {} if undetermined is None else {undetermined: False}
    observable = replace(estimate.observable, **changes)
    SceneOutputs(node, node.endpoints).publish(
        OBSERVATION, replace(estimate, observable=observable), ON_TF
    )
    assert len(node.sent) == sent


def test_nothing_is_on_tf_without_a_model(node, estimate):
    """Nor without publish_tf."""
    scene = SceneOutputs(node, node.endpoints)
    scene.publish(OBSERVATION, replace(estimate, model=None), ON_TF)
    scene.publish(OBSERVATION, estimate, PoseNodeOptions())
    assert not node.sent


def test_all_publishers_are_destroyed_with_the_endpoints(node, estimate):
    """A node that is configured again has the same publishers."""
    before = [publisher.topic_name for publisher in node.publishers]
    for _ in range(2):
        SceneOutputs(node, node.endpoints).publish(OBSERVATION, estimate, ON_TF)
        assert len(list(node.publishers)) == len(before) + 2
        node.endpoints.close()
        assert [publisher.topic_name for publisher in node.publishers] == before


def test_markers_need_a_subscriber(node, estimate, monkeypatch):
    """Without one they are not computed."""
    made, received = [], []

    def markers(*args, **options):
        made.append(markers_msg(*args, **options))
        return made[-1]

    def spin_until(condition):
        ends_s = time.monotonic() + TIMEOUT_S
        while not condition() and time.monotonic() < ends_s:
            rclpy.spin_once(node, timeout_sec=0.01)

    monkeypatch.setattr('p4pfr_ros.ros.pose.outputs.markers_msg', markers)
    scene, options = SceneOutputs(node, node.endpoints), PoseNodeOptions()
    assert not scene.is_awaited(options)
    scene.publish(OBSERVATION, estimate, options)
    assert not made
    node.create_subscription(MarkerArray, '~/markers', received.append, 1)
    spin_until(lambda: scene.is_awaited(options))
    scene.publish(OBSERVATION, estimate, options)
    spin_until(lambda: received)
    assert len(made) == len(received) == 1
    assert [m.ns for m in received[0].markers] == [m.ns for m in made[0].markers]
