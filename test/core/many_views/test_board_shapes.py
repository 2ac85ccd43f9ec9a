# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""The shapes of boards in the calibration: flat, bowed, of several boards, loaded."""

from calibration_views import calibrate, compiled_only, lens_error, seeded_camera
import numpy as np
from p4pfr_ros import DivisionCamera, SelfCalibration, Verdict
from p4pfr_ros.core.model.board_shape import SHAPE_SIGMAS, SHAPE_SIZE
from p4pfr_ros.scenes.deviating_view import BOARD, Deviations, draw_deviating_view
from p4pfr_ros.scenes.instances import IMAGE_SIZE
import pytest

pytestmark = compiled_only

CAMERAS, VIEWS = 10, 20
FLAT = Deviations()
# Over 200 mm; the height x² of the edge is 2/3 P2(x) and a constant.
BOWED = Deviations(bow_x_m=0.0015, stretch=0.005)
BOWED_NUMBERS = np.array([0.005 / 2.005, 0.0, 0.01, 0.0, 0.0, 0.0, 0.0, 0.0])


def draw(camera, deviations, count, seed):
    rng = np.random.default_rng([seed, 2])
    return [draw_deviating_view(rng, camera, IMAGE_SIZE, BOARD, deviations) for _ in range(count)]


@pytest.fixture(scope='module')
def calibrated():
    """Calibrate ten cameras with a flat board, and with a bowed and stretched one."""
    cameras = [seeded_camera(seed) for seed in range(CAMERAS)]
    return {
        name: [
            (camera, calibrate(draw(camera, deviations, VIEWS, seed)).fused)
            for seed, camera in enumerate(cameras)
        ]
        for name, deviations in (('flat', FLAT), ('bowed', BOWED))
    }


@pytest.mark.parametrize(
    ('name', 'truth'), [('flat', np.zeros(SHAPE_SIZE)), ('bowed', BOWED_NUMBERS)]
)
def test_the_shape_is_recovered_within_three_sigma(calibrated, name, truth):
    squares = []
    for _, fused in calibrated[name]:
        shape = fused.board_shape()
        error = shape.numbers - truth
        assert (np.abs(error) < 3.0 * np.sqrt(np.diag(shape.covariance))).all()
        squares.append(error @ np.linalg.solve(shape.covariance, error))
        assert abs(shape.stretch - 2.0 * truth[0]) < 3.0 * shape.stretch_sigma
        assert (np.diag(shape.covariance) < SHAPE_SIGMAS**2).all()
    # χ² with eight degrees of freedom; the mean of ten has a σ of 1.3.
    assert np.mean(squares) < 12.0


def test_the_bow_is_that_of_the_board(calibrated):
    for _, fused in calibrated['bowed']:
        shape = fused.board_shape()
        assert abs(shape.bow - 0.0015) < 3.0 * shape.bow_sigma
        assert shape.bow_sigma < 0.0003
    assert all(fused.board_shape().bow < 0.0004 for _, fused in calibrated['flat'])


@pytest.mark.parametrize('name', ['flat', 'bowed'])
def test_the_board_does_not_bias_the_camera(calibrated, name):
    z = []
    for camera, fused in calibrated[name]:
        sigma = np.sqrt(np.diag(fused.covariance))
        z.append((lens_error(fused.camera, camera) / sigma)[:3])
        assert fused.rms_px < 0.31  # the noise is 0.2 px
    # The mean of ten has a σ of 0.32.
    assert (np.abs(np.mean(z, axis=0)) < 1.0).all()
    assert (np.abs(z) < 3.5).all()


def test_each_board_has_a_shape_that_survives_a_zoom_and_is_saved():
    camera, calibration = seeded_camera(3), SelfCalibration(IMAGE_SIZE)
    views = zip(draw(camera, FLAT, 12, 30), draw(camera, BOWED, 12, 31), strict=True)
    for flat, bowed in views:
        calibrate([flat], calibration, board='flat')
        calibrate([bowed], calibration, board='bowed')
    saved = calibration.fused
    assert set(saved.board_shapes) == {'flat', 'bowed'}
    assert {keyframe.board for keyframe in calibration.views} == {'flat', 'bowed'}
    assert saved.board_shape('flat').bow < 0.0004
    assert saved.board_shape('bowed').bow == pytest.approx(0.0015, abs=0.0003)
    assert saved.board_shape('another') is None

    loaded = SelfCalibration(IMAGE_SIZE)
    loaded.load(saved)
    assert loaded.fused.board_shapes == saved.board_shapes
    calibrate(draw(camera, BOWED, 3, 32), loaded, board='bowed')
    again = loaded.fused.board_shape('bowed')
    assert again.bow == pytest.approx(0.0015, abs=0.0003)
    assert again.bow_sigma < 1.2 * saved.board_shape('bowed').bow_sigma

    zoomed = DivisionCamera(1.5 * camera.focal_px, camera.center_px, 2.25 * camera.k)
    verdicts = []
    for view in draw(zoomed, BOWED, 10, 33):
        calibrate([view], calibration, board='bowed')
        verdicts.append(calibration.verdict)
        if verdicts[-1] is Verdict.RESTARTED:
            break
    assert verdicts[-1] is Verdict.RESTARTED
    after = calibration.fused.board_shape('bowed')
    assert after.bow == pytest.approx(0.0015, abs=0.0003)
    assert after.bow_sigma < 1.2 * saved.board_shape('bowed').bow_sigma


def test_points_that_cannot_tell_keep_the_prior_of_the_shape():
    """Of a marker's four corners the height tells next to nothing but a twist."""
    corners = 0.15 * np.array([[-0.5, 0.5], [0.5, 0.5], [0.5, -0.5], [-0.5, -0.5]])
    rng = np.random.default_rng(4)
    camera = seeded_camera(4)
    views = [
        draw_deviating_view(rng, camera, IMAGE_SIZE, corners, Deviations(noise_px=0.3))
        for _ in range(12)
    ]
    shape = calibrate(views).fused.board_shape()
    sigma = np.sqrt(np.diag(shape.covariance))
    # At the corners all polynomials of x² and y² are one.
    np.testing.assert_allclose(sigma[[2, 3, 5, 6, 7]], SHAPE_SIGMAS[[2, 3, 5, 6, 7]], rtol=0.01)
    np.testing.assert_allclose(shape.numbers[[2, 3, 5, 6, 7]], 0.0, atol=1e-5)
