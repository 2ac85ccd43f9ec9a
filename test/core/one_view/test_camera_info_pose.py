# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""``estimate_pose`` with a CameraInfoModel."""

from ideal import estimate_pose, ideal_options
import numpy as np
from p4pfr_ros import DivisionCamera, Pose, Status
from p4pfr_ros.core.cameras.camera_info import CameraInfoModel
from p4pfr_ros.core.geometry import rotation_angle_rad
import pytest

SIZE = (1280, 960)
CENTER = (645.0, 470.0)
PLUMB_BOB = CameraInfoModel(
    'plumb_bob', (-0.3, 0.12, 1e-3, -8e-4, -0.02), (900.0, 905.0), CENTER, 0.0, SIZE
)
MODELS = {
    'plumb_bob': PLUMB_BOB,
    'rational_polynomial': CameraInfoModel(
        'rational_polynomial',
        (0.8, 0.13, 4e-4, -3e-4, 0.002, 1.05, 0.27, 0.013),
        (600.0, 602.0),
        CENTER,
        0.0,
        SIZE,
    ),
    'equidistant': CameraInfoModel(
        'equidistant', (-0.02, 0.005, -0.003, 5e-4), (400.0, 401.0), CENTER, 0.0, SIZE
    ),
    'skewed': CameraInfoModel(
        'equidistant', (-0.02, 0.005, -0.003, 5e-4), (400.0, 401.0), CENTER, 0.0, SIZE, 0.0, 4.0
    ),
}
over_models = pytest.mark.parametrize('model', MODELS.values(), ids=MODELS)
FACING = np.diag([1.0, -1.0, -1.0])


def draw_model_view(rng, model, n=40):
    """Draw a pose and n board points inside the image; without noise."""
    pose = Pose.from_rotation_vector(rng.uniform(-0.6, 0.6, 3), [*rng.uniform(-0.1, 0.1, 2), 0.6])
    pose = Pose(pose.rotation @ FACING, pose.translation)
    half_size = 0.35 * 900.0 / model.focal_px[0]
    board = rng.uniform(-half_size, half_size, (20 * n, 2))
    image = model.project(pose.transform(np.pad(board, ((0, 0), (0, 1)))))
    inside = ((image > 0.0) & (image < SIZE)).all(axis=1)
    return pose, board[inside][:n], image[inside][:n]


@over_models
def test_without_noise_the_pose_is_exact(model):
    rng = np.random.default_rng(1)
    for _ in range(5):
        pose, board, image = draw_model_view(rng, model)
        estimate = estimate_pose(image, board, camera=model)
        result = estimate.model.camera_from_board
        assert rotation_angle_rad(result.rotation, pose.rotation) < 1e-9
        np.testing.assert_allclose(result.translation, pose.translation, atol=1e-9)
        assert estimate.rms_px < 1e-9
        np.testing.assert_array_equal(estimate.covariance[6:], 0.0)


@over_models
def test_errors_and_covariance_are_in_raw_pixels(model):
    """Noise of 0.5 px is measured as such, and the covariance holds the errors."""
    rng = np.random.default_rng(2)
    options = ideal_options(threshold_px=3.0)
    n = 60
    squares, rms_px = [], []
    for _ in range(n):
        pose, board, image = draw_model_view(rng, model)
        noisy = image + rng.normal(0.0, 0.5, image.shape)
        estimate = estimate_pose(noisy, board, camera=model, options=options)
        error = estimate.model.camera_from_board.translation - pose.translation
        squares.append(error @ np.linalg.solve(estimate.covariance[:3, :3], error))
        rms_px.append(estimate.rms_px)
    # 80 coordinates minus 6 unknowns; an error has two coordinates.
    assert np.mean(rms_px) == pytest.approx(0.5 * np.sqrt(2.0 * 74 / 80), rel=0.05)
    assert np.mean(squares) == pytest.approx(3.0, abs=4.0 * np.sqrt(6.0 / n))


def test_a_division_camera_and_its_model_give_the_same_estimate():
    camera = DivisionCamera(800.0, CENTER, -0.2)
    model = camera.to_camera_info_model(SIZE)
    rng = np.random.default_rng(3)
    _, board, image = draw_model_view(rng, model)
    image += rng.normal(0.0, 0.5, image.shape)
    image[:5] += 40.0
    by_model = estimate_pose(image, board, camera=model)
    by_camera = estimate_pose(image, board, camera=camera)
    result, expected = by_model.model.camera_from_board, by_camera.model.camera_from_board
    assert rotation_angle_rad(result.rotation, expected.rotation) < 1e-6
    np.testing.assert_allclose(result.translation, expected.translation, atol=1e-6)
    np.testing.assert_allclose(by_model.covariance, by_camera.covariance, rtol=1e-3, atol=1e-12)
    np.testing.assert_array_equal(by_model.inliers, by_camera.inliers)
    assert not by_model.inliers[:5].any()


def test_a_pixel_without_a_ray_is_an_outlier():
    # ρ (1 - ρ² / 3) turns back at ρ = 1, where it is 2/3: 600 px from the centre.
    model = CameraInfoModel('plumb_bob', (-1 / 3, 0, 0, 0), (900.0, 900.0), CENTER, 0.0, SIZE)
    _, board, image = draw_model_view(np.random.default_rng(4), model)
    image[7] = CENTER[0] + 620.0, CENTER[1]
    estimate = estimate_pose(image, board, camera=model)
    assert estimate.inliers.sum() == 39
    assert not estimate.inliers[7]
    without_rays = np.tile([CENTER[0] + 620.0, CENTER[1]], (40, 1))
    unsolved = estimate_pose(without_rays, board, camera=model)
    assert unsolved.model is None
    assert unsolved.status is Status.NO_SOLUTION
    assert unsolved.inliers.shape == (40,)


@pytest.mark.parametrize(
    ('image', 'board', 'message'),
    [
        (np.zeros((3, 2)), np.zeros((3, 2)), 'image_points must be at least 4, got 3'),
        (np.zeros((4, 3)), np.zeros((4, 2)), 'image_points must have shape'),
        (np.zeros((5, 2)), np.zeros((4, 2)), 'board_points must have shape'),
        (np.full((4, 2), np.nan), np.zeros((4, 2)), 'image_points must be finite'),
    ],
)
def test_invalid_arguments_are_rejected(image, board, message):
    with pytest.raises(ValueError, match=message):
        estimate_pose(image, board, camera=PLUMB_BOB)
