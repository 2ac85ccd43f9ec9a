# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""``estimate_pose``: outliers, four points, covariance, observability, invalid arguments."""

from errors import estimate_error
from ideal import estimate_pose, ideal_options
import numpy as np
from p4pfr_ros import DivisionCamera, Pose, Status
from p4pfr_ros.core.geometry import rotation_angle_rad
from p4pfr_ros.scenes.instances import IMAGE_SIZE
from p4pfr_ros.scenes.single_view import draw_view
import pytest

EYE = np.eye(5)[:, :2]


def succeeds(estimate, drawn):
    """Return whether the rotation is within 1° and the focal length within 5 %."""
    if estimate.model is None:
        return False
    angle = rotation_angle_rad(
        estimate.model.camera_from_board.rotation, drawn.camera_from_board.rotation
    )
    focal = abs(estimate.model.camera.focal_px / drawn.camera.focal_px - 1.0)
    return angle < np.radians(1.0) and focal < 0.05


@pytest.mark.parametrize(
    ('n', 'outliers', 'least'), [(100, 0.0, 0.95), (100, 0.5, 0.93), (24, 0.3, 0.85)]
)
def test_outliers_are_rejected(n, outliers, least, sample):
    rng = np.random.default_rng(1)
    views = [draw_view(rng, n, outlier_share=outliers) for _ in range(sample(100, 4))]
    estimates = [
        estimate_pose(v.image_points, v.board_points, image_size=IMAGE_SIZE) for v in views
    ]
    assert np.mean([succeeds(e, v) for e, v in zip(estimates, views, strict=True)]) >= least
    accepted_outliers = [
        np.mean(e.inliers & v.outlier) for e, v in zip(estimates, views, strict=True)
    ]
    assert np.mean(accepted_outliers) < 0.01


def test_inliers_and_rms_belong_to_the_returned_model():
    drawn = draw_view(np.random.default_rng(2), 60, outlier_share=0.3)
    options = ideal_options(threshold_px=1.5)
    estimate = estimate_pose(
        drawn.image_points, drawn.board_points, image_size=IMAGE_SIZE, options=options
    )
    board = np.column_stack([drawn.board_points, np.zeros(60)])
    projected = estimate.model.camera.project(estimate.model.camera_from_board.transform(board))
    error_px = np.linalg.norm(projected - drawn.image_points, axis=1)
    np.testing.assert_array_equal(estimate.inliers, error_px < 1.5)
    rms = np.sqrt(np.mean(error_px[estimate.inliers] ** 2))
    assert estimate.rms_px == pytest.approx(rms, rel=1e-9)
    assert estimate.status is Status.CONFIDENT


def test_the_same_input_gives_the_same_output():
    drawn = draw_view(np.random.default_rng(3), 40, outlier_share=0.4)
    first, second = (
        estimate_pose(drawn.image_points, drawn.board_points, image_size=IMAGE_SIZE)
        for _ in range(2)
    )
    assert first.model.camera == second.model.camera
    np.testing.assert_array_equal(first.covariance, second.covariance)


def test_a_noise_free_view_is_exact():
    drawn = draw_view(np.random.default_rng(4), 30, noise_px=0.0)
    estimate = estimate_pose(drawn.image_points, drawn.board_points, image_size=IMAGE_SIZE)
    assert estimate.model.camera.focal_px == pytest.approx(drawn.camera.focal_px, rel=1e-9)
    assert estimate.model.camera.k == pytest.approx(drawn.camera.k, rel=1e-7)
    assert estimate.rms_px < 1e-8


def test_a_given_centre_is_used():
    drawn = draw_view(np.random.default_rng(5), 30, noise_px=0.0)
    shifted = drawn.image_points + np.array([100.0, -50.0])
    center = (drawn.camera.center_px[0] + 100.0, drawn.camera.center_px[1] - 50.0)
    estimate = estimate_pose(shifted, drawn.board_points, image_size=IMAGE_SIZE, center_px=center)
    assert estimate.model.camera.center_px == center
    assert estimate.model.camera.focal_px == pytest.approx(drawn.camera.focal_px, rel=1e-9)


def test_the_estimate_transforms_with_the_boards_origin():
    drawn = draw_view(np.random.default_rng(6), 30)
    original = estimate_pose(drawn.image_points, drawn.board_points, image_size=IMAGE_SIZE)
    moved = estimate_pose(
        drawn.image_points, drawn.board_points + np.array([5.0, -3.0]), image_size=IMAGE_SIZE
    )
    board_from_moved = Pose(np.eye(3), [-5.0, 3.0, 0.0])
    expected = original.model.camera_from_board @ board_from_moved
    np.testing.assert_allclose(
        moved.model.camera_from_board.translation, expected.translation, atol=1e-6
    )
    # The covariance of one point, the middle of the board, is the same for both origins.
    lever = moved.model.camera_from_board.rotation @ [5.0, -3.0, 0.0]
    x, y, z = lever
    middle_jacobian = np.hstack([np.eye(3), [[0, z, -y], [-z, 0, x], [y, -x, 0]]])
    middle_covariance = middle_jacobian @ moved.covariance[:6, :6] @ middle_jacobian.T
    np.testing.assert_allclose(
        middle_covariance, original.covariance[:3, :3], rtol=1e-4, atol=1e-10
    )


def test_four_points_give_every_solution_the_most_typical_camera_first():
    counts = []
    for seed in (7, 10, 24, 26, 27):  # each determines all quantities
        drawn = draw_view(np.random.default_rng(seed), 4, noise_px=0.0)
        estimate = estimate_pose(drawn.image_points, drawn.board_points, image_size=IMAGE_SIZE)
        assert estimate.status is Status.FOUR_POINTS
        assert estimate.inliers.all()
        cameras = [s.camera for s in (estimate.model, *estimate.alternatives)]
        assert min(abs(c.focal_px / drawn.camera.focal_px - 1.0) for c in cameras) < 1e-6
        rarity = [atypicality(camera) for camera in cameras]
        assert rarity == sorted(rarity)
        counts.append(len(cameras))
    assert counts == [1, 2, 2, 2, 2]


def atypicality(camera):
    """Return the squared deviation from an undistorted camera with a field of view of 60°."""
    corner_px = 800.0  # of an image of 1280x960
    by_focal = np.log2(camera.focal_px / (corner_px * np.sqrt(3.0)))
    by_bend = camera.k * (corner_px / camera.focal_px) ** 2 / 0.3
    return by_focal**2 + by_bend**2


def test_the_covariance_matches_the_errors(sample):
    rng = np.random.default_rng(11)
    squares = []
    for _ in range(sample(400, 5)):
        drawn = draw_view(rng, 60, tilt_deg=(30.0, 60.0))
        estimate = estimate_pose(
            drawn.image_points,
            drawn.board_points,
            image_size=IMAGE_SIZE,
            options=ideal_options(sigma_px=0.5),
        )
        error = estimate_error(estimate.model, drawn)
        squares.append(error @ np.linalg.solve(estimate.covariance, error))
    # The median of χ² with eight degrees of freedom is 7.34; of five views only a rough one.
    assert np.median(squares) == pytest.approx(7.34, rel=0.15 if len(squares) > 100 else 0.7)


def test_a_fronto_parallel_view_does_not_determine_the_focal_length():
    camera = DivisionCamera(800.0, (639.5, 479.5), -0.1)
    pose = Pose(np.diag([1.0, -1.0, -1.0]), [0.1, 0.05, 2.0])
    board = np.random.default_rng(12).uniform(-0.5, 0.5, (50, 2))
    image = camera.project(pose.transform(np.column_stack([board, np.zeros(50)])))
    image += np.random.default_rng(13).normal(0.0, 0.3, image.shape)
    estimate = estimate_pose(image, board, image_size=IMAGE_SIZE)
    assert not estimate.observable.focal
    assert not estimate.observable.distance


def test_a_tilted_view_determines_all_quantities():
    drawn = draw_view(np.random.default_rng(14), 60, tilt_deg=(40.0, 50.0))
    estimate = estimate_pose(drawn.image_points, drawn.board_points, image_size=IMAGE_SIZE)
    observable = estimate.observable
    assert observable.direction
    assert observable.distance
    assert observable.focal
    assert observable.distortion


def test_collinear_points_have_no_pose():
    line = np.column_stack([np.arange(6.0), 2.0 * np.arange(6.0)])
    estimate = estimate_pose(10.0 * line, line, image_size=IMAGE_SIZE)
    assert estimate.model is None
    assert estimate.status is Status.COLLINEAR
    assert np.isnan(estimate.covariance).all()


def test_random_points_have_no_consensus():
    rng = np.random.default_rng(15)
    estimate = estimate_pose(
        rng.uniform((0, 0), IMAGE_SIZE, (40, 2)),
        rng.uniform(-0.5, 0.5, (40, 2)),
        image_size=IMAGE_SIZE,
        options=ideal_options(max_iterations=300),
    )
    assert estimate.model is None
    assert estimate.status in (Status.NO_CONSENSUS, Status.NO_SOLUTION)
    assert not estimate.inliers.any()


@pytest.mark.parametrize(
    ('image', 'board', 'arguments', 'message'),
    [
        (np.zeros((3, 2)), np.zeros((3, 2)), {}, 'image_points must be at least 4, got 3'),
        (np.zeros((0, 2)), np.zeros((0, 2)), {}, 'image_points must be at least 4, got 0'),
        (np.zeros((5, 3)), np.zeros((5, 2)), {}, r'image_points must have shape \(N, 2\)'),
        (np.zeros((5, 2)), np.zeros((6, 2)), {}, r'board_points must have shape \(5, 2\)'),
        (np.full((5, 2), np.nan), np.zeros((5, 2)), {}, 'image_points must be finite'),
        (EYE, EYE, {'image_size': None}, 'must be given: they fix the centre'),
        (EYE, EYE, {'image_size': (0, 9)}, 'image_size must be positive'),
        (EYE, EYE, {'center_px': (1, np.nan)}, 'center_px must be finite'),
    ],
)
def test_the_error_for_an_invalid_argument_names_it(image, board, arguments, message):
    with pytest.raises(ValueError, match=message):
        estimate_pose(image, board, **{'image_size': IMAGE_SIZE, **arguments})


@pytest.mark.parametrize(
    ('option', 'message'),
    [
        ({'threshold_px': 0.0}, 'threshold_px must be from 0.01 to 1000, got 0.0'),
        ({'confidence': 1.0}, 'confidence must be from 0.5'),
        (
            {'min_fov_deg': 90.0, 'max_fov_deg': 80.0},
            'min_fov_deg must be at most max_fov_deg',
        ),
        (
            {'min_iterations': 10, 'max_iterations': 5},
            'must be at most max_iterations = 5, got 10',
        ),
        ({'min_inliers': 3}, 'min_inliers must be from 4'),
        ({'sigma_px': -1.0}, 'sigma_px must be from 1e-06'),
    ],
)
def test_the_error_for_an_option_out_of_range_names_it(option, message):
    with pytest.raises(ValueError, match=message):
        ideal_options(**option)
