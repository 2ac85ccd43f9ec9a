# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""Cameras that change, outlier views, and loaded calibrations."""

import copy
import dataclasses
import functools

from calibration_views import (
    calibrate,
    compiled_only,
    draw_views,
    lens_error,
    seeded_camera,
    verdicts,
)
from errors import estimate_error
from ideal import IDEAL
import numpy as np
from p4pfr_ros import (
    CalibrationOptions,
    CalibrationState,
    DivisionCamera,
    SelfCalibration,
    Status,
    Verdict,
)
from p4pfr_ros.core.model.observation import image_center_px
from p4pfr_ros.scenes.deviating_view import BOARD, Deviations, draw_deviating_view
from p4pfr_ros.scenes.instances import IMAGE_SIZE
import pytest

pytestmark = compiled_only

SMALL_IMAGE = (640, 480)


def test_a_single_outlier_view_does_not_change_the_camera():
    camera = seeded_camera(5)
    views = draw_views(camera, 12, 5)
    calibration = calibrate(views)
    before = calibration.fused.camera
    other = DivisionCamera(1.4 * camera.focal_px, camera.center_px, camera.k)
    outlier = draw_views(other, 1, 6, tilt_deg=(30.0, 50.0))[0]
    estimate = calibration.update(outlier.image_points, outlier.board_points)
    assert calibration.verdict is Verdict.OUTLIER
    assert calibration.fused.camera == before
    # Only another camera explains the view, so the calibrated one gives no pose.
    assert estimate.status is Status.MISFIT
    assert estimate.model is None


@functools.cache
def calibrated_once(seed):
    return calibrate(draw_views(seeded_camera(seed), 20, seed, noise_px=0.3))


def calibrated(seed):
    """Return a camera, and its calibration from twenty views."""
    return seeded_camera(seed), copy.deepcopy(calibrated_once(seed))


@pytest.mark.parametrize('zoom', [0.6, 1.1, 1.5])
def test_a_camera_that_zooms_restarts_the_calibration_within_ten_views(zoom):
    for seed in range(8):
        camera, calibration = calibrated(seed)
        zoomed = DivisionCamera(zoom * camera.focal_px, camera.center_px, zoom**2 * camera.k)
        after = draw_views(zoomed, 25, 100 + seed, noise_px=0.3)
        results = verdicts(calibration, after[:10])
        assert Verdict.RESTARTED in results
        verdicts(calibration, after[10:])
        assert calibration.fused.camera.focal_px == pytest.approx(zoomed.focal_px, rel=0.01)


@pytest.mark.exhaustive
def test_a_small_change_of_focus_is_detected_from_several_views_together():
    detected = []
    for seed in range(8):
        camera = seeded_camera(seed)
        # In a world without deviations: others may be those of a board or a shutter.
        calibration = calibrate(draw_views(camera, 40, seed, noise_px=0.3), robust=IDEAL)
        refocused = DivisionCamera(1.03 * camera.focal_px, camera.center_px, 1.03**2 * camera.k)
        results = verdicts(calibration, draw_views(refocused, 20, 100 + seed, noise_px=0.3))
        detected.append(Verdict.RESTARTED in results)
    assert np.mean(detected) > 0.8


@pytest.mark.exhaustive
def test_a_camera_that_does_not_change_never_restarts_the_calibration():
    for seed in range(10):
        results = verdicts(SelfCalibration(IMAGE_SIZE), draw_views(seeded_camera(seed), 60, seed))
        assert Verdict.RESTARTED not in results


def deviating_views(camera, count, seed, tilt_deg, **deviations):
    rng, present = np.random.default_rng(seed), Deviations(**deviations)
    return [
        draw_deviating_view(rng, camera, SMALL_IMAGE, BOARD, present, tilt_deg=tilt_deg)
        for _ in range(count)
    ]


def calibrated_in_small_images(camera):
    calibration = SelfCalibration(SMALL_IMAGE)
    verdicts(calibration, deviating_views(camera, 30, 0, (10.0, 60.0)))
    assert calibration.state is CalibrationState.CALIBRATED
    return calibration


def test_a_bent_board_that_stays_never_restarts_the_calibration():
    camera = DivisionCamera(160.0, image_center_px(SMALL_IMAGE), -0.03)
    calibration = calibrated_in_small_images(camera)
    for seed in (1, 3):
        bent = deviating_views(camera, 12, seed, (0.0, 12.0), bow_x_m=0.001)
        assert Verdict.RESTARTED not in verdicts(copy.deepcopy(calibration), bent)


def test_a_view_after_a_zoom_has_no_pose_or_a_covariance_that_admits_the_zoom():
    camera = DivisionCamera(275.0, image_center_px(SMALL_IMAGE), -0.05)
    calibration = calibrated_in_small_images(camera)
    published = 0
    for view in deviating_views(dataclasses.replace(camera, focal_px=357.5), 20, 1, (15.0, 60.0)):
        estimate = copy.deepcopy(calibration).update(view.image_points, view.board_points)
        if estimate.observable.pose:
            published += 1
            error = estimate.model.camera_from_board.distance - view.camera_from_board.distance
            assert abs(error) < 5.0 * estimate.distance_sigma
    assert published  # not all views are silent


def test_new_views_refine_a_loaded_calibration():
    camera = seeded_camera(7)
    views = draw_views(camera, 30, 7)
    saved = calibrate(views[:20]).fused
    calibration = SelfCalibration(IMAGE_SIZE)
    calibration.load(saved)
    assert calibration.state is CalibrationState.CALIBRATED
    assert calibration.fused is saved
    estimate = calibration.update(views[20].image_points, views[20].board_points)
    assert estimate.model.camera.focal_px == pytest.approx(saved.camera.focal_px, rel=0.002)
    calibrate(views[21:], calibration)
    assert calibration.fused.focal_sigma_px < saved.focal_sigma_px
    error = lens_error(calibration.fused.camera, camera)[0]
    assert abs(error) < 4.0 * calibration.fused.focal_sigma_px


def test_views_at_another_zoom_replace_a_loaded_calibration():
    camera, calibration = seeded_camera(8), SelfCalibration(IMAGE_SIZE)
    calibration.load(calibrate(draw_views(camera, 10, 8)).fused)
    zoomed = DivisionCamera(0.7 * camera.focal_px, camera.center_px, 0.49 * camera.k)
    results = verdicts(calibration, draw_views(zoomed, 12, 9))
    assert Verdict.RESTARTED in results
    assert calibration.fused.camera.focal_px == pytest.approx(zoomed.focal_px, rel=0.02)


def test_reset_drops_the_camera_and_all_views():
    views = draw_views(seeded_camera(9), 6, 9)
    calibration = calibrate(views)
    first = calibrate(views).fused.camera
    calibration.reset()
    assert calibration.fused is None
    assert calibration.views == ()
    assert calibrate(views, calibration).fused.camera == first


@pytest.mark.exhaustive
def test_the_covariance_of_a_pose_from_an_outlier_view_matches_its_error():
    squares = []
    for seed in range(40):
        camera = seeded_camera(seed)
        calibration = calibrate(draw_views(camera, 12, seed))
        zoomed = DivisionCamera(1.5 * camera.focal_px, camera.center_px, 2.25 * camera.k)
        view = draw_views(zoomed, 1, 100 + seed, tilt_deg=(20.0, 60.0))[0]
        estimate = calibration.update(view.image_points, view.board_points)
        if calibration.verdict is Verdict.OUTLIER and not estimate.observable.undetermined:
            error = estimate_error(estimate.model, view)[:6]
            squares.append(error @ np.linalg.solve(estimate.covariance[:6, :6], error))
    assert len(squares) > 15
    assert np.median(squares) < 7.5  # the median of χ² with six degrees of freedom is 5.35


def test_marginalised_views_reduce_the_uncertainty():
    camera = seeded_camera(13)
    views = draw_views(camera, 300, 13)
    calibration = SelfCalibration(IMAGE_SIZE, options=CalibrationOptions(max_views=10))
    calibrate(views[:40], calibration)
    early_sigma_px = calibration.fused.focal_sigma_px
    calibrate(views[40:], calibration)
    assert len(calibration.views) == 10
    # At most √(300 / 40) = 2.7 times smaller: the first forty views are all used, too.
    assert calibration.fused.focal_sigma_px < 0.6 * early_sigma_px
    error = lens_error(calibration.fused.camera, camera)[:4]
    assert error @ np.linalg.solve(calibration.fused.covariance[:4, :4], error) < 20.0


def test_corrupt_views_in_between_do_not_spoil_the_calibration():
    camera, calibration = seeded_camera(14), SelfCalibration(IMAGE_SIZE)
    rng = np.random.default_rng(0)
    corruptions = [
        lambda image: rng.uniform((0, 0), IMAGE_SIZE, image.shape),  # random points
        lambda image: np.tile(image[:1], (len(image), 1)),  # all points coincide
        lambda image: np.where(np.arange(len(image))[:, None] < 12, image[0], image),
        lambda image: 1e5 * image,
        lambda image: image[:, [0, 0]],  # collinear points
        lambda image: image[::-1],  # in the wrong order
    ]
    for i, view in enumerate(draw_views(camera, 48, 14)):
        calibration.update(view.image_points, view.board_points)
        calibration.update(corruptions[i % 6](view.image_points), view.board_points)
    error = lens_error(calibration.fused.camera, camera)
    assert abs(error[0]) < 0.01 * camera.focal_px


def test_outliers_between_views_of_a_stationary_board_do_not_restart_the_calibration():
    camera, rng = seeded_camera(15), np.random.default_rng(1)
    calibration = calibrate(draw_views(camera, 20, 15))
    stationary = draw_views(camera, 1, 16, tilt_deg=(30.0, 50.0))[0]
    other = DivisionCamera(1.4 * camera.focal_px, camera.center_px, camera.k)
    results = []
    for outlier in draw_views(other, 10, 17, tilt_deg=(30.0, 50.0)):
        for _ in range(3):
            again = stationary.image_points + rng.normal(0.0, 0.3, stationary.image_points.shape)
            calibration.update(again, stationary.board_points)
        calibration.update(outlier.image_points, outlier.board_points)
        results.append(calibration.verdict)
    assert set(results) == {Verdict.OUTLIER}
