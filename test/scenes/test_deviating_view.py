# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""Views with deviations show what their ground truth says, and deviate as asked."""

import cv2
import numpy as np
from p4pfr_ros.core.cameras.division import DivisionCamera
from p4pfr_ros.scenes.deviating_view import (
    BOARD,
    Deviations,
    draw_deviating_view,
    draw_lens,
    FILL,
    MARKER,
)
import pytest

SIZES = [(640, 480), (1280, 720)]
LENSES = ['division', 'plumb_bob', 'rational_polynomial', 'equidistant']
EXACT = Deviations(noise_px=0.0)


def drawn(deviations, seed=0, lens='division', size=SIZES[0], board=BOARD, **more):
    rng = np.random.default_rng(seed)
    camera = draw_lens(rng, size, lens)
    return draw_deviating_view(rng, camera, size, board, deviations, **more)


def expected(view, points):
    return view.camera.project(view.camera_from_board.transform(points))


@pytest.mark.parametrize('size', SIZES)
@pytest.mark.parametrize('lens', LENSES)
def test_views_are_inside_the_image_with_tilt_and_size_in_range(lens, size):
    for seed in range(20):
        for board in (MARKER, BOARD):
            view = drawn(EXACT, seed, lens, size, board)
            image = view.image_points
            assert ((image > 0.0) & (image < np.subtract(size, 1.0))).all()
            assert FILL[0] - 0.02 < np.ptp(image, axis=0).max() / size[0] < FILL[1] + 0.02
            normal = view.camera_from_board.rotation[:, 2]
            assert 10.0 <= np.degrees(np.arccos(-normal[2])) <= 60.0
            assert normal @ view.camera_from_board.translation < 0.0
            flat = np.pad(board, ((0, 0), (0, 1)))
            np.testing.assert_allclose(image, expected(view, flat), atol=1e-9)


@pytest.mark.parametrize('lens', LENSES[1:])
def test_lenses_are_those_of_opencv(lens):
    view = drawn(EXACT, lens=lens)
    pose, camera = view.camera_from_board, view.camera
    matrix = np.array(
        [
            [camera.focal_px[0], 0.0, camera.center_px[0]],
            [0.0, camera.focal_px[1], camera.center_px[1]],
            [0.0, 0.0, 1.0],
        ]
    )
    points = np.pad(BOARD, ((0, 0), (0, 1)))[:, None]
    project = cv2.fisheye.projectPoints if lens == 'equidistant' else cv2.projectPoints
    arguments = pose.rotation_vector, pose.translation, matrix, np.array(camera.coefficients)
    pixels = project(points, *arguments)[0].reshape(-1, 2)
    np.testing.assert_allclose(view.image_points, pixels, atol=1e-6)


def test_the_centre_is_off_by_the_share_asked_for():
    rng = np.random.default_rng(0)
    for lens in LENSES:
        camera = draw_lens(rng, (640, 480), lens, 0.08)
        off_px = np.subtract(camera.center_px, (319.5, 239.5))
        assert np.linalg.norm(off_px) == pytest.approx(0.08 * 640)
        assert np.abs(off_px).min() > 0.0
        assert np.isnan(getattr(camera, 'k', np.nan)) == (not isinstance(camera, DivisionCamera))


@pytest.mark.parametrize(
    ('deviations', 'change'),
    [
        (Deviations(noise_px=0.0, shear=0.01), np.array([[1.0, 0.01], [0.0, 1.0]])),
        (Deviations(noise_px=0.0, aspect=1.02), np.diag([1.02**-0.5, 1.02**0.5])),
    ],
)
def test_image_deviations_are_linear_about_the_centre(deviations, change):
    view = drawn(deviations)
    center = view.camera.center_px
    flat = expected(view, np.pad(BOARD, ((0, 0), (0, 1))))
    np.testing.assert_allclose(view.image_points, center + (flat - center) @ change.T, atol=1e-9)


def test_a_bowed_board_is_higher_at_its_edges_and_a_stretched_one_wider():
    view = drawn(Deviations(noise_px=0.0, bow_x_m=0.002, stretch=0.01))
    x, y = BOARD.T
    height = 0.002 * (x / 0.1) ** 2
    real = np.column_stack([1.01 * x, y, height - height.mean()])
    np.testing.assert_allclose(view.image_points, expected(view, real), atol=1e-9)
    assert np.ptp(real[:, 2]) == pytest.approx(0.002)
    np.testing.assert_array_equal(view.board_points, BOARD)
    both = Deviations(bow_x_m=0.002, bow_y_m=0.001).on_board(BOARD)[:, 2]
    assert np.ptp(both) == pytest.approx(0.003 - 0.001 * 0.2**2)


def test_noise_and_outliers_have_the_size_asked_for():
    view = drawn(Deviations(noise_px=0.5, outlier_share=0.3))
    errors = view.image_points - expected(view, np.pad(BOARD, ((0, 0), (0, 1))))
    assert view.outlier.sum() == 16
    assert 0.35 < errors[~view.outlier].std() < 0.65
    assert np.median(np.linalg.norm(errors[view.outlier], axis=1)) > 50.0


def test_a_hand_covers_half_the_board():
    missing = drawn(Deviations(noise_px=0.0, hand='missing'))
    assert 20 <= len(missing.image_points) == len(missing.board_points) <= 34
    flat = np.pad(missing.board_points, ((0, 0), (0, 1)))
    np.testing.assert_allclose(missing.image_points, expected(missing, flat), atol=1e-9)
    wrong = drawn(Deviations(noise_px=0.0, hand='wrong'))
    assert 20 <= wrong.outlier.sum() <= 34
    flat = np.pad(BOARD, ((0, 0), (0, 1)))
    errors = np.linalg.norm(wrong.image_points - expected(wrong, flat), axis=1)
    assert errors[~wrong.outlier].max() < 1e-9
    assert errors[wrong.outlier].min() > 1e-3
