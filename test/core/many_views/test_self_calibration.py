# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""The camera from its views: as good as the best there is, and no surer than it may be."""

from calibration_views import (
    BOARD,
    calibrated,
    drawn,
    error,
    MARKER,
    takes_long,
    views_of,
)
from errors import deviation
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
    """Cameras, their 30 views of 24 points with 0.5 px and a tenth wrong, and calibrations."""
    scenes = []
    for seed in range(100):
        camera = drawn(seed)
        views = views_of(camera, 30, seed, outlier_share=0.1)
        scenes.append((camera, views, calibrated(views)))
    return scenes


@takes_long
def test_errors_are_those_of_full_bundle_adjustment_from_the_truth(thirty):
    def sizes(found, camera):
        bend = (CORNER_PX / camera.focal_px) ** 2
        return np.abs([found[0] / camera.focal_px, np.hypot(found[1], found[2]), bend * found[3]])

    ours = [sizes(error(c.fused.camera, camera), camera) for camera, _, c in thirty]
    best = [
        sizes(error(fit_from_ground_truth(views), camera), camera) for camera, views, _ in thirty
    ]
    assert (np.median(ours, axis=0) < 1.15 * np.median(best, axis=0)).all()


@takes_long
def test_standard_deviations_are_honest(thirty):
    squares, inside = [], []
    for camera, _, calibration in thirty:
        off, covariance = error(calibration.fused.camera, camera)[:4], calibration.fused.covariance
        squares.append(off @ np.linalg.solve(covariance[:4, :4], off))
        inside.append(np.abs(off) < 1.96 * np.sqrt(np.diag(covariance)[:4]))
    assert 3.0 < np.mean(squares) < 5.0  # four in truth, and one in a hundred cameras ± 0.28
    assert (np.mean(inside, axis=0) > 0.89).all()


@takes_long
def test_one_term_stays_one_where_one_is_true(thirty):
    for _, _, calibration in thirty:
        assert calibration.fused.camera.k2 == calibration.fused.camera.k3 == 0.0


@takes_long
def test_the_state_goes_up(thirty):
    assert all(c.state is CalibrationState.CALIBRATED for _, _, c in thirty)
    assert SelfCalibration(IMAGE_SIZE).state is CalibrationState.UNCALIBRATED
    views = thirty[0][1]
    few = calibrated(views[:2])
    assert few.state is CalibrationState.CONVERGING
    assert few.fused.focal_sigma_px > thirty[0][2].fused.focal_sigma_px


@takes_long
@pytest.mark.parametrize('count', [1, 3, 10])
def test_a_pose_knows_how_sure_its_camera_is(count):
    squares = []
    for seed in range(60):
        camera = drawn(seed)
        views = views_of(camera, count, seed, tilt_deg=(15.0, 60.0))
        calibration = calibrated(views[:-1])
        estimate = calibration.update(views[-1].image_points, views[-1].board_points)
        if calibration.fused is not None and not estimate.observable.undetermined:
            off = deviation(estimate.model, views[-1])
            squares.append(off @ np.linalg.solve(estimate.covariance, off))
    assert len(squares) > 54
    # The median of χ² with eight degrees of freedom is 7.34.
    assert 5.5 < np.median(squares) < 9.0


@takes_long
def test_markers_of_four_points_calibrate_too():
    shares = []
    for seed in range(10):
        camera = drawn(seed)
        views = views_of(camera, 40, seed, board=MARKER, noise_px=0.3)
        calibration = calibrated(views)
        assert calibration.state is CalibrationState.CALIBRATED
        shares.append(calibration.fused.camera.focal_px / camera.focal_px - 1.0)
    assert np.median(np.abs(shares)) < 0.005


@takes_long
def test_the_set_of_views_is_bounded_and_tells_more_and_more():
    camera = drawn(3)
    calibration = SelfCalibration(IMAGE_SIZE, options=CalibrationOptions(max_views=6))
    sure_px = []
    for view in views_of(camera, 30, 3):
        calibration.update(view.image_points, view.board_points)
        if calibration.fused is not None:
            sure_px.append(calibration.fused.focal_sigma_px)
        assert len(calibration.views) <= 6
    assert sure_px[-1] < 0.7 * sure_px[5]


@takes_long
def test_what_stands_still_tells_nothing_new():
    camera = drawn(4)
    views = views_of(camera, 6, 4)
    calibration = calibrated(views)
    rng = np.random.default_rng(0)
    for _ in range(20):
        again = views[2].image_points + rng.normal(0.0, 0.3, (24, 2))
        estimate = calibration.update(again, BOARD)
        assert calibration.verdict is Verdict.REDUNDANT
        assert estimate.model.camera == calibration.fused.camera
    assert len(calibration.views) == 6


@takes_long
def test_a_prior_of_the_focal_length_counts():
    camera = drawn(10)
    robust = EstimateOptions(prior_focal_px=camera.focal_px, prior_focal_sigma_px=0.5)
    flat = views_of(camera, 4, 10, tilt_deg=(0.0, 3.0))
    assert calibrated(flat, robust=robust).fused.focal_sigma_px < 0.51
    assert calibrated(flat).fused is None or calibrated(flat).fused.focal_sigma_px > 5.0


def test_the_views_come_with_what_the_caller_called_them():
    calibration = SelfCalibration(IMAGE_SIZE)
    for stamp, view in zip('abc', views_of(drawn(11), 3, 11), strict=True):
        calibration.update(view.image_points, view.board_points, stamp)
    assert [kept.stamp for kept in calibration.views] == ['a', 'b', 'c']
    kept = calibration.views[0]
    expected = calibration.fused.camera.project(
        kept.camera_from_board.transform(np.pad(kept.board_points, ((0, 0), (0, 1))))
    )
    np.testing.assert_allclose(kept.residuals_px, expected - kept.image_points, atol=1e-9)


@takes_long
def test_points_on_a_line_have_no_answer_and_leave_no_trace():
    calibration = calibrated(views_of(drawn(12), 5, 12))
    before = calibration.fused.camera
    line = np.column_stack([np.linspace(-0.5, 0.5, 8), np.zeros(8)])
    estimate = calibration.update(100.0 + 500.0 * (line + 1.0), line)
    assert estimate.status is Status.COLLINEAR
    assert calibration.verdict is Verdict.NO_POSE
    assert calibration.fused.camera == before


@takes_long
def test_noise_without_a_board_has_no_answer():
    calibration = SelfCalibration(IMAGE_SIZE)
    rng = np.random.default_rng(0)
    estimate = calibration.update(rng.uniform((0, 0), IMAGE_SIZE, (24, 2)), BOARD)
    assert estimate.model is None
    assert calibration.verdict is Verdict.NO_POSE


@pytest.mark.parametrize(
    'wrong',
    [
        {'max_views': 1},
        {'min_views': 1},
        {'focal_tolerance': 0.0},
        {'center_spread': float('nan')},
        {'outliers_to_restart': 11},
    ],
    ids=str,
)
def test_options_out_of_range_are_refused(wrong):
    with pytest.raises(ValueError, match=next(iter(wrong))):
        CalibrationOptions(**wrong)


def test_a_wrong_view_is_the_callers_fault():
    calibration = SelfCalibration(IMAGE_SIZE)
    with pytest.raises(ValueError, match='finite'):
        calibration.update(np.full((24, 2), np.nan), BOARD)
    with pytest.raises(ValueError, match='image_size'):
        SelfCalibration((0, 480))


def _update(calibration, view):
    """Update with a view; return the estimates that on_pose got, and the camera at that moment."""
    calls = []

    def on_pose(estimate):
        fused = calibration.fused
        calls.append((estimate, fused and fused.camera))

    returned = calibration.update(view.image_points, view.board_points, on_pose=on_pose)
    [(estimate, camera)] = calls
    assert estimate is returned
    return estimate, camera


@takes_long
def test_a_calibrated_camera_publishes_the_pose_before_it_learns():
    """The pose is by the camera before the update, and hardly differs from the one after it."""
    views = views_of(drawn(13), 40, 13)
    calibration, in_turn = calibrated(views[:30]), calibrated(views[:30])
    assert calibration.state is CalibrationState.CALIBRATED
    for view in views[30:]:
        before = calibration.fused.camera
        early, camera = _update(calibration, view)
        assert early.model.camera == before == camera
        late = in_turn.update(view.image_points, view.board_points)
        assert late.model.camera == in_turn.fused.camera == calibration.fused.camera
        step = late.model.camera_from_board.translation - early.model.camera_from_board.translation
        assert step @ np.linalg.solve(early.covariance[:3, :3], step) < 1.0


@takes_long
def test_other_poses_are_published_after_the_update():
    """Without a calibrated camera, or by a view that disagrees with it."""
    views = views_of(drawn(13), 30, 13)
    calibration = SelfCalibration(IMAGE_SIZE)
    estimate, camera = _update(calibration, views[0])
    assert camera is not None
    assert camera == estimate.model.camera == calibration.fused.camera
    calibrated(views[1:], calibration)
    strange = views_of(drawn(14), 1, 14)[0]
    estimate, camera = _update(calibration, strange)
    assert calibration.verdict is Verdict.OUTLIER
    assert estimate.model.camera != camera
