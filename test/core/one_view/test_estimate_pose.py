# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""``estimate_pose``: outliers, four points, a known camera, honesty, bad input."""

from errors import deviation
import numpy as np
from p4pfr_ros import DivisionCamera, estimate_pose, EstimateOptions, Pose, Status
from p4pfr_ros.core.geometry import rotation_angle_rad
from p4pfr_ros.scenes.instances import IMAGE_SIZE
from p4pfr_ros.scenes.single_view import draw_view
import pytest

EYE = np.eye(5)[:, :2]


def success(estimate, drawn):
    """Rotation within 1°, focal length within 5 %."""
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
def test_outliers_are_left_out(n, outliers, least, sample):
    rng = np.random.default_rng(1)
    views = [draw_view(rng, n, outlier_share=outliers) for _ in range(sample(100, 4))]
    estimates = [
        estimate_pose(v.image_points, v.board_points, image_size=IMAGE_SIZE) for v in views
    ]
    assert np.mean([success(e, v) for e, v in zip(estimates, views, strict=True)]) >= least
    wrong = [np.mean(e.inliers & v.outlier) for e, v in zip(estimates, views, strict=True)]
    assert np.mean(wrong) < 0.01


def test_numbers_are_of_the_returned_model():
    drawn = draw_view(np.random.default_rng(2), 60, outlier_share=0.3)
    options = EstimateOptions(threshold_px=1.5)
    estimate = estimate_pose(
        drawn.image_points, drawn.board_points, image_size=IMAGE_SIZE, options=options
    )
    board = np.column_stack([drawn.board_points, np.zeros(60)])
    seen = estimate.model.camera.project(estimate.model.camera_from_board.transform(board))
    distance = np.linalg.norm(seen - drawn.image_points, axis=1)
    np.testing.assert_array_equal(estimate.inliers, distance < 1.5)
    rms = np.sqrt(np.mean(distance[estimate.inliers] ** 2))
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


def test_noise_free_view_is_exact():
    drawn = draw_view(np.random.default_rng(4), 30, noise_px=0.0)
    estimate = estimate_pose(drawn.image_points, drawn.board_points, image_size=IMAGE_SIZE)
    assert estimate.model.camera.focal_px == pytest.approx(drawn.camera.focal_px, rel=1e-9)
    assert estimate.model.camera.k == pytest.approx(drawn.camera.k, rel=1e-7)
    assert estimate.rms_px < 1e-8


def test_the_centre_may_be_given():
    drawn = draw_view(np.random.default_rng(5), 30, noise_px=0.0)
    shifted = drawn.image_points + np.array([100.0, -50.0])
    center = (drawn.camera.center_px[0] + 100.0, drawn.camera.center_px[1] - 50.0)
    estimate = estimate_pose(shifted, drawn.board_points, image_size=IMAGE_SIZE, center_px=center)
    assert estimate.model.camera.center_px == center
    assert estimate.model.camera.focal_px == pytest.approx(drawn.camera.focal_px, rel=1e-9)


def test_the_boards_origin_may_be_anywhere():
    drawn = draw_view(np.random.default_rng(6), 30)
    here = estimate_pose(drawn.image_points, drawn.board_points, image_size=IMAGE_SIZE)
    away = estimate_pose(
        drawn.image_points, drawn.board_points + np.array([5.0, -3.0]), image_size=IMAGE_SIZE
    )
    board_from_away = Pose(np.eye(3), [-5.0, 3.0, 0.0])
    expected = here.model.camera_from_board @ board_from_away
    np.testing.assert_allclose(
        away.model.camera_from_board.translation, expected.translation, atol=1e-6
    )
    # The variance of the same point, the board's middle, is the same either way.
    lever = away.model.camera_from_board.rotation @ [5.0, -3.0, 0.0]
    x, y, z = lever
    to_middle = np.hstack([np.eye(3), [[0, z, -y], [-z, 0, x], [y, -x, 0]]])
    middle = to_middle @ away.covariance[:6, :6] @ to_middle.T
    np.testing.assert_allclose(middle, here.covariance[:3, :3], rtol=1e-4, atol=1e-10)


def test_four_points_give_every_solution_ranked():
    drawn = draw_view(np.random.default_rng(7), 4, noise_px=0.0)
    estimate = estimate_pose(drawn.image_points, drawn.board_points, image_size=IMAGE_SIZE)
    assert estimate.status is Status.FOUR_POINTS
    assert estimate.inliers.all()
    found = [estimate.model, *estimate.alternatives]
    nearest = min(abs(s.camera.focal_px / drawn.camera.focal_px - 1.0) for s in found)
    assert nearest < 1e-6


def test_covariance_is_honest(sample):
    rng = np.random.default_rng(11)
    squares = []
    for _ in range(sample(400, 5)):
        drawn = draw_view(rng, 60, tilt_deg=(30.0, 60.0))
        estimate = estimate_pose(
            drawn.image_points,
            drawn.board_points,
            image_size=IMAGE_SIZE,
            options=EstimateOptions(sigma_px=0.5),
        )
        error = deviation(estimate.model, drawn)
        squares.append(error @ np.linalg.solve(estimate.covariance, error))
    if len(squares) > 100:
        assert np.median(squares) == pytest.approx(7.34, rel=0.15)  # χ² of 8 degrees


def test_a_view_from_straight_ahead_does_not_tell_the_focal_length():
    camera = DivisionCamera(800.0, (639.5, 479.5), -0.1)
    pose = Pose(np.diag([1.0, -1.0, -1.0]), [0.1, 0.05, 2.0])
    board = np.random.default_rng(12).uniform(-0.5, 0.5, (50, 2))
    image = camera.project(pose.transform(np.column_stack([board, np.zeros(50)])))
    image += np.random.default_rng(13).normal(0.0, 0.3, image.shape)
    estimate = estimate_pose(image, board, image_size=IMAGE_SIZE)
    assert not estimate.observable.focal
    assert not estimate.observable.distance


def test_a_tilted_view_tells_everything():
    drawn = draw_view(np.random.default_rng(14), 60, tilt_deg=(40.0, 50.0))
    estimate = estimate_pose(drawn.image_points, drawn.board_points, image_size=IMAGE_SIZE)
    seen = estimate.observable
    assert seen.direction
    assert seen.distance
    assert seen.focal
    assert seen.distortion


def test_points_on_a_line_have_no_pose():
    line = np.column_stack([np.arange(6.0), 2.0 * np.arange(6.0)])
    estimate = estimate_pose(10.0 * line, line, image_size=IMAGE_SIZE)
    assert estimate.model is None
    assert estimate.status is Status.COLLINEAR
    assert np.isnan(estimate.covariance).all()


def test_nonsense_has_no_consensus():
    rng = np.random.default_rng(15)
    estimate = estimate_pose(
        rng.uniform((0, 0), IMAGE_SIZE, (40, 2)),
        rng.uniform(-0.5, 0.5, (40, 2)),
        image_size=IMAGE_SIZE,
        options=EstimateOptions(max_iterations=300),
    )
    assert estimate.model is None
    assert estimate.status in (Status.NO_CONSENSUS, Status.NO_SOLUTION)
    assert not estimate.inliers.any()


@pytest.mark.parametrize(
    ('image', 'board', 'known', 'complaint'),
    [
        (np.zeros((3, 2)), np.zeros((3, 2)), {}, 'image_points must be at least 4, got 3'),
        (np.zeros((0, 2)), np.zeros((0, 2)), {}, 'image_points must be at least 4, got 0'),
        (np.zeros((5, 3)), np.zeros((5, 2)), {}, r'image_points must have shape \(N, 2\)'),
        (np.zeros((5, 2)), np.zeros((6, 2)), {}, r'board_points must have shape \(5, 2\)'),
        (np.full((5, 2), np.nan), np.zeros((5, 2)), {}, 'image_points must be finite'),
        (
            np.eye(5)[:, :2],
            np.eye(5)[:, :2],
            {'image_size': None},
            'must be given: they fix the centre',
        ),
        (
            np.eye(5)[:, :2],
            np.eye(5)[:, :2],
            {'image_size': (0, 9)},
            'image_size must be positive',
        ),
        (
            np.eye(5)[:, :2],
            np.eye(5)[:, :2],
            {'center_px': (1, np.nan)},
            'center_px must be finite',
        ),
    ],
)
def test_a_callers_mistake_is_named(image, board, known, complaint):
    with pytest.raises(ValueError, match=complaint):
        estimate_pose(image, board, **{'image_size': IMAGE_SIZE, **known})


@pytest.mark.parametrize(
    ('option', 'complaint'),
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
def test_an_option_out_of_range_is_named(option, complaint):
    with pytest.raises(ValueError, match=complaint):
        EstimateOptions(**option)
