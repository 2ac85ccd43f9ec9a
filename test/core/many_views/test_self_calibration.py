# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""Self-calibration: accuracy, covariance, keyframes, and the time of each pose."""

from calibration_views import (
    BOARD,
    calibrate,
    compiled_only,
    draw_views,
    lens_error,
    MARKER,
    seeded_camera,
)
from errors import estimate_error
import numpy as np
from p4pfr_ros import (
    CalibrationOptions,
    CalibrationState,
    EstimateOptions,
    SelfCalibration,
    Status,
    Verdict,
)
from p4pfr_ros.scenes.camera_views import fit_from_ground_truth
from p4pfr_ros.scenes.instances import IMAGE_SIZE
import pytest

CORNER_PX = 800.0


@pytest.fixture(scope='module')
def thirty():
    """Calibrate 100 cameras, each from 30 views of 24 points with 0.5 px noise, 10 % outliers."""
    scenes = []
    for seed in range(100):
        camera = seeded_camera(seed)
        views = draw_views(camera, 30, seed, outlier_share=0.1)
        scenes.append((camera, views, calibrate(views)))
    return scenes


@pytest.mark.exhaustive
@compiled_only
def test_errors_match_bundle_adjustment_started_at_the_truth(thirty):
    def error_sizes(errors, camera):
        bend = (CORNER_PX / camera.focal_px) ** 2
        return np.abs(
            [errors[0] / camera.focal_px, np.hypot(errors[1], errors[2]), bend * errors[3]]
        )

    ours = [error_sizes(lens_error(c.fused.camera, camera), camera) for camera, _, c in thirty]
    best = [
        error_sizes(lens_error(fit_from_ground_truth(views), camera), camera)
        for camera, views, _ in thirty
    ]
    # Bundle adjustment knows that boards are flat and pixels are square.
    assert (np.median(ours, axis=0) < (1.35, 1.15, 1.15) * np.median(best, axis=0)).all()


@pytest.mark.exhaustive
@compiled_only
def test_standard_deviations_match_the_errors(thirty):
    squares, inside = [], []
    for camera, _, calibration in thirty:
        error, covariance = (
            lens_error(calibration.fused.camera, camera)[:4],
            calibration.fused.covariance,
        )
        squares.append(error @ np.linalg.solve(covariance[:4, :4], error))
        inside.append(np.abs(error) < 1.96 * np.sqrt(np.diag(covariance)[:4]))
    # 4 if boards and pixels deviated as the priors allow; here they do not.
    assert 1.5 < np.mean(squares) < 5.0
    assert (np.mean(inside, axis=0) > 0.89).all()


@pytest.mark.exhaustive
@compiled_only
def test_terms_that_a_square_centred_lens_with_one_term_lacks_are_rarely_freed(thirty):
    cameras = [calibration.fused.camera for _, _, calibration in thirty]
    assert sum(camera.order > 1 for camera in cameras) <= 2
    assert sum(camera.aspect != 1.0 or camera.is_decentred for camera in cameras) <= 2


@pytest.mark.exhaustive
@compiled_only
def test_the_state_advances_with_the_number_of_views(thirty):
    assert sum(c.state is CalibrationState.CALIBRATED for _, _, c in thirty) >= 95
    assert SelfCalibration(IMAGE_SIZE).state is CalibrationState.UNCALIBRATED
    views = thirty[0][1]
    few = calibrate(views[:2])
    assert few.state is CalibrationState.CONVERGING
    assert few.fused.focal_sigma_px > thirty[0][2].fused.focal_sigma_px


@pytest.mark.exhaustive
@compiled_only
@pytest.mark.parametrize('count', [1, 3, 10])
def test_the_covariance_of_a_pose_includes_that_of_the_camera(count):
    squares = []
    for seed in range(60):
        camera = seeded_camera(seed)
        views = draw_views(camera, count, seed, tilt_deg=(15.0, 60.0))
        calibration = calibrate(views[:-1])
        estimate = calibration.update(views[-1].image_points, views[-1].board_points)
        if calibration.fused is not None and not estimate.observable.undetermined:
            error = estimate_error(estimate.model, views[-1])
            squares.append(error @ np.linalg.solve(estimate.covariance, error))
    assert len(squares) > 50
    # The median of χ² with eight degrees of freedom is 7.34. The covariance allows for boards and
    # pixels that deviate; here they do not.
    assert 1.0 < np.median(squares) < 9.0


@compiled_only
def test_markers_with_four_points_calibrate_a_camera():
    errors = []
    for seed in range(10):
        camera = seeded_camera(seed)
        views = draw_views(camera, 40, seed, board=MARKER, noise_px=0.3)
        calibration = calibrate(views)
        assert calibration.state is CalibrationState.CALIBRATED
        errors.append(calibration.fused.camera.focal_px / camera.focal_px - 1.0)
    assert np.median(np.abs(errors)) < 0.005


@compiled_only
def test_the_keyframes_are_bounded_and_gain_information():
    camera = seeded_camera(3)
    calibration = SelfCalibration(IMAGE_SIZE, options=CalibrationOptions(max_views=6))
    sigmas_px = []
    for view in draw_views(camera, 30, 3):
        calibration.update(view.image_points, view.board_points)
        if calibration.fused is not None:
            sigmas_px.append(calibration.fused.focal_sigma_px)
        assert len(calibration.views) <= 6
    assert sigmas_px[-1] < 0.7 * sigmas_px[5]


@compiled_only
def test_a_stationary_board_adds_no_keyframe():
    camera = seeded_camera(4)
    views = draw_views(camera, 6, 4)
    calibration = calibrate(views)
    rng = np.random.default_rng(0)
    for _ in range(20):
        again = views[2].image_points + rng.normal(0.0, 0.3, (24, 2))
        estimate = calibration.update(again, BOARD)
        assert calibration.verdict is Verdict.REDUNDANT
        assert estimate.model.camera == calibration.fused.camera
    assert len(calibration.views) == 6


@compiled_only
def test_a_prior_on_the_focal_length_is_used():
    camera = seeded_camera(10)
    robust = EstimateOptions(prior_focal_px=camera.focal_px, prior_focal_sigma_px=0.5)
    flat = draw_views(camera, 4, 10, tilt_deg=(0.0, 3.0))
    assert calibrate(flat, robust=robust).fused.focal_sigma_px < 0.51
    assert calibrate(flat).fused is None or calibrate(flat).fused.focal_sigma_px > 5.0


def test_keyframes_have_the_callers_stamps_and_their_residuals():
    calibration = SelfCalibration(IMAGE_SIZE)
    for stamp, view in zip('abc', draw_views(seeded_camera(11), 3, 11), strict=True):
        calibration.update(view.image_points, view.board_points, stamp)
    assert [keyframe.stamp for keyframe in calibration.views] == ['a', 'b', 'c']
    keyframe = calibration.views[0]
    points = calibration.fused.board_shape(keyframe.board).points(keyframe.board_points)
    expected = calibration.fused.camera.project(keyframe.camera_from_board.transform(points))
    np.testing.assert_allclose(keyframe.residuals_px, expected - keyframe.image_points, atol=1e-9)


@compiled_only
def test_collinear_points_have_no_pose_and_do_not_change_the_camera():
    calibration = calibrate(draw_views(seeded_camera(12), 5, 12))
    before = calibration.fused.camera
    line = np.column_stack([np.linspace(-0.5, 0.5, 8), np.zeros(8)])
    estimate = calibration.update(100.0 + 500.0 * (line + 1.0), line)
    assert estimate.status is Status.COLLINEAR
    assert calibration.verdict is Verdict.NO_POSE
    assert calibration.fused.camera == before


@compiled_only
def test_random_points_have_no_pose():
    calibration = SelfCalibration(IMAGE_SIZE)
    rng = np.random.default_rng(0)
    estimate = calibration.update(rng.uniform((0, 0), IMAGE_SIZE, (24, 2)), BOARD)
    assert estimate.model is None
    assert calibration.verdict is Verdict.NO_POSE


@pytest.mark.parametrize(
    'option',
    [
        {'max_views': 1},
        {'min_views': 1},
        {'focal_tolerance': 0.0},
        {'center_spread': float('nan')},
        {'outliers_to_restart': 11},
    ],
    ids=str,
)
def test_options_out_of_range_are_rejected(option):
    with pytest.raises(ValueError, match=next(iter(option))):
        CalibrationOptions(**option)


def test_invalid_arguments_raise_a_value_error():
    calibration = SelfCalibration(IMAGE_SIZE)
    with pytest.raises(ValueError, match='finite'):
        calibration.update(np.full((24, 2), np.nan), BOARD)
    with pytest.raises(ValueError, match='image_size'):
        SelfCalibration((0, 480))


def _update(calibration, view):
    """Update with a view; return the estimate that on_pose got, and the camera at that time."""
    calls = []

    def on_pose(estimate):
        fused = calibration.fused
        calls.append((estimate, fused and fused.camera))

    returned = calibration.update(view.image_points, view.board_points, on_pose=on_pose)
    [(estimate, camera)] = calls
    assert estimate is returned
    return estimate, camera


@compiled_only
def test_a_calibrated_camera_reports_the_pose_before_the_update():
    """That pose is by the camera before the update, and hardly differs from the later one."""
    views = draw_views(seeded_camera(13), 40, 13)
    calibration, in_turn = calibrate(views[:30]), calibrate(views[:30])
    assert calibration.state is CalibrationState.CALIBRATED
    for view in views[30:]:
        before = calibration.fused.camera
        early, camera = _update(calibration, view)
        assert early.model.camera == before == camera
        late = in_turn.update(view.image_points, view.board_points)
        assert late.model.camera == in_turn.fused.camera == calibration.fused.camera
        step = late.model.camera_from_board.translation - early.model.camera_from_board.translation
        assert step @ np.linalg.solve(early.covariance[:3, :3], step) < 1.0


@compiled_only
def test_other_poses_are_reported_after_the_update():
    """Without a calibrated camera, or if the view disagrees with it."""
    views = draw_views(seeded_camera(13), 30, 13)
    calibration = SelfCalibration(IMAGE_SIZE)
    calibrate(views[:4], calibration)
    estimate, camera = _update(calibration, views[4])
    assert camera is not None
    assert camera == estimate.model.camera == calibration.fused.camera
    calibrate(views[5:], calibration)
    outlier = draw_views(seeded_camera(14), 1, 14)[0]
    estimate, camera = _update(calibration, outlier)
    assert calibration.verdict is Verdict.OUTLIER
    assert estimate.model.camera != camera
