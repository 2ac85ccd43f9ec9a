# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""The division camera closest to a CameraInfo model."""

from lenses import CENTER, MODELS, pixels, SIZE
import numpy as np
from p4pfr_ros import DivisionCamera
from p4pfr_ros.core.cameras.camera_info import CameraInfoModel
from p4pfr_ros.core.cameras.closest_division import division_camera_from_model
import pytest

over_models = pytest.mark.parametrize('model', MODELS.values(), ids=MODELS)


@pytest.mark.parametrize(
    ('camera', 'within_px'),
    [
        (DivisionCamera(1000.0, CENTER, -0.15), 1e-3),
        (DivisionCamera(600.0, CENTER, -0.35), 0.1),
        (DivisionCamera(400.0, CENTER, -0.25), 0.1),
        (DivisionCamera(1000.0, CENTER, 0.1), 1e-3),
        (DivisionCamera(700.0, CENTER, -0.25, 0.02, -0.003), 1e-3),
    ],
)
def test_converting_back_recovers_the_camera(camera, within_px):
    result, residual_px = division_camera_from_model(camera.to_camera_info_model(SIZE))
    assert residual_px < within_px
    assert result.focal_px == pytest.approx(camera.focal_px, rel=1e-3)
    assert result.k == pytest.approx(camera.k, abs=2e-3)
    assert (result.k2 == 0.0) == (camera.k2 == 0.0)


@over_models
def test_the_residual_is_the_largest_error_in_the_image(model):
    result, residual_px = division_camera_from_model(model)
    assert residual_px < 2.0  # of 'wide': decentring of a lens with 113 degrees
    error_px = np.linalg.norm(result.project(model.unproject(pixels())) - pixels(), axis=1)
    assert error_px.max() <= 1.001 * residual_px + 1e-9
    assert error_px.max() >= 0.7 * residual_px - 1e-9


def test_the_fit_minimises_errors_in_pixels():
    """Without weights the rim would count less, and the residual would be 2.4 px."""
    model = CameraInfoModel(
        'equidistant', (-0.02, 0.005, -0.003, 5e-4), (400.0, 400.0), CENTER, 0.0, SIZE
    )
    assert division_camera_from_model(model)[1] < 2.1


def test_a_model_that_sees_nothing_has_no_division_camera():
    # The denominator is 0 at ρ = 0.001.
    model = CameraInfoModel(
        'rational_polynomial', (-2e6, 0, 0, 0, 0, -1e6, 0, 0), (500.0, 500.0), CENTER, 0.0, SIZE
    )
    assert division_camera_from_model(model)[1] == np.inf


@pytest.mark.parametrize(
    ('camera', 'within_px'),
    [
        (DivisionCamera(1000.0, CENTER, -0.15, aspect=1.05), 1e-3),
        (DivisionCamera(400.0, CENTER, -0.25, aspect=0.97), 0.1),
        (DivisionCamera(1000.0, CENTER, -0.15, aspect=0.98, p1=5e-4, p2=-2e-4), 0.05),
    ],
)
def test_converting_back_recovers_aspect_and_decentring(camera, within_px):
    model = camera.to_camera_info_model(SIZE)
    assert model.focal_px == pytest.approx(camera.focal_xy_px)
    result, residual_px = division_camera_from_model(model)
    assert residual_px < within_px + model.residual_px
    assert result.aspect == pytest.approx(camera.aspect)
    np.testing.assert_allclose((result.p1, result.p2), (camera.p1, camera.p2), atol=2e-5)
