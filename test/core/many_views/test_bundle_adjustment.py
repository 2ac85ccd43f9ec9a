# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""Bundle adjustment: derivatives, elimination of the poses, and the optimum."""

from calibration_views import compiled_only
import numpy as np
from p4pfr_ros.core.linalg import rotate
from p4pfr_ros.core.many_views.bundle_adjustment import (
    adjust,
    adjustment_work,
    common_equations,
    fill_blocks,
    RESIDUAL,
    squared_errors,
    StackedViews,
    VIEW_COMMON,
)
from p4pfr_ros.core.model.board_shape import basis_of, BoardShape, SHAPE_SIZE
from p4pfr_ros.core.model.lens import camera_from_lens, LENS_SIZE
from p4pfr_ros.core.model.prior import FreeTerms, WeightedPrior
from p4pfr_ros.scenes.camera_views import board_grid, draw_camera_view
import pytest

MIDDLE_PX = (639.5, 479.5)
# Focal length, centre from the middle (px), k to k4, aspect - 1, p1, p2.
LENSES = {
    'no distortion': [700.0, 20.0, -10.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0],
    'barrel': [700.0, 20.0, -10.0, -0.25, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0],
    'pincushion': [700.0, 20.0, -10.0, 0.1, 0.0, 0.0, 0.0, -0.02, 0.001, 0.0],
    'two terms': [500.0, 20.0, -10.0, -0.33, -0.025, 0.0, 0.0, 0.01, -0.001, 0.002],
    'three terms': [450.0, 20.0, -10.0, -0.33, -0.022, -0.003, 0.0, 0.0, 0.002, -0.001],
    'four terms': [450.0, 20.0, -10.0, -0.33, -0.022, -0.002, -0.0003, 0.02, 0.001, 0.001],
}
FLAT = np.zeros(SHAPE_SIZE)
BOWED = np.array([0.002, -0.001, 0.012, -0.008, 0.005, 0.003, -0.004, 0.002])
# Even polynomials of y up to the fourth degree differ on six rows.
BOARD = board_grid(7, 6)
HALF = 0.5 * np.ptp(BOARD, axis=0)
LIMIT = 1e6
COMMON = LENS_SIZE + SHAPE_SIZE
NO_PRIOR = WeightedPrior(np.zeros(COMMON), np.zeros((COMMON, COMMON)), np.zeros(COMMON))

over_lenses = pytest.mark.parametrize('lens', LENSES.values(), ids=list(LENSES))


def draw_bundle(lens, count, noise_px=0.3, shape=FLAT, seed=3):
    """Draw views; return them stacked, their true poses (V, 12), and lens and shape (18,)."""
    camera = camera_from_lens(np.array(lens), MIDDLE_PX)
    real = BoardShape(np.zeros(2), HALF, shape, np.eye(SHAPE_SIZE)).points(BOARD)
    rng = np.random.default_rng(seed)
    drawn = [draw_camera_view(rng, camera, BOARD).camera_from_board for _ in range(count)]
    poses = [(*pose.rotation.ravel(), *pose.translation) for pose in drawn]
    image = np.concatenate([camera.project(pose.transform(real)) for pose in drawn])
    image += rng.normal(0.0, noise_px, image.shape)
    basis = 0.5 * basis_of(BOARD, np.zeros(2), 0.5)
    stacked = StackedViews(
        image - MIDDLE_PX,
        np.tile(BOARD, (count, 1)),
        np.tile(basis, (count, 1)),
        len(BOARD) * np.arange(count + 1),
        np.zeros(count, dtype=np.int64),
    )
    return stacked, np.array(poses), np.array([*lens, *shape])


def stepped(pose, step):
    """Return a pose (12,) after a step (6,), as the adjustment takes it."""
    new = np.empty(12)
    rotate(pose, *step[:3], new)
    new[9:] = pose[9:] + step[3:]
    return new


def normal_equations(stacked, pose, common):
    """Return cost, JᵀJ (24, 24) and Jᵀr (24,) of a single view."""
    work = adjustment_work(1, len(common))
    cost = fill_blocks(stacked, pose[None], common, LIMIT, work)
    block = work.blocks[0]
    return cost, block[:RESIDUAL, :RESIDUAL].copy(), block[:RESIDUAL, RESIDUAL].copy()


@over_lenses
def test_the_gradient_is_the_derivative_of_the_cost(lens):
    """By pose, all ten parameters of the lens, and the eight of the board's shape."""
    stacked, poses, common = draw_bundle(lens, 1, noise_px=5.0, shape=BOWED)
    _, _, gradient = normal_equations(stacked, poses[0], common)
    sizes = np.array([1e-5] * 6 + [1e-2] * 3 + [1e-5] * 7 + [1e-5] * 8)
    for column, size in enumerate(sizes):
        costs = []
        for sign in (1.0, -1.0):
            step = np.zeros(RESIDUAL)
            step[column] = sign * size
            pose = stepped(poses[0], step[:6])
            costs.append(normal_equations(stacked, pose, common + step[6:])[0])
        by_difference = 0.5 * (costs[0] - costs[1]) / (2.0 * size)
        assert gradient[column] == pytest.approx(by_difference, rel=1e-4, abs=1e-3), column


@over_lenses
def test_the_information_is_the_square_of_the_jacobian(lens):
    """A row of J is by how much Jᵀr falls when a pixel is observed 1 px further."""
    stacked, poses, common = draw_bundle(lens, 1, shape=BOWED)
    _, information, gradient = normal_equations(stacked, poses[0], common)
    total = np.zeros_like(information)
    for i in range(len(BOARD)):
        for j in range(2):
            image = stacked.image.copy()
            image[i, j] -= 1.0
            moved = stacked._replace(image=image)
            row = normal_equations(moved, poses[0], common)[2] - gradient
            total += np.outer(row, row)
    size = np.sqrt(np.outer(np.diag(total), np.diag(total)))
    np.testing.assert_allclose(information / size, total / size, atol=1e-8)


@over_lenses
def test_the_squared_error_is_the_squared_reprojection_error(lens):
    stacked, poses, common = draw_bundle(lens, 2, noise_px=0.0, shape=BOWED)
    squares = np.empty(len(stacked.image))
    squared_errors(stacked, poses, common, squares)
    assert squares.max() < 1e-16
    displaced = stacked._replace(image=np.add(stacked.image, (3.0, -4.0)))
    squared_errors(displaced, poses, common, squares)
    np.testing.assert_allclose(squares, 25.0, rtol=1e-9)


def test_eliminating_the_poses_does_not_change_the_step_of_the_common_parameters():
    """Two boards, each seen by two of four views."""
    stacked, poses, common = draw_bundle(LENSES['four terms'], 4, shape=BOWED)
    stacked = stacked._replace(boards=np.array([0, 1, 1, 0]))
    common = np.concatenate([common, 0.5 * BOWED])
    common[:4] += (1.0, 0.5, -0.5, 0.001)
    n, v = len(common), 4
    information = np.diag(np.concatenate([np.full(10, 1e-3), np.full(16, 1e3)]))
    prior = WeightedPrior(common + 0.001, information, np.arange(n) / 10.0)
    work = adjustment_work(v, n)
    fill_blocks(stacked, poses, common, LIMIT, work)
    common_equations(stacked.boards, common, prior, 0.0, work)
    step = np.linalg.solve(work.reduced[:, :n], work.reduced[:, n])
    # The step in all 50 unknowns at once.
    whole, right = np.zeros((6 * v + n, 6 * v + n)), np.zeros(6 * v + n)
    whole[6 * v :, 6 * v :] = information
    right[6 * v :] = prior.gradient - information @ (common - prior.reference)
    for i, (block, board) in enumerate(zip(work.blocks, stacked.boards, strict=True)):
        shape = 6 * v + LENS_SIZE + SHAPE_SIZE * board
        places = np.r_[6 * i : 6 * i + 6, 6 * v : 6 * v + LENS_SIZE, shape : shape + SHAPE_SIZE]
        assert len(places) == 6 + VIEW_COMMON
        whole[np.ix_(places, places)] += block[:RESIDUAL, :RESIDUAL]
        right[places] -= block[:RESIDUAL, RESIDUAL]
    expected = np.linalg.solve(whole, right)[6 * v :]
    np.testing.assert_allclose(step, expected, atol=1e-6 * np.abs(expected).max())
    np.testing.assert_allclose(step, expected, rtol=1e-5)


@compiled_only
@pytest.mark.parametrize('order', [1, 2, 3, 4])
@pytest.mark.parametrize('imperfect', [False, True])
def test_the_adjustment_recovers_lens_and_shape(order, imperfect):
    terms = [-0.33, -0.024, -0.002, -0.0003][:order] + [0.0] * (4 - order)
    imperfections = (0.02, 0.001, -0.002) if imperfect else (0.0, 0.0, 0.0)
    lens = [450.0, 20.0, -10.0, *terms, *imperfections]
    stacked, poses, truth = draw_bundle(lens, 8, noise_px=0.0, shape=BOWED)
    start = truth.copy()
    start[:4] += (20.0, -5.0, 5.0, 0.03)
    start[4 + order - 1 :] = 0.0
    free = FreeTerms(order, imperfect).with_boards(1)
    work = adjustment_work(8, COMMON)
    cost = adjust(stacked, poses, start, free, NO_PRIOR, LIMIT, 50, 1e-15, work)
    assert cost < 1e-10
    np.testing.assert_allclose(start, truth, atol=1e-5)


@compiled_only
def test_no_nearby_lens_shape_and_poses_have_a_lower_cost():
    stacked, poses, common = draw_bundle(LENSES['barrel'], 6)
    work, free = adjustment_work(6, COMMON), FreeTerms(1, imperfect=True).with_boards(1)
    best = adjust(stacked, poses, common, free, NO_PRIOR, LIMIT, 50, 1e-15, work)
    rng = np.random.default_rng(0)
    sizes = np.zeros(COMMON)
    sizes[free] = np.array([0.05] * 3 + [1e-4] * 12)
    for _ in range(20):
        step = rng.normal(0.0, 1e-4, (6, 6))
        nearby_poses = np.array([stepped(pose, s) for pose, s in zip(poses, step, strict=True)])
        nearby = common + rng.normal(0.0, 1.0, COMMON) * sizes
        assert fill_blocks(stacked, nearby_poses, nearby, LIMIT, work) > best


@compiled_only
def test_an_outlier_has_no_influence():
    stacked, poses, truth = draw_bundle(LENSES['barrel'], 6)
    work, free = adjustment_work(6, COMMON), FreeTerms().with_boards(1)
    results = []
    for _ in range(2):
        common, adjusted = truth.copy(), poses.copy()
        adjust(stacked, adjusted, common, free, NO_PRIOR, 4.0, 50, 1e-15, work)
        results.append(common)
        stacked.image[7] += 50.0
    assert np.abs(results[1] - results[0])[:3].max() < 0.5
    squares = np.empty(len(stacked.image))
    squared_errors(stacked, poses, results[1], squares)
    assert squares[7] > 1000.0


def test_a_tight_prior_determines_the_centre_and_the_bow():
    stacked, poses, common = draw_bundle(LENSES['barrel'], 3)
    reference, information = common.copy(), np.zeros((COMMON, COMMON))
    bow = LENS_SIZE + 2
    reference[[1, bow]] += (3.0, 0.02)
    information[1, 1] = information[bow, bow] = 1e12
    tight = WeightedPrior(reference, information, np.zeros(COMMON))
    free = FreeTerms().with_boards(1)
    adjust(stacked, poses, common, free, tight, LIMIT, 50, 1e-12, adjustment_work(3, COMMON))
    np.testing.assert_allclose(common[[1, bow]], reference[[1, bow]], atol=1e-3)


@compiled_only
def test_a_board_that_is_taken_as_flat_keeps_its_shape():
    stacked, poses, common = draw_bundle(LENSES['barrel'], 6, shape=BOWED)
    flat = stacked._replace(basis=np.zeros_like(stacked.basis))
    common[LENS_SIZE:] = 0.0
    prior = NO_PRIOR._replace(information=1e-6 * np.eye(COMMON))
    free = FreeTerms().with_boards(1)
    adjust(flat, poses, common, free, prior, LIMIT, 50, 1e-12, adjustment_work(6, COMMON))
    np.testing.assert_array_equal(common[LENS_SIZE:], 0.0)
