# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""How well a camera is known where it was seen, and what is missing."""

from calibration_views import calibrate, compiled_only, draw_views, MIDDLE_PX, seeded_camera
import numpy as np
from p4pfr_ros import CalibrationState, DivisionCamera, SelfCalibration
from p4pfr_ros.core.many_views.progress import projection_sigmas_px
from p4pfr_ros.core.model.lens import camera_from_lens, lens_from_camera
from p4pfr_ros.scenes.instances import IMAGE_SIZE
import pytest

CAMERAS = {
    'one term': DivisionCamera(900.0, (650.0, 470.0), -0.2),
    'decentred': DivisionCamera(
        430.0, (630.0, 490.0), -0.33, -0.022, -0.002, -0.0003, 1.01, 0.001, 0.002
    ),
}
STATES = list(CalibrationState)


@pytest.mark.parametrize('name', CAMERAS)
def test_standard_deviations_are_those_of_drawn_cameras_after_the_best_turn(name):
    camera, rng = CAMERAS[name], np.random.default_rng(0)
    x, y = np.meshgrid(np.linspace(200.0, 1080.0, 6), np.linspace(150.0, 810.0, 5))
    pixels = np.stack([x, y], axis=-1).reshape(-1, 2)
    factor = rng.standard_normal((10, 10)) * np.array([1, 1, 1, *[1e-3] * 7])[:, None]
    factor[4:7] *= np.array([[0.1], [0.01], [0.001]])
    covariance = factor @ factor.T
    rays = camera.unproject(pixels)
    turns = [
        (camera.project(rays + 1e-6 * np.cross(axis, rays)) - pixels) / 1e-6 for axis in np.eye(3)
    ]
    turn = np.stack([each.ravel() for each in turns], axis=-1)
    lens, off = lens_from_camera(camera, MIDDLE_PX), []
    for step in rng.standard_normal((2000, 10)) @ factor.T:
        # So small that the displacement is linear.
        other = camera_from_lens(lens + 0.01 * step, MIDDLE_PX)
        moved = 100.0 * (other.project(rays) - pixels).ravel()
        off.append(moved - turn @ np.linalg.lstsq(turn, moved, rcond=None)[0])
    drawn = np.array(off).reshape(2000, -1, 2)
    moments = np.einsum('spi,spj->pij', drawn, drawn) / 2000.0
    expected = np.sqrt(np.linalg.eigvalsh(moments)[:, -1])
    sigmas = projection_sigmas_px(camera, covariance, pixels)
    np.testing.assert_allclose(sigmas, expected, rtol=0.08)


def test_a_camera_that_is_exact_has_no_uncertainty():
    camera = CAMERAS['decentred']
    pixels = np.array([[100.0, 100.0], [600.0, 400.0], [900.0, 800.0]])
    np.testing.assert_array_equal(projection_sigmas_px(camera, np.zeros((10, 10)), pixels), 0.0)


def test_a_new_calibration_asks_for_a_board():
    assert SelfCalibration(IMAGE_SIZE).missing == ('show the board',)


@compiled_only
def test_what_is_missing_names_empty_parts_of_the_image_and_the_tilt():
    camera = seeded_camera(3)
    views = draw_views(camera, 40, 3, tilt_deg=(0.0, 5.0), distance=(1.5, 3.0))
    left = [view for view in views if view.image_points[:, 0].max() < 800.0][:4]
    calibration = calibrate(left)
    missing = calibration.missing
    assert 'tilt the board by 30 to 60 degrees' in missing
    assert '1 more different view' in missing
    empty = {line for line in missing if line.startswith('no points in the')}
    for third in ('upper right', 'middle right', 'lower right'):
        assert f'no points in the {third} third of the image' in empty
    assert not any('left' in line for line in empty if 'middle' in line)
    calibrate(draw_views(camera, 20, 4, noise_px=0.2), calibration)
    assert calibration.state is CalibrationState.CALIBRATED
    assert calibration.missing == ()


@compiled_only
@pytest.mark.parametrize('order', [0, 1, 2])
def test_the_state_never_goes_down_in_any_order_of_views(order):
    camera = seeded_camera(6)
    views = draw_views(camera, 25, 6, outlier_share=0.1)
    calibration, reached = SelfCalibration(IMAGE_SIZE), [0]
    for i in np.random.default_rng(order).permutation(len(views)):
        calibrate([views[i]], calibration)
        reached.append(STATES.index(calibration.state))
        assert (calibration.fused is None) == (reached[-1] == 0)
    assert (np.diff(reached) >= 0).all()
    assert calibration.state is CalibrationState.CALIBRATED
    final, whole = calibration.fused, calibrate(views).fused
    assert abs(final.camera.focal_px - whole.camera.focal_px) < final.focal_sigma_px
