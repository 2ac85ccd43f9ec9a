# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""The depth cone: its rays solve the equations, and rounding gives zeros no sign."""

import math

from hypothesis import assume
from hypothesis import strategies as st
from laws import law
import numpy as np
from p4pfr_ros.core.minimal.cone import board_weights, depth_cone
from p4pfr_ros.core.minimal.four import points_of
from p4pfr_ros.core.minimal.pose import scale_image
import pytest

SQUARE = np.array([[-0.5, 0.5], [0.5, 0.5], [0.5, -0.5], [-0.5, -0.5]])
seeds = st.integers(0, 2**32 - 1)


def weights(board):
    exists, m = board_weights(points_of(np.asarray(board, dtype=float)))
    return np.array(m) if exists else None


def cone(image, m):
    """Return the extreme rays (2, 4), or None, with the image as the solver scales it."""
    _, scaled, radius = scale_image(points_of(np.asarray(image, dtype=float)))
    found = depth_cone(scaled, radius, tuple(m))
    return np.array([found.a, found.b]) if found.opens else None


def image_from_depths(board, depths):
    """Return image points with given depths, three of them drawn, and the board's weights."""
    m = weights(board)
    rng = np.random.default_rng(7)
    image = rng.uniform(-300.0, 300.0, (4, 2))
    image[3] = -(m[:3] * depths[:3]) @ image[:3] / (m[3] * depths[3])
    return image, m


@law(seed=seeds)
def test_weighted_board_points_sum_to_zero(seed):
    board = np.random.default_rng(seed).uniform(-1.0, 1.0, (4, 2))
    m = weights(board)
    assert m is not None
    assert np.abs(m).max() == pytest.approx(1.0)
    assert abs(m.sum()) < 1e-12
    np.testing.assert_allclose(m @ board, 0.0, atol=1e-12)


@law(seed=seeds)
def test_the_rays_are_the_extreme_solutions(seed):
    rng = np.random.default_rng(seed)
    m = weights(rng.uniform(-1.0, 1.0, (4, 2)))
    image = rng.uniform(-300.0, 300.0, (4, 2))
    rays = cone(image, m)
    assume(rays is not None)
    np.testing.assert_allclose((rays * m) @ image, 0.0, atol=1e-9)
    np.testing.assert_allclose(rays.sum(axis=1), 1.0, rtol=1e-14)
    assert (rays >= 0.0).all()
    # Each has its own zero entry, so both are on the boundary of λ ≥ 0 and span the whole cone.
    assert (rays == 0.0).sum(axis=1).min() >= 1
    assert ((rays == 0.0).argmax(axis=1) != (rays[::-1] == 0.0).argmax(axis=1)).all()


@law(seed=seeds)
def test_positive_depths_lie_between_the_rays(seed):
    rng = np.random.default_rng(seed)
    depths = rng.uniform(0.5, 2.0, 4)
    image, m = image_from_depths(SQUARE, depths)
    rays = cone(image, m)
    assert rays is not None
    share, *_ = np.linalg.lstsq(rays.T, depths, rcond=None)
    assert (share > 0.0).all()
    np.testing.assert_allclose(share @ rays, depths, rtol=1e-9)


@law(seed=seeds)
def test_no_cone_means_no_positive_depths(seed):
    rng = np.random.default_rng(seed)
    m = weights(rng.uniform(-1.0, 1.0, (4, 2)))
    image = rng.uniform(-300.0, 300.0, (4, 2))
    v = m[:, None] * image
    angles = np.sort(np.arctan2(v[:, 1], v[:, 0]))
    gap = np.diff(angles, append=angles[0] + 2.0 * np.pi).max()
    assume(abs(gap - np.pi) > 1e-9)
    # Σ λᵢ vᵢ = 0 with λ > 0 requires that no half plane contains all four: no gap of 180°.
    assert (cone(image, m) is not None) == (gap < np.pi)


@pytest.mark.parametrize('rotation_deg', [0.0, 17.0, 90.0, 211.0])
@pytest.mark.parametrize('ratio', [-1.7, -0.4, 0.6, 2.5])
def test_rounding_does_not_separate_two_points_on_one_ray(rotation_deg, ratio):
    # x₁ = s x₀ exactly. After the rotation, rounding makes their cross product ±1e-17 instead of
    # 0; with the wrong sign it would close the cone.
    c, s = math.cos(math.radians(rotation_deg)), math.sin(math.radians(rotation_deg))
    depths = np.array([1.0, 1.2, 0.9, 1.1])
    m = weights([[0.0, 0.0], [1.0, 0.1], [0.9, 1.1], [-0.2, 0.8]])
    image = np.array([[210.0, 0.0], [ratio * 210.0, 0.0], [33.0, 140.0], [0.0, 0.0]])
    image[3] = -(m[:3] * depths[:3]) @ image[:3] / (m[3] * depths[3])
    rays = cone(image @ np.array([[c, s], [-s, c]]), m)
    assert rays is not None
    unrotated = cone(image, m)
    np.testing.assert_allclose(np.sort(rays, axis=0), np.sort(unrotated, axis=0), atol=1e-13)


def test_rounding_does_not_move_a_point_off_the_centre():
    # A point 1e-14 px from the centre, in any direction, does not change the cone.
    m = weights(SQUARE)
    depths = np.array([1.0, 1.3, 1.1, 0.9])
    image = np.array([[0.0, 0.0], [300.0, 20.0], [210.0, -250.0], [0.0, 0.0]])
    image[3] = -(m[1:3] * depths[1:3]) @ image[1:3] / (m[3] * depths[3])
    expected = cone(image, m)
    assert expected is not None
    for angle in np.linspace(0.0, 2.0 * np.pi, 9):
        image[0] = 1e-14 * np.cos(angle), 1e-14 * np.sin(angle)
        np.testing.assert_allclose(cone(image, m), expected, atol=1e-15)


def test_three_collinear_board_points_give_the_fourth_zero_weight():
    for angle in np.linspace(0.1, 6.0, 7):
        along = np.array([np.cos(angle), np.sin(angle)])
        board = np.array([0.0 * along, 0.31 * along, 0.77 * along, [0.3, -0.4]])
        board += [5.1, -2.3]
        assert weights(board)[3] == 0.0


def test_coinciding_rays_enclose_no_cone():
    # All points lie on one line through the centre: all cross products are zero.
    assert cone([[10, 5], [20, 10], [-40, -20], [30, 15]], weights(SQUARE)) is None


@pytest.mark.parametrize('scale', [1e-150, 1e-20, 1.0, 1e20, 1e150])
def test_collinear_board_points_are_rejected_in_any_unit(scale):
    line = np.array([[0.0, 0.1], [1.0, 0.3], [2.0, 0.5], [3.5, 0.8]])
    assert weights(scale * line) is None
    assert weights(scale * SQUARE) is not None


def test_coinciding_board_points_are_rejected():
    assert weights(np.full((4, 2), 3.7)) is None
