# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""``estimate_pose`` with a known camera: the pose alone, and its mirror image."""

from ideal import estimate_pose
import numpy as np
from p4pfr_ros import DivisionCamera, Pose
from p4pfr_ros.core.geometry import rotation_angle_rad
from p4pfr_ros.core.model.lens import lens_from_camera
from p4pfr_ros.core.one_view.known_camera import rays_and_across
from p4pfr_ros.scenes.single_view import draw_view
import pytest


@pytest.mark.parametrize('n', [4, 5, 6, 24, 100])
def test_with_a_known_camera_only_the_pose_is_estimated(n, sample):
    rng = np.random.default_rng(8)
    angles = []
    for _ in range(sample(40, 3)):
        drawn = draw_view(rng, n, outlier_share=0.2 if n >= 24 else 0.0)
        estimate = estimate_pose(drawn.image_points, drawn.board_points, camera=drawn.camera)
        if estimate.model is None:
            angles.append(np.inf)
            continue
        assert estimate.model.camera is drawn.camera
        np.testing.assert_array_equal(estimate.covariance[6:], 0.0)
        truth = drawn.camera_from_board.rotation
        solutions = [estimate.model, *estimate.alternatives]
        angles.append(
            min(rotation_angle_rad(s.camera_from_board.rotation, truth) for s in solutions)
        )
    assert np.median(angles) < np.radians(1.0)


def test_the_pose_with_a_known_wide_lens_is_exact():
    camera = DivisionCamera(350.0, (639.5, 479.5), -0.25, -0.02, 0.001)
    pose = Pose.from_rotation_vector([2.6, 0.3, -0.2], [0.1, -0.2, 0.8])
    board = np.random.default_rng(9).uniform(-0.5, 0.5, (20, 2))
    image = camera.project(pose.transform(np.column_stack([board, np.zeros(20)])))
    estimate = estimate_pose(image, board, camera=camera)
    assert rotation_angle_rad(estimate.model.camera_from_board.rotation, pose.rotation) < 1e-9
    np.testing.assert_allclose(
        estimate.model.camera_from_board.translation, pose.translation, atol=1e-9
    )


def test_a_far_marker_has_two_poses_and_a_near_one_has_one():
    camera = DivisionCamera(800.0, (639.5, 479.5), -0.1)
    corners = 0.05 * np.array([[-1, 1], [1, 1], [1, -1], [-1, -1.0]])
    grid = np.concatenate([corners, 0.5 * corners, 0.25 * corners])
    tilted = (
        np.diag([1.0, -1.0, -1.0]) @ Pose.from_rotation_vector([0.5, 0.2, 0], [0, 0, 0]).rotation
    )
    rng = np.random.default_rng(10)
    counts = {}
    for distance in (3.0, 0.3):
        pose = Pose(tilted, [0.02, 0.01, distance])
        image = camera.project(pose.transform(np.column_stack([grid, np.zeros(len(grid))])))
        image += rng.normal(0.0, 0.3, image.shape)
        estimate = estimate_pose(image, grid, camera=camera)
        solutions = [estimate.model, *estimate.alternatives]
        counts[distance] = len(solutions)
        nearest = min(rotation_angle_rad(s.camera_from_board.rotation, tilted) for s in solutions)
        assert nearest < np.radians(12.0)
    assert counts == {3.0: 2, 0.3: 1}


@pytest.mark.parametrize('n', [4, 20])
def test_the_pose_with_a_decentred_camera_of_all_terms_is_exact(n):
    camera = DivisionCamera(
        400.0, (650.0, 470.0), -0.3, -0.02, -0.002, -0.0003, 1.05, 0.003, -0.002
    )
    pose = Pose.from_rotation_vector([2.6, 0.3, -0.2], [0.2, -0.3, 0.8])
    board = np.array([[-0.5, 0.4], [0.5, 0.5], [0.5, -0.4], [-0.4, -0.5]])
    board = np.concatenate([board, np.random.default_rng(9).uniform(-0.5, 0.5, (n - 4, 2))])
    image = camera.project(pose.transform(np.column_stack([board, np.zeros(n)])))
    estimated = estimate_pose(image, board, camera=camera).model.camera_from_board
    np.testing.assert_allclose(estimated.rotation, pose.rotation, atol=1e-8)
    np.testing.assert_allclose(estimated.translation, pose.translation, atol=1e-8)


def test_displacements_across_the_rays_are_those_of_the_camera():
    camera = DivisionCamera(400.0, (0.0, 0.0), -0.3, -0.02, -0.002, -0.0003, 1.05, 0.003, -0.002)
    image = np.random.default_rng(3).uniform((-640, -480), (640, 480), (50, 2))
    rays, across = np.empty((50, 3)), np.empty((50, 2, 3))
    rays_and_across(image, lens_from_camera(camera, camera.center_px), rays, across)
    expected = camera.unproject(image)
    expected /= np.linalg.norm(expected, axis=1, keepdims=True)
    np.testing.assert_allclose(rays, expected, atol=1e-12)
    for direction in np.eye(3):
        step = 1e-5 * direction
        moved = (camera.project(rays + step) - camera.project(rays - step)) / 2e-5
        np.testing.assert_allclose(across @ direction, moved, atol=1e-4)
