# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""A node whose camera was reset in the mode fixed; in process."""

from in_process import call, publish, set_parameter
import moving
from p4pfr_ros.ros.pose_node import PoseNode
import pytest
import scenes


@pytest.fixture
def node(dds):
    """Give a node that estimated its camera, changed to the mode fixed and was reset."""
    node = PoseNode()
    publish(node, 'camera_info', scenes.camera_info())
    for view in moving.views(0, 12):
        publish(node, 'correspondences', view.cloud)
    assert set_parameter(node, 'intrinsics.mode', 'fixed').successful
    assert call(node, 'reset_calibration').success
    yield node
    node.destroy_node()


def test_parameters_that_do_not_concern_the_camera_can_be_changed(node):
    """Above all, the node can be disabled."""
    assert set_parameter(node, 'enabled', False).successful
    assert set_parameter(node, 'robust.threshold_px', 3.0).successful


def test_parameters_of_the_camera_must_provide_one(node):
    """By a focal length or another mode."""
    result = set_parameter(node, 'intrinsics.k', -0.1)
    assert not result.successful
    assert 'intrinsics.focal_px: expected > 0 in mode fixed' in result.reason
    tiny = set_parameter(node, 'intrinsics.focal_px', 1e-6)
    assert not tiny.successful
    assert 'expected at least 0.001 px' in tiny.reason
    assert set_parameter(node, 'intrinsics.focal_px', 500.0).successful
    assert set_parameter(node, 'intrinsics.mode', 'self_calibrate').successful
