# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""The division model: project inverts unproject, up to the fold of the lens."""

from hypothesis import given
from hypothesis import strategies as st
import numpy as np
from p4pfr_ros import DivisionCamera
import pytest

CENTER_PX = (319.5, 239.5)


def pixels(seed, n=50):
    """Draw pixels of a 640x480 image."""
    return np.random.default_rng(seed).uniform((0, 0), (640, 480), (n, 2))


@given(k=st.floats(-0.9, 0.1), seed=st.integers(0, 2**32 - 1))
def test_any_point_on_a_pixels_ray_projects_back_to_it(k, seed):
    camera = DivisionCamera(350.0, CENTER_PX, k)
    depth = np.random.default_rng(seed).uniform(0.2, 9.0, (50, 1))
    back = camera.project(depth * camera.unproject(pixels(seed)))
    np.testing.assert_allclose(back, pixels(seed), atol=1e-9)


@pytest.mark.parametrize(
    ('k', 'k2', 'k3'),
    [(-0.3, 0.02, -0.003), (-0.2, -0.05, 0.01), (-0.25, -0.02, 0.0), (0.05, 0.01, 0.0)],
)
def test_a_wide_lens_with_more_terms_round_trips(k, k2, k3):
    camera = DivisionCamera(300.0, CENTER_PX, k, k2, k3)
    back = camera.project(3.0 * camera.unproject(pixels(3, 2000)))
    np.testing.assert_allclose(back, pixels(3, 2000), atol=1e-9)


def test_terms_that_vanish_change_nothing():
    one = DivisionCamera(300.0, CENTER_PX, -0.3)
    more = DivisionCamera(300.0, CENTER_PX, -0.3, 1e-15, 1e-15)
    points = one.unproject(pixels(1, 500))
    np.testing.assert_allclose(more.project(points), one.project(points), atol=1e-9)


def test_the_pinhole_camera_is_the_limit_of_small_k():
    points = np.random.default_rng(0).uniform((-1, -1, 1), (1, 1, 4), (100, 3))
    pinhole = 500.0 * points[:, :2] / points[:, 2:] + CENTER_PX
    for k in (0.0, 1e-14, -1e-14):
        camera = DivisionCamera(500.0, CENTER_PX, k)
        np.testing.assert_allclose(camera.project(points), pinhole, atol=1e-9)


def test_a_ray_satisfies_the_equation_of_the_model():
    camera = DivisionCamera(200.0, (100.0, 50.0), -0.2, 0.1, -0.05)
    # d = (0.5, -0.5), |d|² = 0.5
    ray = camera.unproject([200.0, -50.0])
    np.testing.assert_allclose(ray, [0.5, -0.5, 1.0 - 0.1 + 0.025 - 0.00625])


def test_a_lens_with_negative_k_sees_behind_its_image_plane():
    camera = DivisionCamera(200.0, CENTER_PX, -0.5)
    sideways = camera.project([[1.0, 0.0, 0.0], [1.0, 0.0, -0.5]])
    assert np.isfinite(sideways).all()
    assert sideways[1, 0] > sideways[0, 0] > CENTER_PX[0] + 200.0


@pytest.mark.parametrize(
    'camera',
    [
        DivisionCamera(200.0, CENTER_PX, -0.5),
        DivisionCamera(200.0, CENTER_PX),
        DivisionCamera(200.0, CENTER_PX, 0.2),
        DivisionCamera(200.0, CENTER_PX, -0.2, -0.05),
    ],
)
def test_points_on_the_backward_axis_are_nan(camera):
    assert np.isnan(camera.project([0.0, 0.0, -1.0])).all()
    np.testing.assert_allclose(camera.project([0.0, 0.0, 1.0]), CENTER_PX)


def test_a_pincushion_lens_sees_nothing_beyond_its_fold():
    # With k > 0 the outermost ray has ρ / Z = 1 / (2 √k).
    camera = DivisionCamera(200.0, CENTER_PX, 0.25)
    assert np.isfinite(camera.project([0.999, 0.0, 1.0])).all()
    assert np.isnan(camera.project([1.001, 0.0, 1.0])).all()


@pytest.mark.parametrize(
    ('arguments', 'message'),
    [
        ({'focal_px': 0.0}, 'focal_px must be > 0, got 0.0'),
        ({'focal_px': np.nan}, 'focal_px must be finite'),
        ({'k': np.inf}, 'k must be finite'),
        ({'aspect': 0.0}, 'aspect must be > 0, got 0.0'),
        ({'p2': np.nan}, 'p2 must be finite'),
        ({'center_px': (1.0, np.nan)}, 'center_px must be finite'),
        ({'center_px': (1.0,)}, 'center_px must have shape'),
    ],
)
def test_an_invalid_camera_is_rejected(arguments, message):
    with pytest.raises(ValueError, match=message):
        DivisionCamera(**{'focal_px': 500.0, 'center_px': CENTER_PX, **arguments})


def test_cameras_with_equal_numbers_are_equal():
    numbers = DivisionCamera(np.float32(500.0), np.array(CENTER_PX), np.float64(-0.1))
    assert numbers == DivisionCamera(500.0, CENTER_PX, -0.1)
    assert hash(numbers) == hash(DivisionCamera(500.0, CENTER_PX, -0.1))


@given(
    terms=st.tuples(
        st.floats(-0.3, 0.05), st.floats(-0.03, 0.0), st.floats(-3e-3, 0.0), st.floats(-3e-4, 0.0)
    ),
    aspect=st.floats(0.8, 1.25),
    p1=st.floats(-0.005, 0.005),
    p2=st.floats(-0.005, 0.005),
    seed=st.integers(0, 2**32 - 1),
)
def test_a_camera_with_all_parameters_round_trips(terms, aspect, p1, p2, seed):
    camera = DivisionCamera(350.0, (330.0, 228.0), *terms, aspect, p1, p2)
    depth = np.random.default_rng(seed).uniform(0.2, 9.0, (50, 1))
    back = camera.project(depth * camera.unproject(pixels(seed)))
    np.testing.assert_allclose(back, pixels(seed), atol=1e-8)


def test_aspect_and_decentring_are_in_the_equation_of_the_model():
    camera = DivisionCamera(200.0, (100.0, 50.0), -0.2, aspect=1.1, p1=0.01, p2=-0.02)
    # d = (0.5, -0.5), so  2 xy = -0.5,  q + 2 x² = q + 2 y² = 1.
    ex, ey = 0.5 - 0.5 * 0.01 - 0.02, -0.5 + 0.01 + 0.5 * 0.02
    ray = camera.unproject([200.0, -60.0])
    np.testing.assert_allclose(ray, [ex, ey, 1.0 - 0.2 * (ex**2 + ey**2)])
    assert camera.focal_xy_px == pytest.approx((200.0, 220.0))
    np.testing.assert_allclose(np.diag(camera.matrix), [200.0, 220.0, 1.0])


@pytest.mark.parametrize(
    ('parameter', 'shown'),
    [({}, False), ({'aspect': 1.01}, True), ({'p1': 1e-3}, True), ({'k4': 1e-4}, True)],
)
def test_a_repr_shows_what_differs_from_a_square_centred_lens(parameter, shown):
    text = repr(DivisionCamera(500.0, CENTER_PX, -0.1, **parameter))
    assert 'k=-0.1' in text
    assert any(name in text for name in ('aspect', 'p1', 'p2', 'k4')) is shown
