# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""The marker axes and corner orders of other packages, converted to ours."""

import cv2
import numpy as np
from p4pfr_ros.boards import Marker
from p4pfr_ros.boards.conventions import CONVENTIONS, CORNER_ORDERS
from p4pfr_ros.core.cameras.division import DivisionCamera
from p4pfr_ros.core.geometry import Pose
from p4pfr_ros.detection.aruco import detect_markers
from p4pfr_ros.rendering import render
import pytest

CAMERA = DivisionCamera(500.0, (319.5, 239.5))
MARKER = Marker(id=3, size_m=0.15, dictionary='DICT_4X4_50')
CAMERA_FROM_OURS = Pose.from_rotation_vector((0.4, -0.25, 0.2), (0.02, -0.03, 0.5)) @ Pose(
    np.diag([1.0, -1.0, -1.0]), np.zeros(3)
)
every_package = pytest.mark.parametrize('convention', CONVENTIONS.values(), ids=CONVENTIONS)


@every_package
def test_corners_in_all_axes_are_the_same_points(convention):
    """A package's corners in its axes and order, converted to our axes, equal ours."""
    theirs = np.pad(np.array(convention.corners), ((0, 0), (0, 1)))
    ours = convention.ours_from_theirs.transform(theirs)
    expected = np.pad(np.array(CORNER_ORDERS[convention.corner_order]), ((0, 0), (0, 1)))
    np.testing.assert_array_equal(ours, expected)


@every_package
def test_the_pose_of_a_package_follows_from_its_corners(convention):
    """OpenCV's PnP on its corners gives our pose, converted."""
    ours = np.pad(np.array(CORNER_ORDERS[convention.corner_order]), ((0, 0), (0, 1)))
    pixels = CAMERA.project(CAMERA_FROM_OURS.transform(MARKER.size_m * ours))
    theirs = np.pad(MARKER.size_m * np.array(convention.corners), ((0, 0), (0, 1)))
    matrix = np.array([[500.0, 0, 319.5], [0, 500.0, 239.5], [0, 0, 1.0]])
    found, rotation, translation = cv2.solvePnP(theirs, pixels, matrix, None)
    assert found
    expected = CAMERA_FROM_OURS @ convention.ours_from_theirs
    np.testing.assert_allclose(cv2.Rodrigues(rotation)[0], expected.rotation, atol=1e-5)
    np.testing.assert_allclose(translation.ravel(), expected.translation, atol=1e-5)


def test_opencv_gives_the_corners_in_aruco_order():
    image = render(MARKER, CAMERA, CAMERA_FROM_OURS, (640, 480), blur_sigma_px=0.5)
    corners, _, _ = detect_markers(image, MARKER.dictionary)
    ours = np.pad(np.array(CORNER_ORDERS['aruco_cw_from_top_left']), ((0, 0), (0, 1)))
    expected = CAMERA.project(CAMERA_FROM_OURS.transform(MARKER.size_m * ours))
    np.testing.assert_allclose(corners[0], expected, atol=1.5)


def test_the_rotation_to_apriltag_axes_as_a_quaternion():
    """As in docs/conventions.md, in the order of ROS: x, y, z, w."""
    quaternion = CONVENTIONS['AprilTag 3'].ours_from_theirs.quaternion_xyzw()
    np.testing.assert_allclose(np.abs(quaternion), [1.0, 0.0, 0.0, 0.0], atol=1e-15)
