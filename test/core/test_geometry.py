# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""Poses: group laws, quaternions, and error messages."""

from hypothesis import given
from hypothesis import strategies as st
import numpy as np
from p4pfr_ros import Pose
from p4pfr_ros.core.geometry import as_points, rotation_angle_rad, rotation_from_vector
import pytest

vectors = st.tuples(*[st.floats(-3.0, 3.0)] * 3).map(np.array)
poses = st.builds(Pose.from_rotation_vector, vectors, vectors)


@given(poses, poses, poses)
def test_composition_is_associative_and_transforms_points(a, b, c):
    left, right = (a @ b) @ c, a @ (b @ c)
    np.testing.assert_allclose(left.rotation, right.rotation, atol=1e-14)
    np.testing.assert_allclose(left.translation, right.translation, atol=1e-13)
    points = np.arange(12.0).reshape(4, 3)
    np.testing.assert_allclose(
        (a @ b).transform(points), a.transform(b.transform(points)), atol=1e-12
    )


@given(poses)
def test_a_pose_times_its_inverse_is_the_identity(pose):
    round_trip = pose @ pose.inverse()
    np.testing.assert_allclose(round_trip.rotation, np.eye(3), atol=1e-14)
    np.testing.assert_allclose(round_trip.translation, 0.0, atol=1e-13)


@given(poses)
def test_a_quaternion_converts_back_to_the_same_rotation(pose):
    quaternion = pose.quaternion_xyzw()
    assert quaternion[3] >= 0.0
    assert np.linalg.norm(quaternion) == pytest.approx(1.0, abs=1e-15)
    back = Pose.from_quaternion_xyzw(3.0 * quaternion, pose.translation)
    assert rotation_angle_rad(back.rotation, pose.rotation) < 1e-14


@pytest.mark.parametrize('axis', np.eye(3))
def test_half_turns_have_a_quaternion(axis):
    pose = Pose.from_rotation_vector(np.pi * axis, np.zeros(3))
    np.testing.assert_allclose(np.abs(pose.quaternion_xyzw()), [*axis, 0.0], atol=1e-15)


def test_a_quaternion_has_the_order_and_sign_of_ros():
    quarter_about_z = Pose.from_rotation_vector([0.0, 0.0, np.pi / 2.0], np.zeros(3))
    half = np.sqrt(0.5)
    np.testing.assert_allclose(quarter_about_z.quaternion_xyzw(), [0.0, 0.0, half, half])
    np.testing.assert_allclose(
        quarter_about_z.transform([1.0, 0.0, 0.0]), [0.0, 1.0, 0.0], atol=1e-15
    )


@pytest.mark.parametrize('angle', [1e-12, 1e-7, 0.3, 2.0, np.pi - 1e-7])
def test_the_angle_between_rotations_is_exact(angle):
    axis = np.array([0.6, 0.0, 0.8])
    rotated = rotation_from_vector(angle * axis)
    assert rotation_angle_rad(rotated, np.eye(3)) == pytest.approx(angle, rel=1e-3, abs=1e-15)


@pytest.mark.parametrize(
    ('rotation', 'translation', 'message'),
    [
        (np.eye(2), np.zeros(3), r'rotation must have shape \(3, 3\), got \(2, 2\)'),
        (np.eye(3), np.zeros(2), r'translation must have shape \(3,\), got \(2,\)'),
        (2.0 * np.eye(3), np.zeros(3), 'must be a rotation matrix'),
        (np.diag([1.0, 1.0, -1.0]), np.zeros(3), 'must be a rotation matrix'),
        (np.eye(3), [0.0, np.nan, 0.0], r'translation must be finite, got nan at \[1\]'),
    ],
)
def test_an_invalid_pose_is_rejected(rotation, translation, message):
    with pytest.raises(ValueError, match=message):
        Pose(rotation, translation)


def test_a_zero_quaternion_is_rejected():
    with pytest.raises(ValueError, match='quaternion must not be zero'):
        Pose.from_quaternion_xyzw(np.zeros(4), np.zeros(3))


def test_points_become_contiguous_doubles():
    points = as_points(np.arange(12, dtype=np.int16).reshape(2, 6).T, 'points', (None, 2))
    assert points.dtype == np.float64
    assert points.flags.c_contiguous


def test_the_error_for_ragged_points_names_the_argument():
    with pytest.raises(ValueError, match=r'points must be numbers of shape \(N, 2\)'):
        as_points([[1.0, 2.0], [3.0]], 'points', (None, 2))
