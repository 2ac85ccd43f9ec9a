# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""``BoardShape``: where the points of a real board are."""

import math

import numpy as np
from p4pfr_ros import DivisionCamera, estimate_pose, EstimateOptions, Pose
from p4pfr_ros.core.jit import COMPILED
from p4pfr_ros.core.model.board_shape import BoardShape, SHAPE_SIZE
from p4pfr_ros.scenes.camera_views import board_grid
import pytest

CENTER, HALF_EXTENT = (0.11, 0.04), (0.1, 0.06)
BOARD = 0.2 * board_grid(9, 6)
FLAT = np.zeros(SHAPE_SIZE)


def shape(covariance=None, **numbers):
    """Return a shape of which some of the eight numbers, by their places, are not zero."""
    values = FLAT.copy()
    for place, number in numbers.items():
        values[int(place[1:])] = number
    given = np.zeros((SHAPE_SIZE, SHAPE_SIZE)) if covariance is None else covariance
    return BoardShape(np.array(CENTER), np.array(HALF_EXTENT), values, given)


def test_a_shape_of_zeros_is_flat():
    points = shape().points([[0.3, -0.2], [0.0, 0.0]])
    np.testing.assert_array_equal(points, [[0.3, -0.2, 0.0], [0.0, 0.0, 0.0]])


def test_stretch_compares_the_width_with_the_height():
    stretched = shape(_0=0.01)
    corners = np.add(CENTER, np.multiply(HALF_EXTENT, [[-1, -1], [1, -1], [1, 1], [-1, 1]]))
    moved = stretched.points(corners)
    width, height = np.ptp(moved[:, :2], axis=0)
    assert width == pytest.approx(1.01 * 0.2)
    assert height == pytest.approx(0.99 * 0.12)
    assert stretched.stretch == pytest.approx(width / height * 0.12 / 0.2 - 1.0, rel=0.02)
    np.testing.assert_allclose(moved[:, :2].mean(axis=0), CENTER)


def test_skew_is_the_deviation_from_a_right_angle():
    skewed = shape(_1=0.01)
    origin, right, up = skewed.points(np.add(CENTER, [[0.0, 0.0], [0.1, 0.0], [0.0, 0.1]]))
    right, up = right - origin, up - origin
    cosine = right @ up / np.linalg.norm(right) / np.linalg.norm(up)
    assert skewed.skew == pytest.approx(math.asin(cosine), rel=1e-3)


@pytest.mark.parametrize(
    ('place', 'height'),
    [
        ('_2', lambda x, y: 1.5 * x**2 - 0.5),
        ('_3', lambda x, y: 1.5 * y**2 - 0.5),
        ('_4', lambda x, y: x * y),
        ('_5', lambda x, y: (1.5 * x**2 - 0.5) * (1.5 * y**2 - 0.5)),
        ('_6', lambda x, y: (35.0 * x**4 - 30.0 * x**2 + 3.0) / 8.0),
        ('_7', lambda x, y: (35.0 * y**4 - 30.0 * y**2 + 3.0) / 8.0),
    ],
)
def test_heights_are_legendre_polynomials_in_units_of_the_larger_half_extent(place, height):
    points = np.random.default_rng(0).uniform((0.0, -0.02), (0.2, 0.1), (20, 2))
    x, y = ((points - CENTER) / 0.1).T
    moved = shape(**{place: 0.02}).points(points)
    np.testing.assert_array_equal(moved[:, :2], points)
    np.testing.assert_allclose(moved[:, 2], 0.1 * 0.02 * height(x, y), atol=1e-15)


def test_bow_is_the_range_of_heights_over_the_best_plane():
    # P2(x) rises by 1.5 from the middle to the edge.
    assert shape(_2=0.01).bow == pytest.approx(0.1 * 0.015)
    assert shape(_2=-0.01).bow == pytest.approx(0.1 * 0.015)
    assert shape().bow == 0.0
    # x y on the corners of the rectangle: ±1 x 0.6.
    assert shape(_4=0.01).bow == pytest.approx(0.1 * 0.01 * 1.2)


def test_standard_deviations_are_those_of_the_covariance():
    covariance = np.diag([1e-6, 4e-6, 9e-6, *[0.0] * 5])
    known = shape(covariance, _2=0.01)
    assert known.stretch_sigma == pytest.approx(2.0 * 1e-3)
    assert known.bow_sigma == pytest.approx(0.1 * 1.5 * 3e-3)
    assert shape(covariance).bow_sigma > 0.0


def test_shapes_are_values():
    one = shape(_2=0.01)
    assert one == shape(_2=0.01)
    assert one != shape(_2=0.02)
    assert one != 1
    given = FLAT.copy()
    kept = BoardShape(np.array(CENTER), np.array(HALF_EXTENT), given, np.eye(SHAPE_SIZE))
    given[0] = 1.0
    assert kept.numbers[0] == 0.0
    for array in (one.center, one.half_extent, one.numbers, one.covariance):
        with pytest.raises(ValueError, match='read-only'):
            array[...] = 0.0
    assert repr(one) == 'BoardShape(bow=0.0015, stretch=0, skew=0)'


@pytest.mark.parametrize(
    ('arguments', 'message'),
    [
        ({'center': (0.0,)}, r'center must have shape \(2,\)'),
        ({'half_extent': (0.0, 0.0)}, 'half_extent must be > 0'),
        ({'half_extent': (0.1, -0.1)}, 'half_extent must be > 0'),
        ({'numbers': np.zeros(7)}, r'numbers must have shape \(8,\)'),
        ({'numbers': np.full(8, np.nan)}, 'numbers must be finite'),
        ({'covariance': np.eye(3)}, r'covariance must have shape \(8, 8\)'),
    ],
)
def test_an_invalid_shape_is_rejected(arguments, message):
    good = {'center': CENTER, 'half_extent': HALF_EXTENT, 'numbers': FLAT}
    good['covariance'] = np.eye(SHAPE_SIZE)
    BoardShape(**good)
    with pytest.raises(ValueError, match=message):
        BoardShape(**{**good, **arguments})


@pytest.mark.skipif(not COMPILED, reason='takes long interpreted')
def test_a_known_shape_removes_the_bias_of_a_bowed_board():
    camera = DivisionCamera(600.0, (319.5, 239.5), -0.1)
    bowed = BoardShape(
        np.zeros(2), (0.1, 0.0625), np.array([0.002, 0, 0.01, 0, 0, 0, 0, 0]), np.eye(8) * 1e-9
    )
    pose = Pose.from_rotation_vector([2.6, 0.4, 0.2], [0.01, -0.02, 0.35])
    image = camera.project(pose.transform(bowed.points(BOARD)))
    estimate = estimate_pose(image, BOARD, camera=camera, board_shape=bowed)
    found = estimate.model.camera_from_board
    np.testing.assert_allclose(found.translation, pose.translation, atol=1e-6)
    np.testing.assert_allclose(found.rotation, pose.rotation, atol=1e-6)
    assert estimate.rms_px < 1e-3
    flat = estimate_pose(image, BOARD, camera=camera, options=EstimateOptions.ideal())
    assert flat.rms_px > 0.1
    # An unknown camera, too.
    known = {'image_size': (640, 480), 'options': EstimateOptions.ideal()}
    free = estimate_pose(image, BOARD, board_shape=bowed, **known)
    biased = estimate_pose(image, BOARD, **known)
    assert abs(free.model.camera.focal_px - 600.0) < 1.0
    assert abs(biased.model.camera.focal_px - 600.0) > 3.0
    with pytest.raises(TypeError, match='board_shape must be a BoardShape, got tuple'):
        estimate_pose(image, BOARD, camera=camera, board_shape=(0.1, 0.2))
