# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""The bundle's derivatives, its poses eliminated, and what the adjustment leaves."""

import numpy as np
from p4pfr_ros import DivisionCamera
from p4pfr_ros.core.linalg import rotate
from p4pfr_ros.core.many_views.bundle_adjustment import (
    adjust,
    adjustment_work,
    fill_blocks,
    lens_equations,
    squared_errors,
    StackedViews,
    truncated_cost,
)
from p4pfr_ros.core.model.lens import COLUMNS, LENS_SIZE, linearise, RESIDUAL, squared_error
from p4pfr_ros.core.model.prior import WeightedPrior
from p4pfr_ros.scenes.camera_views import board_grid, draw_camera_view
import pytest

LENSES = {
    'no distortion': [700.0, 20.0, -10.0, 0.0, 0.0, 0.0],
    'barrel': [700.0, 20.0, -10.0, -0.25, 0.0, 0.0],
    'pincushion': [700.0, 20.0, -10.0, 0.1, 0.0, 0.0],
    'two terms': [500.0, 20.0, -10.0, -0.33, -0.025, 0.0],
    'three terms': [450.0, 20.0, -10.0, -0.33, -0.022, -0.003],
}
LIMIT = 1e6
NO_PRIOR = WeightedPrior(np.zeros(LENS_SIZE), np.zeros((LENS_SIZE, LENS_SIZE)))

over_lenses = pytest.mark.parametrize('lens', LENSES.values(), ids=list(LENSES))


def views(lens, count, noise_px=0.3, seed=3):
    """Return a bundle, the true poses (V, 12), and the lens as an array."""
    focal_px, x, y, *terms = lens
    camera = DivisionCamera(focal_px, (639.5 + x, 479.5 + y), *terms)
    rng = np.random.default_rng(seed)
    drawn = [
        draw_camera_view(rng, camera, board_grid(6, 4), noise_px=noise_px) for _ in range(count)
    ]
    poses = [
        (*v.camera_from_board.rotation.ravel(), *v.camera_from_board.translation) for v in drawn
    ]
    image = np.concatenate([v.image_points for v in drawn]) - (639.5, 479.5)
    board = np.concatenate([v.board_points for v in drawn])
    starts = 24 * np.arange(count + 1)
    return StackedViews(image, board, starts), np.array(poses), np.array(lens)


def residual(pose, lens, point, pixel):
    jacobian = np.empty((2, COLUMNS))
    linearise(pose, lens, *point, *pixel, jacobian)
    return jacobian[:, RESIDUAL], jacobian


def moved(pose, step):
    """Take the step (6,) that the least squares takes."""
    new = np.empty(12)
    rotate(pose, *step[:3], new)
    new[9:] = pose[9:] + step[3:]
    return new


@over_lenses
def test_derivatives_are_those_of_the_residual(lens):
    bundle, poses, lens = views(lens, 2)
    sizes = np.array([1e-6] * 6 + [1e-3, 1e-3, 1e-3, 1e-6, 1e-6, 1e-6])
    for i in range(0, 48, 5):
        pose, point, pixel = poses[i // 24], bundle.board[i], bundle.image[i]
        _, jacobian = residual(pose, lens, point, pixel)
        for column, size in enumerate(sizes):
            ends = []
            for sign in (1.0, -1.0):
                step = np.zeros(12)
                step[column] = sign * size
                ends.append(residual(moved(pose, step[:6]), lens + step[6:], point, pixel)[0])
            difference = (ends[0] - ends[1]) / (2.0 * size)
            scale = np.abs(jacobian[:, column]).max() + 1.0
            np.testing.assert_allclose(jacobian[:, column], difference, atol=1e-5 * scale)


@over_lenses
def test_the_error_is_the_distance_that_the_camera_says(lens):
    bundle, poses, lens = views(lens, 2, noise_px=0.0)
    far = np.add(bundle.image, (3.0, -4.0))
    for i in range(48):
        point = bundle.board[i]
        assert squared_error(poses[i // 24], lens, *point, *bundle.image[i]) < 1e-16
        error = squared_error(poses[i // 24], lens, *point, *far[i])
        assert error == pytest.approx(25.0, rel=1e-9)


def test_the_lens_alone_moves_as_in_the_whole_system():
    bundle, poses, lens = views(LENSES['two terms'], 4)
    room = adjustment_work(4)
    lens = np.add(lens, (1.0, 0.5, -0.5, 0.001, 0.001, 0.0))
    assert fill_blocks(bundle, poses, lens, LIMIT, room) == 96
    assert lens_equations(4, lens, NO_PRIOR, 0.0, room)
    step = np.linalg.solve(room.reduced[:, :LENS_SIZE], room.reduced[:, LENS_SIZE])
    # The same by all 30 unknowns at once.
    whole, right = np.zeros((30, 30)), np.zeros(30)
    for v, block in enumerate(room.blocks):
        places = np.r_[6 * v : 6 * v + 6, 24:30]
        whole[np.ix_(places, places)] += block[:RESIDUAL, :RESIDUAL]
        right[places] -= block[:RESIDUAL, RESIDUAL]
    np.testing.assert_allclose(step, np.linalg.solve(whole, right)[24:], rtol=1e-6)


@pytest.mark.parametrize('order', [1, 2, 3])
def test_the_adjustment_finds_the_lens_again(order):
    terms = [-0.33, -0.024, -0.002][:order] + [0.0] * (3 - order)
    bundle, poses, lens = views([500.0, 20.0, -10.0, *terms], 6, noise_px=0.0)
    start = np.add(lens, (20.0, -5.0, 5.0, 0.03, 0.0, 0.0))
    start[3 + order :] = 0.0
    room = adjustment_work(6)
    cost = adjust(bundle, poses.copy(), start, order, NO_PRIOR, LIMIT, 50, 1e-15, room)
    assert cost < 1e-10
    np.testing.assert_allclose(start, lens, atol=1e-5)


def test_nothing_is_lower_nearby():
    bundle, poses, lens = views(LENSES['barrel'], 6)
    adjust(bundle, poses, lens, 1, NO_PRIOR, LIMIT, 50, 1e-15, adjustment_work(6))
    best = truncated_cost(bundle, poses, lens, LIMIT, np.inf)
    rng = np.random.default_rng(0)
    for _ in range(20):
        step = rng.normal(0.0, 1e-4, (6, 6))
        nearby = np.array([moved(pose, s) for pose, s in zip(poses, step, strict=True)])
        other = lens + rng.normal(0.0, 1.0, 6) * (0.05, 0.05, 0.05, 1e-4, 0.0, 0.0)
        assert truncated_cost(bundle, nearby, other, LIMIT, np.inf) > best


def test_an_outlier_does_not_pull():
    bundle, poses, lens = views(LENSES['barrel'], 6)
    without, with_it = lens.copy(), lens.copy()
    adjust(bundle, poses.copy(), without, 1, NO_PRIOR, 4.0, 50, 1e-15, adjustment_work(6))
    bundle.image[7] += 50.0
    adjust(bundle, poses.copy(), with_it, 1, NO_PRIOR, 4.0, 50, 1e-15, adjustment_work(6))
    assert np.abs(with_it - without).max() < 0.5
    squares = np.empty(len(bundle.image))
    squared_errors(bundle, poses, with_it, squares)
    assert squares[7] > 1000.0


def test_a_prior_holds_what_the_views_do_not():
    bundle, poses, lens = views(LENSES['barrel'], 1)
    tight = WeightedPrior(
        np.add(lens, (0.0, 3.0, 0.0, 0.0, 0.0, 0.0)), np.diag([0, 1e9, 0, 0, 0, 0.0])
    )
    adjust(bundle, poses, lens, 1, tight, LIMIT, 50, 1e-12, adjustment_work(1))
    assert lens[1] == pytest.approx(23.0, abs=1e-3)
