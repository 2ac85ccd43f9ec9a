# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""Poses, marker corners and image frames to messages and back."""

from geometry_msgs.msg import PoseStamped
import numpy as np
from p4pfr_ros import DivisionCamera, Pose
from p4pfr_ros.ros.conversions import (
    camera_info_division_msg,
    camera_info_msg,
    correspondences_from_polygon,
    division_camera_from_msg,
    image_frame_from_msg,
    ImageFrame,
    pose_from_msg,
    pose_msg,
    pose_with_covariance_msg,
)
from p4pfr_ros.ros.conversions.poses import UNDETERMINED_VARIANCE
import pytest
import scenes
from sensor_msgs.msg import CameraInfo, RegionOfInterest

IMAGE_POINTS = np.random.default_rng(5).uniform(0, 640, (12, 2))


def test_a_marker_needs_its_size():
    """There is no default."""
    msg = scenes.polygon(1, scenes.project(scenes.ARUCO))
    assert correspondences_from_polygon(msg, 0.0, 'aruco_cw_from_top_left').cause == 'marker_size'
    points = correspondences_from_polygon(msg, scenes.MARKER_M, 'aruco_cw_from_top_left')
    np.testing.assert_allclose(points.board_points, scenes.ARUCO)


def test_corner_orders_name_the_same_corners():
    """ArUco's order reversed is AprilTag's."""
    corners = scenes.project(scenes.ARUCO)
    aruco = correspondences_from_polygon(scenes.polygon(1, corners), 0.1, 'aruco_cw_from_top_left')
    april = correspondences_from_polygon(
        scenes.polygon(1, corners[::-1]), 0.1, 'apriltag_ccw_from_bottom_left'
    )
    np.testing.assert_array_equal(april.image_points[::-1], aruco.image_points)
    np.testing.assert_array_equal(april.board_points[::-1], aruco.board_points)


def test_a_pose_survives_its_message():
    """Round trip."""
    back = pose_from_msg(pose_msg(scenes.header(1), scenes.CAMERA_FROM_BOARD))
    np.testing.assert_allclose(back.rotation, scenes.CAMERA_FROM_BOARD.rotation, atol=1e-15)
    np.testing.assert_array_equal(back.translation, scenes.CAMERA_FROM_BOARD.translation)


def test_a_quaternion_has_the_order_of_its_fields():
    """A rotation by 90 degrees about z has z = w = √½."""
    q = pose_msg(scenes.header(1), Pose.from_rotation_vector([0, 0, np.pi / 2], [1, 2, 3])).pose
    root = np.sqrt(0.5)
    o = q.orientation
    np.testing.assert_allclose([o.x, o.y, o.z, o.w], [0, 0, root, root], atol=1e-15)
    assert (q.position.x, q.position.y, q.position.z) == (1.0, 2.0, 3.0)


def test_a_zero_quaternion_is_an_error():
    """It is not a rotation."""
    msg = PoseStamped()
    msg.pose.orientation.w = 0.0
    with pytest.raises(ValueError, match='quaternion'):
        pose_from_msg(msg)


def test_undetermined_quantities_get_a_large_variance():
    """NaN and infinity are not published; the rest is unchanged and positive definite."""
    factor = np.random.default_rng(1).normal(size=(6, 6))
    original = factor @ factor.T
    covariance = original.copy()
    covariance[2, :] = covariance[:, 2] = np.nan
    covariance[5, 5] = np.inf
    msg = pose_with_covariance_msg(scenes.header(1), scenes.CAMERA_FROM_BOARD, covariance)
    published = msg.pose.covariance.reshape(6, 6)
    determined = np.ix_([0, 1, 3, 4], [0, 1, 3, 4])
    np.testing.assert_array_equal(published[determined], original[determined])
    for index in (2, 5):
        expected = np.zeros(6)
        expected[index] = UNDETERMINED_VARIANCE
        np.testing.assert_array_equal(published[index], expected)
    assert np.linalg.eigvalsh(published)[0] > 0.0


def test_pixels_of_a_binned_window_map_to_the_full_image():
    """A pixel covers the same area in both images."""
    msg = CameraInfo(width=1280, height=960, binning_x=2, binning_y=4)
    msg.roi = RegionOfInterest(x_offset=100, y_offset=40, width=640, height=480)
    frame = image_frame_from_msg(msg)
    assert frame.size == (1280, 960)
    # Pixel (0, 0) combines x = 100, 101 and y = 40 ... 43.
    np.testing.assert_array_equal(frame.full_from_sent(np.array([[0.0, 0.0]])), [[100.5, 41.5]])
    again = camera_info_msg(scenes.header(1), frame)
    assert (again.roi, again.binning_x, again.binning_y) == (msg.roi, 2, 4)


def test_without_binning_and_window_pixels_are_unchanged():
    """Binning 0 means 1."""
    frame = image_frame_from_msg(scenes.camera_info())
    np.testing.assert_array_equal(frame.full_from_sent(IMAGE_POINTS), IMAGE_POINTS)


@pytest.mark.parametrize('size', [(0, 480), (640, 0)])
def test_a_camera_info_without_size_is_rejected(size):
    """Only width and height are required."""
    assert image_frame_from_msg(scenes.camera_info(size)).cause == 'camera_info'


def test_a_division_camera_survives_its_message():
    """Round trip; another distortion_model is an error."""
    camera = DivisionCamera(512.5, (300.25, 200.5), -0.125)
    msg = camera_info_division_msg(scenes.header(1), ImageFrame((640, 480)), camera)
    assert division_camera_from_msg(msg) == camera
    msg.distortion_model = 'plumb_bob'
    with pytest.raises(ValueError, match='division'):
        division_camera_from_msg(msg)
