# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""A node whose camera was forgotten while the mode fixed looked through it; in process."""

import moving
from p4pfr_ros.ros.pose_node import PoseNode
import pytest
from rclpy.parameter import Parameter
import scenes


@pytest.fixture
def node(dds):
    """Give a node that has found its camera, and forgotten it in the mode fixed."""
    made = PoseNode()
    work = made._work
    work._answering.on_camera_info(scenes.camera_info())
    for moment in moving.moments(0, 12):
        work._inputs.on_correspondences(moment.cloud)
    assert set_parameter(made, 'intrinsics.mode', 'fixed').successful
    work._answering.reset()
    yield made
    made.destroy_node()


def set_parameter(node, name, value):
    """Set one parameter; return the result."""
    [result] = node.set_parameters([Parameter(name, value=value)])
    return result


def test_what_has_nothing_to_do_with_the_camera_can_be_changed(node):
    """Switched off above all."""
    assert set_parameter(node, 'enabled', False).successful
    assert set_parameter(node, 'robust.threshold_px', 3.0).successful


def test_what_has_to_do_with_it_must_bring_a_camera(node):
    """A focal length, or another mode."""
    refused = set_parameter(node, 'intrinsics.k', -0.1)
    assert not refused.successful
    assert 'intrinsics.focal_px: expected > 0 in the mode fixed' in refused.reason
    tiny = set_parameter(node, 'intrinsics.focal_px', 1e-6)
    assert not tiny.successful
    assert 'expected at least 0.001 px' in tiny.reason
    assert set_parameter(node, 'intrinsics.focal_px', 500.0).successful
    assert set_parameter(node, 'intrinsics.mode', 'self_calibrate').successful
