# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""Alternatives: all solutions that explain a view as well as the best, and no others."""

from errors import project_board
from ideal import estimate_pose, ideal_options
import numpy as np
from p4pfr_ros import DivisionCamera, Pose
from p4pfr_ros.core.geometry import rotation_angle_rad
from p4pfr_ros.scenes.instances import IMAGE_SIZE
import pytest

CAMERA = DivisionCamera(800.0, (639.5, 479.5), -0.1)
TILTED = np.diag([1.0, -1.0, -1.0]) @ Pose.from_rotation_vector([0.5, 0.2, 0], [0, 0, 0]).rotation
CORNERS = 0.05 * np.array([[-1, 1], [1, 1], [1, -1], [-1, -1.0]])
NESTED = np.concatenate([CORNERS, 0.5 * CORNERS, 0.25 * CORNERS])
FAR, NEAR = Pose(TILTED, [0.02, 0.01, 3.0]), Pose(TILTED, [0.02, 0.01, 0.3])
FREE = {
    'image_size': IMAGE_SIZE,
    'options': ideal_options(
        prior_focal_px=800.0, prior_focal_sigma_px=20.0, prior_k=-0.1, prior_k_sigma=0.02
    ),
}


def poses(pose, board, arguments, seed):
    estimate = estimate_pose(project_board(CAMERA, pose, board, 0.3, seed), board, **arguments)
    return [s.camera_from_board for s in (estimate.model, *estimate.alternatives)]


@pytest.mark.parametrize('arguments', [{'camera': CAMERA}, FREE], ids=['known', 'free'])
@pytest.mark.parametrize('board', [CORNERS, NESTED], ids=['four', 'twelve'])
def test_a_far_marker_has_two_poses_and_a_near_one_has_one(board, arguments):
    for seed in range(5):
        solutions = poses(FAR, board, arguments, seed)
        assert len(solutions) == 2
        assert min(rotation_angle_rad(p.rotation, TILTED) for p in solutions) < np.radians(12.0)
        # They are nearly mirror images in the line of sight: twice the tilt apart.
        assert rotation_angle_rad(solutions[0].rotation, solutions[1].rotation) > np.radians(30.0)
        solutions = poses(NEAR, board, arguments, seed)
        assert len(solutions) == 1
        assert rotation_angle_rad(solutions[0].rotation, TILTED) < np.radians(2.0)


def test_the_model_has_smaller_residuals_than_its_alternatives():
    for seed in range(20):
        image = project_board(CAMERA, FAR, NESTED, 0.3, seed)
        estimate = estimate_pose(image, NESTED, camera=CAMERA)
        rms = [rms_px(s, image) for s in (estimate.model, *estimate.alternatives)]
        assert rms[0] == min(rms)
        assert estimate.rms_px == pytest.approx(rms[0], rel=1e-3)


def rms_px(solution, image):
    projected = project_board(solution.camera, solution.camera_from_board, NESTED)
    return np.sqrt(np.mean(np.sum((projected - image) ** 2, axis=1)))


def test_four_points_give_every_camera_that_fits_them():
    board = np.array([[0.0, 0.0], [1.0, 0.1], [0.9, 1.0], [0.1, 0.8]]) - 0.5
    image = project_board(CAMERA, Pose(TILTED, [0.2, 0.1, 1.3]), board)
    estimate = estimate_pose(image, board, image_size=IMAGE_SIZE)
    solutions = [estimate.model, *estimate.alternatives]
    assert min(abs(s.camera.focal_px - 800.0) for s in solutions) < 1e-3
    for solution in solutions:
        projected = project_board(solution.camera, solution.camera_from_board, board)
        np.testing.assert_allclose(projected, image, atol=1e-6)
