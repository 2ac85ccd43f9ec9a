# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""Any input gives an estimate, or an error that names the argument; never a crash or hang."""

import warnings

from hypothesis import given, settings
from hypothesis import strategies as st
import numpy as np
from p4pfr_ros import DivisionCamera, estimate_pose, EstimateOptions, Status
from p4pfr_ros.core.jit import COMPILED
from p4pfr_ros.scenes.instances import IMAGE_SIZE
from p4pfr_ros.scenes.single_view import draw_view
import pytest

CAMERA = DivisionCamera(800.0, (639.5, 479.5), -0.1)
CAMERA_ARGUMENTS = [{'image_size': IMAGE_SIZE}, {'camera': CAMERA}]
SHORT = EstimateOptions(max_iterations=50 if COMPILED else 4, min_iterations=4)

numbers = st.one_of(
    st.floats(-2000.0, 2000.0),
    st.floats(allow_nan=True, allow_infinity=True),
    st.integers(-3, 3).map(float),
)
point_lists = st.integers(0, 9).flatmap(
    lambda n: st.lists(st.tuples(numbers, numbers), min_size=n, max_size=n)
)


def estimate_or_none(image, board, known, names):
    """Return the estimate, or None if a ValueError names one of the arguments."""
    try:
        return estimate_pose(image, board, options=SHORT, **known)
    except ValueError as error:
        if str(error).split()[0] not in names:
            raise
        return None


@settings(max_examples=300 if COMPILED else 20, deadline=None)
@given(image=point_lists, board=point_lists, known=st.sampled_from(CAMERA_ARGUMENTS))
def test_any_input_gives_an_estimate_or_a_named_error(image, board, known):
    image, board = np.reshape(image, (-1, 2)), np.reshape(board, (-1, 2))
    estimate = estimate_or_none(image, board, known, ('image_points', 'board_points'))
    if estimate is None:
        return
    assert estimate.inliers.shape == (len(image),)
    if estimate.model is not None:
        assert np.isfinite(estimate.model.camera_from_board.translation).all()
        assert np.isfinite(estimate.model.camera_from_board.rotation).all()
        assert estimate.model.camera.focal_px > 0.0


def scattered(n, points=None):
    """Draw points of the image; repeat them if fewer than n are drawn."""
    drawn = np.random.default_rng(n).uniform(0.0, 900.0, (points or n, 2))
    return np.repeat(drawn, -(-n // len(drawn)), axis=0)[:n]


def collinear(n):
    return np.arange(n)[:, None] * [1.0, 2.0]


def coinciding(n):
    return np.tile([3.0, 4.0], (n, 1))


over_arguments = pytest.mark.parametrize('known', CAMERA_ARGUMENTS, ids=['free', 'known'])
over_counts = pytest.mark.parametrize('n', [4, 5, 30])


@over_arguments
@over_counts
@pytest.mark.parametrize('board', [collinear, coinciding])
@pytest.mark.parametrize('image', [scattered, collinear, coinciding])
def test_a_degenerate_board_is_collinear(image, board, n, known):
    estimate = estimate_pose(image(n), board(n), options=SHORT, **known)
    assert estimate.status is Status.COLLINEAR
    assert estimate.model is None
    assert np.isnan(estimate.covariance).all()
    assert not estimate.inliers.any()


@over_arguments
@over_counts
def test_coinciding_image_points_have_no_pose(n, known):
    estimate = estimate_pose(coinciding(n), scattered(n), options=SHORT, **known)
    assert estimate.model is None
    assert np.isnan(estimate.covariance).all()


@over_arguments
@over_counts
def test_collinear_image_points_have_no_pose_or_an_uncertain_one(n, known):
    """If there is a pose of that edge-on board, its distance is uncertain by several percent."""
    estimate = estimate_pose(collinear(n), scattered(n), options=SHORT, **known)
    if estimate.model is None:
        assert np.isnan(estimate.covariance).all()
    else:
        assert not estimate.distance_sigma < 0.05 * estimate.model.camera_from_board.distance
        assert 'camera' in known or not estimate.observable.focal


@pytest.mark.parametrize('n', [5, 30])
def test_repeated_points_count_once(n):
    """Half as many distinct points of a fronto-parallel board: no focal length, no distance."""
    image = scattered(n, (n + 1) // 2)
    board = image / 1000.0 * [1.0, -1.0]  # y up
    estimate = estimate_pose(image, board, options=SHORT, image_size=IMAGE_SIZE)
    if n == 5:  # three distinct points
        assert estimate.model is None
        return
    assert estimate.inliers.all()
    assert {'distance', 'focal'} <= set(estimate.observable.undetermined)
    assert estimate.model.camera_from_board.tilt_deg == pytest.approx(0.0, abs=0.1)


@over_arguments
@pytest.mark.parametrize('scale', [1e-200, 1e-12, 1e12, 1e200])
@pytest.mark.parametrize('which', ['image', 'board'])
def test_extreme_scales_give_an_estimate_or_a_named_error(which, scale, known):
    drawn = draw_view(np.random.default_rng(3), 12)
    image, board = drawn.image_points, drawn.board_points
    points = (scale * image, board) if which == 'image' else (image, scale * board)
    with warnings.catch_warnings():
        warnings.simplefilter('error')
        estimate = estimate_or_none(*points, known, (f'{which}_points',))
    # Only the squares of 1e200 are not finite.
    assert (estimate is None) == (scale == 1e200)


def test_the_estimate_scales_with_the_boards_unit():
    drawn = draw_view(np.random.default_rng(4), 20)
    image_points = drawn.image_points
    metres = estimate_pose(image_points, drawn.board_points, image_size=IMAGE_SIZE)
    for unit in (1e-6, 1e6):
        scaled = estimate_pose(image_points, unit * drawn.board_points, image_size=IMAGE_SIZE)
        assert scaled.model.camera.focal_px == pytest.approx(metres.model.camera.focal_px)
        np.testing.assert_allclose(
            scaled.model.camera_from_board.translation,
            unit * metres.model.camera_from_board.translation,
            rtol=1e-6,
        )
        np.testing.assert_allclose(
            scaled.covariance[:3, :3], unit**2 * metres.covariance[:3, :3], rtol=1e-5
        )


def test_any_layout_and_number_type_gives_the_same_estimate():
    drawn = draw_view(np.random.default_rng(5), 20)
    image = np.round(drawn.image_points)
    board = np.round(1000.0 * drawn.board_points)
    plain = estimate_pose(image, board, image_size=IMAGE_SIZE)
    wide = np.zeros((40, 4))
    wide[::2, 1:3] = board
    for image_points, points in [
        (image.astype(np.int16), board.astype(np.int64)),
        (image.astype(np.float32), board.astype(np.float32)),
        (np.asfortranarray(image), wide[::2, 1:3]),
        (image.tolist(), board.tolist()),
    ]:
        estimate = estimate_pose(image_points, points, image_size=IMAGE_SIZE)
        assert estimate.model.camera == plain.model.camera
        np.testing.assert_array_equal(estimate.covariance, plain.covariance)


def test_a_view_of_ten_thousand_points_is_estimated(sample):
    drawn = draw_view(np.random.default_rng(6), sample(10_000, 60), outlier_share=0.3)
    estimate = estimate_pose(drawn.image_points, drawn.board_points, image_size=IMAGE_SIZE)
    assert estimate.model.camera.focal_px == pytest.approx(drawn.camera.focal_px, rel=0.05)


@pytest.mark.parametrize('name', ['image_points', 'board_points'])
@pytest.mark.parametrize('value', [np.nan, np.inf])
def test_the_error_for_a_number_that_is_not_finite_names_its_place(name, value):
    points = {'image_points': np.random.default_rng(0).uniform(0, 900, (6, 2))}
    points['board_points'] = points['image_points'] / 900.0
    points[name] = points[name].copy()
    points[name][2, 1] = value
    with pytest.raises(ValueError, match=rf'{name} must be finite, got .* at \[2, 1\]'):
        estimate_pose(**points, image_size=IMAGE_SIZE)
