# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""CameraInfo models: round trips, folds, and the closest model of a division camera."""

from fractions import Fraction

from fisheyes import equidistant_fit
from hypothesis import strategies as st
from laws import law
from lenses import CENTER, MODELS, pixels, SIZE
import numpy as np
from p4pfr_ros import DivisionCamera
from p4pfr_ros.core.cameras.camera_info import CameraInfoModel
from p4pfr_ros.core.cameras.closest_division import division_camera_from_model
from p4pfr_ros.core.cameras.convert import closed_form
import pytest

over_models = pytest.mark.parametrize('model', MODELS.values(), ids=MODELS)


def test_the_closed_form_is_the_series_up_to_the_sixth_power():
    """The series is C(w) = Σ Cₙ wⁿ with the Catalan numbers Cₙ; w = k ρ²."""
    catalan = [Fraction(1)]
    for n in range(8):
        catalan.append(catalan[-1] * (4 * n + 2) / (n + 2))
    assert catalan[:7] == [1, 1, 2, 5, 14, 42, 132]
    k1, k2, p1, p2, k3, k4, k5, k6 = (Fraction(c) for c in closed_form(1.0))
    assert (p1, p2) == (0, 0)
    product = [
        sum(d * catalan[n - i] for i, d in enumerate((1, k4, k5, k6)) if i <= n) for n in range(8)
    ]
    assert product[:7] == [1, k1, k2, k3, 0, 0, 0]
    assert product[7] != 0


@pytest.mark.parametrize(
    ('f', 'k', 'within_px'),
    [(1000, -0.15, 1e-5), (700, -0.2, 1e-4), (600, -0.25, 1e-3), (600, -0.35, 0.01)],
)
def test_the_rational_model_is_close_to_a_moderate_lens(f, k, within_px):
    camera = DivisionCamera(f, CENTER, k)
    model = camera.to_camera_info_model(SIZE)
    assert model.distortion_model == 'rational_polynomial'
    assert model.residual_px < within_px
    error_px = np.linalg.norm(model.project(camera.unproject(pixels())) - pixels(), axis=1)
    assert error_px.max() <= 1.001 * model.residual_px + 1e-9


@pytest.mark.parametrize(
    ('f', 'k', 'k2', 'k3', 'kind', 'within_px'),
    [
        (600, -0.45, 0.0, 0.0, 'equidistant', 0.1),  # 163 degrees
        (400, -0.25, 0.0, 0.0, 'equidistant', 0.01),  # 180 degrees
        (300, -0.25, 0.0, 0.0, 'equidistant', 0.02),  # 212 degrees
        (600, -0.6, 0.0, 0.0, 'equidistant', 1.0),
        (700, -0.25, 0.02, -0.003, 'rational_polynomial', 1e-3),
        (500, -0.25, -0.02, 0.0, 'rational_polynomial', 0.1),
        (400, -0.3, 0.02, -0.01, 'equidistant', 0.3),
        (1000, 0.1, 0.0, 0.0, 'rational_polynomial', 1e-4),
        (1000, 0.0, 0.0, 0.0, 'rational_polynomial', 1e-9),
        (1000, 1e-12, 0.0, 0.0, 'rational_polynomial', 1e-9),
    ],
)
def test_the_residual_bounds_the_error_of_every_model(f, k, k2, k3, kind, within_px):
    camera = DivisionCamera(f, CENTER, k, k2, k3)
    model = camera.to_camera_info_model(SIZE)
    assert model.distortion_model == kind
    assert model.residual_px < within_px
    error_px = np.linalg.norm(model.project(camera.unproject(pixels())) - pixels(), axis=1)
    assert error_px.max() <= 1.001 * model.residual_px + 1e-9


@law(examples=60, f=st.floats(250, 3000), k=st.floats(-0.7, 0.4), x=st.floats(300, 900))
def test_a_model_does_not_fold_inside_the_image(f, k, x):
    camera = DivisionCamera(f, (x, 400.0), k)
    model = camera.to_camera_info_model(SIZE)
    corner = max(np.hypot(x + 0.5, 559.5), np.hypot(1279.5 - x, 559.5)) / f
    end = min(corner, 0.99 / np.sqrt(k)) if k > 0.0 else corner
    r = np.linspace(0.0, end, 3000)
    rays = np.stack([r, 0.0 * r, 1.0 + k * r**2], axis=1)
    assert (np.diff(model.project(rays)[:, 0]) > 0.0).all()


@pytest.mark.parametrize('aspect', [0.85, 1.03])
@pytest.mark.parametrize(('p1', 'p2'), [(0.0, 0.0), (5e-4, -2e-4)])
@pytest.mark.parametrize('f', [1000, 1500])
def test_aspect_and_decentring_are_carried(f, aspect, p1, p2):
    camera = DivisionCamera(f, CENTER, -0.2, aspect=aspect, p1=p1, p2=p2)
    model = camera.to_camera_info_model(SIZE)
    assert model.distortion_model == 'rational_polynomial'
    assert model.focal_px == pytest.approx((f, f * aspect))
    assert model.residual_px < 0.1
    error_px = np.linalg.norm(model.project(camera.unproject(pixels())) - pixels(), axis=1)
    assert error_px.max() < 1.1 * model.residual_px + 1e-3


@pytest.mark.parametrize('fov_deg', [140, 185])
def test_a_fisheye_is_exported_where_it_was_seen_and_monotonic_beyond(fov_deg):
    """Its image circle leaves the corners dark: there the terms are an extrapolation."""
    camera, seen_px = equidistant_fit(fov_deg)
    model = camera.to_camera_info_model(SIZE, seen_px)
    assert model.distortion_model == 'equidistant'
    assert model.residual_px < 0.05
    corners = pixels(20_000)
    rays = model.unproject(corners)
    assert np.isfinite(rays).all()
    # Farther from the centre, farther from the axis.
    order = np.argsort(np.linalg.norm(corners - camera.center_px, axis=1))
    assert (np.diff(rays[order, 2]) < 1e-9).all()
    inside = np.linalg.norm(corners - camera.center_px, axis=1) < seen_px
    error_px = np.linalg.norm(model.project(camera.unproject(corners)) - corners, axis=1)
    assert error_px[inside].max() <= 1.001 * model.residual_px
    # Over the whole image the fit would be worse where the lens was seen.
    whole = camera.to_camera_info_model(SIZE)
    error_px = np.linalg.norm(whole.project(camera.unproject(corners)) - corners, axis=1)
    assert error_px[inside].max() > model.residual_px


def test_pixels_beyond_the_fold_of_a_pincushion_lens_are_excluded():
    """The corners have k r² = 1.1; the lens folds at k r² = 1."""
    camera = DivisionCamera(800.0, CENTER, 1.1)
    assert camera.to_camera_info_model(SIZE).residual_px < 5.0


def test_a_model_that_folds_is_fitted_with_fewer_terms():
    """No real lens is like this one; the large residual shows that the model is not close."""
    camera = DivisionCamera(300.0, CENTER, 0.27, 0.005, -0.019)
    model = camera.to_camera_info_model(SIZE)
    assert model.coefficients[-1] == 0.0
    assert 100.0 < model.residual_px < np.inf


@over_models
def test_the_ray_of_a_pixel_projects_back_to_it(model):
    rays = model.unproject(pixels())
    np.testing.assert_allclose(np.linalg.norm(rays, axis=-1), 1.0, atol=1e-12)
    np.testing.assert_allclose(model.project(3.0 * rays), pixels(), atol=1e-9)


@over_models
def test_arrays_of_any_shape_are_mapped(model):
    many = pixels(59).reshape(8, 8, 2)
    rays = model.unproject(many)
    np.testing.assert_allclose(rays[3, 4], model.unproject(many[3, 4]), atol=1e-12)
    assert model.project(rays).shape == many.shape


def test_points_and_pixels_beyond_the_fold_are_nan():
    # ρ (1 - ρ² / 3) turns back at ρ = 1, where it is 2/3.
    model = CameraInfoModel('plumb_bob', (-1 / 3, 0, 0, 0), (900.0, 900.0), CENTER, 0.0, SIZE)
    assert np.isfinite(model.project([0.999, 0.0, 1.0])).all()
    assert np.isnan(model.project([1.001, 0.0, 1.0])).all()
    assert np.isfinite(model.unproject([CENTER[0] + 599.0, CENTER[1]])).all()
    assert np.isnan(model.unproject([CENTER[0] + 601.0, CENTER[1]])).all()
    assert np.isnan(model.project([0.0, 0.0, -1.0])).all()


def test_a_fisheye_sees_behind_its_image_plane_up_to_its_fold():
    # θ (1 - θ² / 12) turns back at θ = 2.
    model = CameraInfoModel('equidistant', (-1 / 12, 0, 0, 0), (400.0, 400.0), CENTER, 0.0, SIZE)
    behind = [np.sin(1.9), 0.0, np.cos(1.9)]
    np.testing.assert_allclose(model.unproject(model.project(behind)), behind, atol=1e-12)
    assert np.isnan(model.project([np.sin(2.1), 0.0, np.cos(2.1)])).all()
    assert np.isnan(model.unproject([CENTER[0] + 400.0 * 4 / 3 + 1.0, CENTER[1]])).all()
    endless = CameraInfoModel('equidistant', (0, 0, 0, 0), (400.0, 400.0), CENTER, 0.0, SIZE)
    assert np.isnan(endless.project([0.0, 0.0, -1.0])).all()


@pytest.mark.parametrize('kind', ['rational_polynomial', 'equidistant'])
@pytest.mark.parametrize('size', [1e300, 1e150, 1e-300])
def test_extreme_coefficients_raise_no_error(kind, size):
    n = 8 if kind == 'rational_polynomial' else 4
    for signs in ((1,) * n, (-1,) * n, (1, -1) * (n // 2)):
        d = tuple(s * size for s in signs)
        model = CameraInfoModel(kind, d, (500.0, 500.0), CENTER, 0.0, SIZE)
        assert model.project(model.unproject(pixels(20))).shape == (25, 2)
        division_camera_from_model(model)


@pytest.mark.parametrize(
    ('arguments', 'message'),
    [
        ({'distortion_model': 'division'}, "distortion_model must be one of .*, got 'division'"),
        ({'coefficients': (0.1,) * 6}, 'coefficients must be 4 or 5 of plumb_bob, got 6'),
        ({'coefficients': (np.nan,) * 5}, 'coefficients must be finite'),
        ({'focal_px': (500.0, 0.0)}, 'focal_px must be > 0'),
        ({'center_px': (500.0,)}, 'center_px must have shape'),
        ({'residual_px': -1.0}, 'residual_px must be ≥ 0'),
        ({'image_size': (0, 480)}, 'image_size must be positive'),
        ({'skew_px': 501.0}, 'skew_px must be at most fx = 500'),
        ({'skew_px': np.nan}, 'skew_px must be finite'),
    ],
)
def test_an_invalid_model_is_rejected(arguments, message):
    good = {
        'distortion_model': 'plumb_bob',
        'coefficients': (0.0,) * 5,
        'focal_px': (500.0, 500.0),
        'center_px': CENTER,
        'residual_px': 0.0,
        'image_size': SIZE,
    }
    CameraInfoModel(**good)
    with pytest.raises(ValueError, match=message):
        CameraInfoModel(**{**good, **arguments})


def test_a_plumb_bob_with_four_coefficients_gets_a_fifth_of_zero():
    four = CameraInfoModel('plumb_bob', (0.1, 0.2, 0.3, 0.4), (1.0, 1.0), CENTER, 0.0, SIZE)
    assert four.coefficients == (0.1, 0.2, 0.3, 0.4, 0.0)
