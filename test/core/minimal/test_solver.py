# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""The minimal solver: the truth is among its solutions, and each one is valid."""

import numpy as np
from p4pfr_ros import DivisionCamera, solve_p4pfr, solve_p4pfr_batch
from p4pfr_ros.core.geometry import rotation_angle_rad
from p4pfr_ros.scenes.instances import draw_instances, KINDS
import pytest

# Shares of 10,000 instances, somewhat below the measured ones, which the benchmark prints.
RECALL = dict.fromkeys(KINDS, 0.999) | {'patch, tilt < 3°': 0.995, 'square, tilt < 3°': 0.995}


def errors(drawn, batch):
    """Return the smallest error of focal length and rotation among the solutions, (n,)."""
    with np.errstate(invalid='ignore'):
        focal = np.abs(batch.focal_px / drawn.focal_px[:, None] - 1.0)
        chord = np.linalg.norm(batch.rotation - drawn.rotation[:, None], axis=(-2, -1))
    error = np.maximum(focal, chord / np.sqrt(2.0))
    return np.where(np.isnan(error), np.inf, error).min(axis=1)


def solutions(drawn, batch):
    """Yield image points, board points, camera and pose of every solution."""
    for i, count in enumerate(batch.count):
        for s in range(count):
            camera = DivisionCamera(batch.focal_px[i, s], (0.0, 0.0), batch.k[i, s])
            yield (
                drawn.image_points[i],
                drawn.board_points[i],
                camera,
                (
                    batch.rotation[i, s],
                    batch.translation[i, s],
                ),
            )


@pytest.mark.parametrize('kind', KINDS)
def test_the_truth_is_among_the_solutions(kind, sample):
    drawn = draw_instances(kind, sample(10_000))
    batch = solve_p4pfr_batch(drawn.image_points, drawn.board_points)
    missed = np.sum(errors(drawn, batch) >= 1e-6)
    assert missed <= 1 + (1.0 - RECALL[kind]) * len(drawn)


@pytest.mark.parametrize('kind', KINDS)
def test_every_solution_satisfies_the_equations(kind, sample):
    drawn = draw_instances(kind, sample(300, 10), seed=1)
    batch = solve_p4pfr_batch(drawn.image_points, drawn.board_points)
    assert batch.count.max() <= 6
    for image, board, camera, (rotation, translation) in solutions(drawn, batch):
        np.testing.assert_allclose(rotation.T @ rotation, np.eye(3), atol=1e-12)
        assert np.linalg.det(rotation) > 0.0
        points = board @ rotation[:, :2].T + translation
        assert (np.sum(points * camera.unproject(image), axis=1) > 0.0).all()
        np.testing.assert_allclose(camera.project(points), image, atol=1e-6)


def test_a_batch_has_nan_past_its_count():
    drawn = draw_instances('patch', 20)
    batch = solve_p4pfr_batch(drawn.image_points, drawn.board_points)
    past = np.arange(6) >= batch.count[:, None]
    for numbers in (batch.focal_px, batch.k, batch.rotation, batch.translation):
        assert np.isnan(numbers[past]).all()
        assert np.isfinite(numbers[~past]).all()


def test_the_number_of_workers_does_not_change_the_result():
    drawn = draw_instances('patch', 101)
    serial = solve_p4pfr_batch(drawn.image_points, drawn.board_points)
    parallel = solve_p4pfr_batch(drawn.image_points, drawn.board_points, workers=3)
    np.testing.assert_array_equal(parallel.count, serial.count)
    np.testing.assert_array_equal(parallel.translation, serial.translation)
    with pytest.raises(ValueError, match='workers must be at least 1'):
        solve_p4pfr_batch(drawn.image_points, drawn.board_points, workers=0)


def test_single_and_batch_solver_agree():
    drawn = draw_instances('patch', 20)
    batch = solve_p4pfr_batch(drawn.image_points, drawn.board_points)
    for i in range(20):
        single = solve_p4pfr(drawn.image_points[i], drawn.board_points[i])
        assert len(single) == batch.count[i]
        for s, solution in enumerate(single):
            assert solution.camera.focal_px == batch.focal_px[i, s]
            assert solution.camera.k == pytest.approx(batch.k[i, s], rel=1e-15)
            np.testing.assert_array_equal(
                solution.camera_from_board.translation, batch.translation[i, s]
            )


@pytest.mark.parametrize(('factor', 'shift'), [(1e3, 0.0), (1e-3, 0.0), (1.0, 1000.0)])
def test_the_boards_unit_and_origin_do_not_matter(factor, shift, sample):
    drawn = draw_instances('patch', sample(2_000))
    moved = solve_p4pfr_batch(drawn.image_points, factor * drawn.board_points + shift)
    assert np.mean(errors(drawn, moved) < 1e-6) >= 0.999


def test_the_translation_is_in_the_boards_unit():
    drawn = draw_instances('patch', 1)
    in_mm = solve_p4pfr(drawn.image_points[0], 1e3 * drawn.board_points[0])
    best = min(in_mm, key=lambda s: abs(s.camera.focal_px - drawn.focal_px[0]))
    np.testing.assert_allclose(
        best.camera_from_board.translation, 1e3 * drawn.translation[0], rtol=1e-6
    )


@pytest.mark.parametrize(
    ('image', 'board'),
    [
        ([[0, 0], [0, 0], [0, 0], [0, 0]], [[0, 0], [1, 0], [1, 1], [0, 1]]),
        ([[10, 0], [20, 0], [30, 0], [40, 0]], [[0, 0], [1, 0], [1, 1], [0, 1]]),
        ([[10, 5], [20, 0], [30, 9], [40, 0]], [[0, 0], [1, 0], [2, 0], [3, 0]]),
        ([[10, 5], [20, 0], [30, 9], [40, 0]], [[1, 1], [1, 1], [1, 1], [1, 1]]),
        ([[10, 5], [10, 5], [30, 9], [40, 0]], [[0, 0], [0, 0], [1, 1], [0, 1]]),
        ([[10, 5], [10, 5], [30, 9], [40, 0]], [[0, 0], [1, 0], [1, 1], [0, 1]]),
        # Fronto-parallel, its centre on the axis: all radii are equal.
        ([[-9, -9], [9, -9], [9, 9], [-9, 9]], [[-1, 1], [1, 1], [1, -1], [-1, -1]]),
    ],
)
def test_degenerate_points_have_no_solution(image, board):
    assert solve_p4pfr(image, board) == []


def test_solutions_of_fronto_parallel_views_reproject_the_points(sample):
    # The focal length of such a view is arbitrary, but its points must reproject.
    rng = np.random.default_rng(0)
    n, count = sample(200, 10), 0
    for _ in range(n):
        board = rng.uniform(-0.5, 0.5, (4, 2))
        image = 300.0 * board * [1, -1] + rng.uniform(-200, 200, 2)
        for solution in solve_p4pfr(image, board):
            count += 1
            points = np.column_stack([board, np.zeros(4)])
            reprojected = solution.camera.project(solution.camera_from_board.transform(points))
            np.testing.assert_allclose(reprojected, image, atol=1e-5)
    assert count > n / 2


@pytest.mark.parametrize(
    ('image', 'board', 'message'),
    [
        (np.zeros((3, 2)), np.zeros((4, 2)), r'image_points must have shape \(4, 2\)'),
        (np.zeros((4, 2)), np.zeros((4, 4)), r'board_points must have shape \(4, 2\)'),
        (
            np.zeros((4, 2)),
            np.ones((4, 3)),
            'board_points must lie on the plane Z = 0, got a point with Z = 1',
        ),
        (np.full((4, 2), np.nan), np.zeros((4, 2)), 'image_points must be finite'),
        (np.zeros((4, 2)), np.full((4, 2), np.inf), 'board_points must be finite'),
    ],
)
def test_the_error_for_an_invalid_argument_names_it(image, board, message):
    with pytest.raises(ValueError, match=message):
        solve_p4pfr(image, board)


def test_the_error_for_batches_of_different_lengths_names_the_argument():
    with pytest.raises(ValueError, match=r'board_points must have shape \(5, 4, 2\)'):
        solve_p4pfr_batch(np.zeros((5, 4, 2)), np.zeros((6, 4, 2)))


def test_an_empty_batch_is_empty():
    assert len(solve_p4pfr_batch(np.zeros((0, 4, 2)), np.zeros((0, 4, 2))).count) == 0


def test_integers_and_single_precision_are_accepted():
    drawn = draw_instances('patch', 1, seed=4)
    image = drawn.image_points[0].astype(np.float32)
    exact = solve_p4pfr(image.astype(np.float64), drawn.board_points[0])
    single = solve_p4pfr(image, drawn.board_points[0])
    assert [s.camera for s in single] == [s.camera for s in exact]
    whole = np.rint(image).astype(np.int32)
    assert solve_p4pfr(whole, drawn.board_points[0])
    assert solve_p4pfr(whole, drawn.board_points[0]) == solve_p4pfr(
        whole.astype(np.float64), drawn.board_points[0]
    )
    best = min(exact, key=lambda s: abs(s.camera.focal_px - drawn.focal_px[0]))
    assert rotation_angle_rad(best.camera_from_board.rotation, drawn.rotation[0]) < 1e-3


def test_the_error_for_an_unknown_kind_of_instance_names_it():
    with pytest.raises(ValueError, match=r"kind must be one of .* got 'cube'"):
        draw_instances('cube', 1)
