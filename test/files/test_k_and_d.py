# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""K, D and the name of the model, as drivers and programs write them, mean the right camera."""

import cv2
import numpy as np
from p4pfr_ros.files.k_and_d import assumption, camera_from_k_and_d, Names
import pytest

SIZE = (640, 480)
K = (500.0, 0.0, 320.0, 0.0, 505.0, 240.0, 0.0, 0.0, 1.0)
SKEWED = (500.0, 4.0, 320.0, 0.0, 505.0, 240.0, 0.0, 0.0, 1.0)
FIVE = (-0.3, 0.1, 0.001, -0.002, 0.05)
EIGHT = (*FIVE, 0.02, -0.01, 0.005)
FOUR = (0.17, -0.03, 0.0004, -0.0007)
POINTS = np.random.default_rng(3).uniform((-0.5, -0.4, 0.9), (0.5, 0.4, 1.1), (40, 3))


def projected_by_opencv(k, d, *, fisheye=False):
    matrix, d, points = np.reshape(k, (3, 3)), np.array(d, dtype=float), POINTS[:, None]
    if fisheye:
        alpha = matrix[0, 1] / matrix[0, 0]
        pixels, _ = cv2.fisheye.projectPoints(
            points, np.zeros(3), np.zeros(3), matrix, d, alpha=alpha
        )
    else:
        pixels, _ = cv2.projectPoints(points, np.zeros(3), np.zeros(3), matrix, d)
    return pixels[:, 0]


@pytest.mark.parametrize(
    ('name', 'd', 'same_as'),
    [
        ('', (), ()),
        ('', (0.0,) * 5, ()),
        ('none', (), ()),
        ('pinhole', FIVE, FIVE),
        ('', FIVE, FIVE),
        ('plumb_bob', (), ()),
        ('plumb_bob', FIVE[:4], FIVE[:4]),
        ('plumb_bob', FIVE, FIVE),
        ('Plumb Bob', FIVE, FIVE),
        ('plumb_bob', (*FIVE, 0.0), FIVE),
        ('plumb_bob', EIGHT, EIGHT),
        ('plumb_bob', (*FIVE, *[0.0] * 9), FIVE),
        ('radtan', FOUR, FOUR),
        ('radial-tangential', FOUR, FOUR),
        ('rational_polynomial', (), ()),
        ('rational_polynomial', FIVE, FIVE),
        ('rational_polynomial', EIGHT, EIGHT),
        ('rational_polynomial', (*EIGHT, *[0.0] * 4), EIGHT),
        ('rational_polynomial', (*EIGHT, *[0.0] * 6), EIGHT),
    ],
)
def test_opencvs_models_project_as_opencv_does(name, d, same_as):
    camera = camera_from_k_and_d(K, d, name, SIZE)
    expected = projected_by_opencv(K, same_as or [0.0] * 5)
    np.testing.assert_allclose(camera.project(POINTS), expected, atol=1e-9)
    np.testing.assert_allclose(camera.project(camera.unproject(expected)), expected, atol=1e-7)


@pytest.mark.parametrize('k', [K, SKEWED], ids=['square', 'skewed'])
@pytest.mark.parametrize(
    ('name', 'd'),
    [
        ('equidistant', FOUR),
        ('fisheye', FOUR),
        ('equi', FOUR),
        ('Kannala-Brandt4', FOUR),
        ('equidistant', (*FOUR, 0.0)),
        ('equidistant', (0.0,) * 4),
    ],
)
def test_fisheyes_project_as_opencvs_with_alpha(name, d, k):
    camera = camera_from_k_and_d(k, d, name, SIZE)
    expected = projected_by_opencv(k, d[:4], fisheye=True)
    assert camera.distortion_model == 'equidistant'
    np.testing.assert_allclose(camera.project(POINTS), expected, atol=1e-9)
    np.testing.assert_allclose(camera.project(camera.unproject(expected)), expected, atol=1e-7)


def test_the_skew_is_that_of_the_matrix():
    camera = camera_from_k_and_d(SKEWED, (), 'plumb_bob', SIZE)
    expected = (POINTS / POINTS[:, 2:]) @ np.reshape(SKEWED, (3, 3)).T
    np.testing.assert_allclose(camera.project(POINTS), expected[:, :2], atol=1e-9)
    np.testing.assert_allclose(
        camera.unproject(expected[0, :2]), POINTS[0] / np.linalg.norm(POINTS[0])
    )


@pytest.mark.parametrize(
    ('k', 'd', 'name', 'message'),
    [
        (K, (*EIGHT, 1e-3, 0, 0, 0), 'rational_polynomial', 'd: expected no thin prism terms'),
        (K, (*EIGHT, 0, 0, 0, 0, 0.1, 0), 'rational_polynomial', 'd: expected no tilt of the sen'),
        (K, (0.1, 0.2), 'plumb_bob', 'd: expected 4, 5, 8, 12, 14 numbers of plumb_bob .* got 2'),
        (K, (*EIGHT, 0.1), 'plumb_bob', 'numbers of plumb_bob .* got 9: add zeros'),
        (K, EIGHT, 'equidistant', 'expected 4 numbers of equidistant .* got 8: is the model'),
        (K, (0.1,), 'fov', "model: expected one of plumb_bob, .*, got 'fov': calibrate again"),
        (K, FIVE, 'none', 'model: expected the name of the model of d, got none'),
        (K, FIVE, 'unknown', "got 'unknown': calibrate again"),
        (K[:8], FIVE, '', 'k: expected 9 numbers, got 8: write'),
        (np.reshape(K, (3, 3)).T.ravel(), FIVE, '', r'k: expected \[fx s cx .* transpose it'),
    ],
)
def test_what_loses_information_is_rejected_with_a_way_out(k, d, name, message):
    with pytest.raises(ValueError, match=message) as caught:
        camera_from_k_and_d(k, d, name, SIZE, Names(k='k', d='d', model='model'))
    assert len(str(caught.value)) <= 170


@pytest.mark.parametrize(
    ('name', 'd', 'warns'),
    [
        ('', FIVE, True),
        (' ', FOUR, True),
        ('', (), False),
        ('', (0.0,), False),
        ('x', FIVE, False),
    ],
)
def test_only_coefficients_without_a_model_are_assumed(name, d, warns):
    assert ('taken as plumb_bob' in assumption(d, name)) is warns
