# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""Terms of the lens are freed where the views ask for them, and outliers do not hide them."""

from dataclasses import replace

from calibration_views import (
    calibrate,
    compiled_only,
    draw_views,
    Equidistant,
    lens_error,
    seeded_camera,
)
import numpy as np
from p4pfr_ros import CalibrationState, SelfCalibration
from p4pfr_ros.scenes.camera_views import board_grid
from p4pfr_ros.scenes.instances import IMAGE_SIZE
import pytest

pytestmark = compiled_only

WIDE_BOARD = board_grid(14, 8)


@pytest.mark.parametrize('seed', [0, 1, 2])
@pytest.mark.parametrize(
    'imperfection', [{'aspect': 1.02}, {'p1': 0.002, 'p2': -0.001}], ids=['aspect', 'decentring']
)
def test_aspect_and_decentring_are_freed_where_they_are_needed(imperfection, seed):
    camera = replace(seeded_camera(seed), **imperfection)
    fused = calibrate(draw_views(camera, 25, seed, noise_px=0.2)).fused
    error = lens_error(fused.camera, camera)
    assert fused.camera.aspect != 1.0
    assert fused.camera.is_decentred
    free = [0, 1, 2, 3, 7, 8, 9]
    assert (np.abs(error) < 4.0 * np.sqrt(np.diag(fused.covariance)))[free].all()
    assert fused.aspect_sigma < 0.005


@pytest.mark.parametrize('seed', [0, 1, 2])
def test_a_camera_with_pixels_far_from_square_is_calibrated_within_eight_views(seed):
    camera, calibration = replace(seeded_camera(seed), aspect=1.18), SelfCalibration(IMAGE_SIZE)
    calibrate(draw_views(camera, 8, seed, noise_px=0.2, tilt_deg=(15.0, 60.0)), calibration)
    assert calibration.state is CalibrationState.CALIBRATED
    assert calibration.fused.camera.aspect == pytest.approx(1.18, abs=0.01)


@pytest.fixture(scope='module', params=[100.0, 140.0, 185.0])
def fisheye(request):
    """Calibrate an equidistant lens; return it and its calibration."""
    lens = Equidistant(request.param, 470.0)
    views = draw_views(
        lens, 20, 1, board=WIDE_BOARD, noise_px=0.2, tilt_deg=(0.0, 60.0), distance=(0.3, 1.0)
    )
    return lens, calibrate(views)


def test_a_fisheye_asks_for_more_terms(fisheye):
    lens, calibration = fisheye
    camera = calibration.fused.camera
    assert camera.order >= 2
    assert calibration.state is CalibrationState.CALIBRATED
    assert camera.focal_px == pytest.approx(lens.focal_px, rel=0.01)
    assert calibration.fused.rms_px < 1.2 * 0.2 * np.sqrt(2.0)


def test_a_rim_that_the_terms_do_not_reach_yet_is_not_cut_off(fisheye):
    lens, calibration = fisheye
    points = np.concatenate([keyframe.image_points for keyframe in calibration.views])
    inliers = np.concatenate([keyframe.inliers for keyframe in calibration.views])
    radii = np.linalg.norm(points - lens.center_px, axis=1)
    rim = radii > 0.95 * radii.max()
    assert rim.sum() >= 5
    assert inliers[rim].mean() >= 0.9
    assert calibration.fused.seen_radius_px == pytest.approx(radii.max(), abs=5.0)


def test_a_projection_is_as_exact_as_its_standard_deviation_says(fisheye):
    """Apart from a turn of the camera, which no user of it notices."""
    lens, calibration = fisheye
    camera, limit_px = calibration.fused.camera, 4.0 * calibration.fused.projection_sigma_px
    angle, around = np.meshgrid(
        np.linspace(0.05, 0.9, 8) * lens.half_rad, np.arange(12) * np.pi / 6
    )
    rays = np.stack(
        [np.sin(angle) * np.cos(around), np.sin(angle) * np.sin(around), np.cos(angle)], axis=-1
    ).reshape(-1, 3)
    off = camera.project(rays) - lens.project(rays)
    turns = [
        (camera.project(rays + 1e-6 * np.cross(axis, rays)) - camera.project(rays)) / 1e-6
        for axis in np.eye(3)
    ]
    columns = np.stack([turn.ravel() for turn in turns], axis=-1)
    off = off.ravel() - columns @ np.linalg.lstsq(columns, off.ravel(), rcond=None)[0]
    assert np.linalg.norm(off.reshape(-1, 2), axis=1).max() < limit_px
