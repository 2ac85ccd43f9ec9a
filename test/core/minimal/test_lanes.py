# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""A block of problems has the solutions of the kernel of one problem, to the last bit."""

import numpy as np
from p4pfr_ros import solve_p4pfr, solve_p4pfr_batch
from p4pfr_ros.core.minimal.block import BLOCK, block_work, padded, put_sample
from p4pfr_ros.core.minimal.four import points_of
from p4pfr_ros.core.minimal.lanes import solve_block
from p4pfr_ros.core.minimal.one import solve_minimal, workspace
from p4pfr_ros.core.minimal.solution import MAX_SOLUTIONS, ROW_SIZE
from p4pfr_ros.scenes.instances import draw_instances, KINDS
import pytest

SQUARE = np.array([[-0.5, 0.5], [0.5, 0.5], [0.5, -0.5], [-0.5, -0.5]])


def assert_equal_to_single(image, board):
    """Compare a batch with one call of each problem, bit by bit."""
    batch = solve_p4pfr_batch(image, board)
    for i in range(len(image)):
        single = solve_p4pfr(image[i], board[i])
        assert len(single) == batch.count[i]
        for s, solution in enumerate(single):
            pose = solution.camera_from_board
            assert solution.camera.focal_px == batch.focal_px[i, s]
            assert solution.camera.k == batch.k[i, s]
            assert (pose.rotation == batch.rotation[i, s]).all()
            assert (pose.translation == batch.translation[i, s]).all()


@pytest.mark.parametrize('kind', KINDS)
def test_each_kind_of_instances(kind, sample):
    drawn = draw_instances(kind, sample(1000, 20), seed=5)
    assert_equal_to_single(drawn.image_points, drawn.board_points)


@pytest.mark.parametrize('n', [1, 7, 8, 9, BLOCK, BLOCK + 1])
def test_blocks_that_are_not_full(n, sample):
    drawn = draw_instances('patch', min(n, sample(n, 9)), seed=n)
    assert_equal_to_single(drawn.image_points, drawn.board_points)


def test_problems_without_a_cone_beside_others(sample):
    # Random points: a third has a cone, and the others leave gaps in the lanes.
    rng = np.random.default_rng(3)
    n = sample(3000, 40)
    assert_equal_to_single(rng.normal(0, 300, (n, 4, 2)), rng.normal(0, 1, (n, 4, 2)))


def test_problems_left_to_the_kernel_of_one_problem(sample):
    # A square on the axis: the sextic of the first vanishes everywhere (turned about the diagonal)
    # and that of the second has a root at τ = 1/2; a point without a number of its own.
    good = draw_instances('square', sample(30, 9), seed=1)
    image, board = good.image_points.copy(), good.board_points.copy()
    image[2] = 300.0 * SQUARE * [1, -1] / (1.0 + 0.3 * (SQUARE @ [1, 1]))[:, None]
    image[4] = 300.0 * SQUARE * [1, -1] / (1.0 + 0.3 * SQUARE[:, :1])
    image[6] = 0.0
    board[2] = board[4] = SQUARE
    assert_equal_to_single(image, board)


def test_without_a_bound_on_k(sample):
    drawn = draw_instances('patch', sample(BLOCK, 8), seed=8)
    block, n = block_work(), len(drawn)
    rows = np.full((BLOCK, MAX_SOLUTIONS, ROW_SIZE), np.nan)
    count = np.zeros(BLOCK, dtype=np.int64)
    for at in range(padded(n)):
        i = min(at, n - 1)
        put_sample(points_of(drawn.image_points[i]), points_of(drawn.board_points[i]), at, block)
    solve_block(n, np.inf, rows, count, block)
    one, room = np.empty((MAX_SOLUTIONS, ROW_SIZE)), workspace()
    for i in range(n):
        image, board = points_of(drawn.image_points[i]), points_of(drawn.board_points[i])
        solved = solve_minimal(image, board, np.inf, one, room)
        assert solved == count[i]
        np.testing.assert_array_equal(one[:solved], rows[i, :solved])
