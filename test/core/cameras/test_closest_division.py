# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""The division camera closest to one that was calibrated in another model."""

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
def test_the_way_back_finds_the_camera_again(camera, within_px):
    found, residual_px = division_camera_from_model(camera.to_camera_info_model(SIZE))
    assert residual_px < within_px
    assert found.focal_px == pytest.approx(camera.focal_px, rel=1e-3)
    assert found.k == pytest.approx(camera.k, abs=2e-3)
    assert (found.k2 == 0.0) == (camera.k2 == 0.0)


@over_models
def test_the_closest_division_camera_is_off_by_its_residual(model):
    found, residual_px = division_camera_from_model(model)
    # fx and fy differ by up to 5 in 900, which no division camera follows.
    assert residual_px < 6.0
    away_px = np.linalg.norm(found.project(model.unproject(pixels())) - pixels(), axis=1)
    assert away_px.max() <= 1.001 * residual_px + 1e-9
    assert away_px.max() >= 0.7 * residual_px - 1e-9


def test_the_closest_is_closest_in_pixels():
    """Without weights the rim counts for less, and 2.4 px are left of it."""
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
