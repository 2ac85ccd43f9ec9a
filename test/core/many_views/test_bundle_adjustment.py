# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""Bundle adjustment: derivatives, elimination of the poses, and the optimum."""

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


def draw_bundle(lens, count, noise_px=0.3, seed=3):
    """Draw views; return them stacked, their true poses (V, 12), and the lens as an array."""
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


def stepped(pose, step):
    """Return a pose (12,) after a step (6,), as the adjustment takes it."""
    new = np.empty(12)
    rotate(pose, *step[:3], new)
    new[9:] = pose[9:] + step[3:]
    return new


@over_lenses
def test_the_jacobian_is_the_derivative_of_the_residual(lens):
    bundle, poses, lens = draw_bundle(lens, 2)
    sizes = np.array([1e-6] * 6 + [1e-3, 1e-3, 1e-3, 1e-6, 1e-6, 1e-6])
    for i in range(0, 48, 5):
        pose, point, pixel = poses[i // 24], bundle.board[i], bundle.image[i]
        _, jacobian = residual(pose, lens, point, pixel)
        for column, size in enumerate(sizes):
            residuals = []
            for sign in (1.0, -1.0):
                step = np.zeros(12)
                step[column] = sign * size
                residuals.append(
                    residual(stepped(pose, step[:6]), lens + step[6:], point, pixel)[0]
                )
            difference = (residuals[0] - residuals[1]) / (2.0 * size)
            scale = np.abs(jacobian[:, column]).max() + 1.0
            np.testing.assert_allclose(jacobian[:, column], difference, atol=1e-5 * scale)


@over_lenses
def test_the_squared_error_is_the_squared_reprojection_error(lens):
    bundle, poses, lens = draw_bundle(lens, 2, noise_px=0.0)
    displaced = np.add(bundle.image, (3.0, -4.0))
    for i in range(48):
        point = bundle.board[i]
        assert squared_error(poses[i // 24], lens, *point, *bundle.image[i]) < 1e-16
        error = squared_error(poses[i // 24], lens, *point, *displaced[i])
        assert error == pytest.approx(25.0, rel=1e-9)


def test_eliminating_the_poses_does_not_change_the_step_of_the_lens():
    bundle, poses, lens = draw_bundle(LENSES['two terms'], 4)
    work = adjustment_work(4)
    lens = np.add(lens, (1.0, 0.5, -0.5, 0.001, 0.001, 0.0))
    assert fill_blocks(bundle, poses, lens, LIMIT, work) == 96
    assert lens_equations(4, lens, NO_PRIOR, 0.0, work)
    step = np.linalg.solve(work.reduced[:, :LENS_SIZE], work.reduced[:, LENS_SIZE])
    # The step in all 30 unknowns at once.
    whole, right = np.zeros((30, 30)), np.zeros(30)
    for v, block in enumerate(work.blocks):
        places = np.r_[6 * v : 6 * v + 6, 24:30]
        whole[np.ix_(places, places)] += block[:RESIDUAL, :RESIDUAL]
        right[places] -= block[:RESIDUAL, RESIDUAL]
    np.testing.assert_allclose(step, np.linalg.solve(whole, right)[24:], rtol=1e-6)


@pytest.mark.parametrize('order', [1, 2, 3])
def test_the_adjustment_recovers_the_true_lens(order):
    terms = [-0.33, -0.024, -0.002][:order] + [0.0] * (3 - order)
    bundle, poses, lens = draw_bundle([500.0, 20.0, -10.0, *terms], 6, noise_px=0.0)
    start = np.add(lens, (20.0, -5.0, 5.0, 0.03, 0.0, 0.0))
    start[3 + order :] = 0.0
    work = adjustment_work(6)
    cost = adjust(bundle, poses.copy(), start, order, NO_PRIOR, LIMIT, 50, 1e-15, work)
    assert cost < 1e-10
    np.testing.assert_allclose(start, lens, atol=1e-5)


def test_no_nearby_lens_and_poses_have_a_lower_cost():
    bundle, poses, lens = draw_bundle(LENSES['barrel'], 6)
    adjust(bundle, poses, lens, 1, NO_PRIOR, LIMIT, 50, 1e-15, adjustment_work(6))
    best = truncated_cost(bundle, poses, lens, LIMIT, np.inf)
    rng = np.random.default_rng(0)
    for _ in range(20):
        step = rng.normal(0.0, 1e-4, (6, 6))
        nearby_poses = np.array([stepped(pose, s) for pose, s in zip(poses, step, strict=True)])
        nearby_lens = lens + rng.normal(0.0, 1.0, 6) * (0.05, 0.05, 0.05, 1e-4, 0.0, 0.0)
        assert truncated_cost(bundle, nearby_poses, nearby_lens, LIMIT, np.inf) > best


def test_an_outlier_has_no_influence():
    bundle, poses, lens = draw_bundle(LENSES['barrel'], 6)
    without_outlier, with_outlier = lens.copy(), lens.copy()
    adjust(bundle, poses.copy(), without_outlier, 1, NO_PRIOR, 4.0, 50, 1e-15, adjustment_work(6))
    bundle.image[7] += 50.0
    adjust(bundle, poses.copy(), with_outlier, 1, NO_PRIOR, 4.0, 50, 1e-15, adjustment_work(6))
    assert np.abs(with_outlier - without_outlier).max() < 0.5
    squares = np.empty(len(bundle.image))
    squared_errors(bundle, poses, with_outlier, squares)
    assert squares[7] > 1000.0


def test_a_tight_prior_determines_the_centre():
    bundle, poses, lens = draw_bundle(LENSES['barrel'], 1)
    tight = WeightedPrior(
        np.add(lens, (0.0, 3.0, 0.0, 0.0, 0.0, 0.0)), np.diag([0, 1e9, 0, 0, 0, 0.0])
    )
    adjust(bundle, poses, lens, 1, tight, LIMIT, 50, 1e-12, adjustment_work(1))
    assert lens[1] == pytest.approx(23.0, abs=1e-3)
