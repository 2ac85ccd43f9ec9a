# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""The depth cone: its rays solve the equations, and zero is zero at its border."""

import math

from hypothesis import assume
from hypothesis import strategies as st
from laws import law
import numpy as np
from p4pfr_ros.core.minimal.cone import board_weights, depth_cone
from p4pfr_ros.core.minimal.pose import scale_image
import pytest

SQUARE = np.array([[-0.5, 0.5], [0.5, 0.5], [0.5, -0.5], [-0.5, -0.5]])
seeds = st.integers(0, 2**32 - 1)


def weights(board):
    m = np.full(4, np.nan)
    return m if board_weights(np.asarray(board, dtype=float), m) else None


def cone(image, m):
    """Return the extreme rays (2, 4), or None, with the image as the solver scales it."""
    scaled, radius, rays = np.empty((4, 2)), np.empty(4), np.full((2, 4), np.nan)
    scale_image(np.asarray(image, dtype=float), scaled, radius)
    found = depth_cone(scaled, radius, m, np.empty((4, 4)), rays)
    return rays if found else None


def picture(board, depths):
    """Find image points that four depths can have: three of them drawn, the fourth follows."""
    m = weights(board)
    rng = np.random.default_rng(7)
    image = rng.uniform(-300.0, 300.0, (4, 2))
    image[3] = -(m[:3] * depths[:3]) @ image[:3] / (m[3] * depths[3])
    return image, m


@law(seed=seeds)
def test_weights_take_the_board_apart(seed):
    board = np.random.default_rng(seed).uniform(-1.0, 1.0, (4, 2))
    m = weights(board)
    assert m is not None
    assert np.abs(m).max() == pytest.approx(1.0)
    assert abs(m.sum()) < 1e-12
    np.testing.assert_allclose(m @ board, 0.0, atol=1e-12)


@law(seed=seeds)
def test_rays_are_extreme_solutions(seed):
    rng = np.random.default_rng(seed)
    m = weights(rng.uniform(-1.0, 1.0, (4, 2)))
    image = rng.uniform(-300.0, 300.0, (4, 2))
    rays = cone(image, m)
    assume(rays is not None)
    np.testing.assert_allclose((rays * m) @ image, 0.0, atol=1e-9)
    np.testing.assert_allclose(rays.sum(axis=1), 1.0, rtol=1e-14)
    assert (rays >= 0.0).all()
    # Each lies on a face of its own, so neither is inside and no non-negative λ is outside.
    assert (rays == 0.0).sum(axis=1).min() >= 1
    assert ((rays == 0.0).argmax(axis=1) != (rays[::-1] == 0.0).argmax(axis=1)).all()


@law(seed=seeds)
def test_positive_depths_lie_between_the_rays(seed):
    rng = np.random.default_rng(seed)
    depths = rng.uniform(0.5, 2.0, 4)
    image, m = picture(SQUARE, depths)
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
    # Σ λᵢ vᵢ = 0 with λ > 0 asks that no half plane holds all four: no gap of 180°.
    assert (cone(image, m) is not None) == (gap < np.pi)


@pytest.mark.parametrize('turn_deg', [0.0, 17.0, 90.0, 211.0])
@pytest.mark.parametrize('beyond', [-1.7, -0.4, 0.6, 2.5])
def test_two_points_on_one_ray_are_on_it(turn_deg, beyond):
    # x₁ = s x₀ in truth; turned, rounding leaves a cross product of ±1e-17 in its place, whose
    # sign says nothing, and the ray with the wrong one would close the cone.
    c, s = math.cos(math.radians(turn_deg)), math.sin(math.radians(turn_deg))
    depths = np.array([1.0, 1.2, 0.9, 1.1])
    m = weights([[0.0, 0.0], [1.0, 0.1], [0.9, 1.1], [-0.2, 0.8]])
    image = np.array([[210.0, 0.0], [beyond * 210.0, 0.0], [33.0, 140.0], [0.0, 0.0]])
    image[3] = -(m[:3] * depths[:3]) @ image[:3] / (m[3] * depths[3])
    rays = cone(image @ np.array([[c, s], [-s, c]]), m)
    assert rays is not None
    straight = cone(image, m)
    np.testing.assert_allclose(np.sort(rays, axis=0), np.sort(straight, axis=0), atol=1e-13)


def test_rounding_at_the_centre_gives_no_sign():
    # A point 1e-14 px from the centre, in each direction: the depths of the others are settled.
    m = weights(SQUARE)
    depths = np.array([1.0, 1.3, 1.1, 0.9])
    image = np.array([[0.0, 0.0], [300.0, 20.0], [210.0, -250.0], [0.0, 0.0]])
    image[3] = -(m[1:3] * depths[1:3]) @ image[1:3] / (m[3] * depths[3])
    truth = cone(image, m)
    assert truth is not None
    for angle in np.linspace(0.0, 2.0 * np.pi, 9):
        image[0] = 1e-14 * np.cos(angle), 1e-14 * np.sin(angle)
        np.testing.assert_allclose(cone(image, m), truth, atol=1e-15)


def test_three_collinear_board_points_give_the_fourth_no_weight():
    for angle in np.linspace(0.1, 6.0, 7):
        along = np.array([np.cos(angle), np.sin(angle)])
        board = np.array([0.0 * along, 0.31 * along, 0.77 * along, [0.3, -0.4]])
        board += [5.1, -2.3]
        assert weights(board)[3] == 0.0


def test_two_rays_that_are_one_leave_no_inside():
    # Every point on one line through the centre: the cross products are all zero.
    assert cone([[10, 5], [20, 10], [-40, -20], [30, 15]], weights(SQUARE)) is None


@pytest.mark.parametrize('scale', [1e-150, 1e-20, 1.0, 1e20, 1e150])
def test_points_on_a_line_are_no_board_in_any_unit(scale):
    line = np.array([[0.0, 0.1], [1.0, 0.3], [2.0, 0.5], [3.5, 0.8]])
    assert weights(scale * line) is None
    assert weights(scale * SQUARE) is not None


def test_a_board_of_one_point_is_no_board():
    assert weights(np.full((4, 2), 3.7)) is None
