# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""The benchmarks measure what they claim: a wrong solver gives a wrong result."""

import dataclasses

from benchmarks import (
    accuracy,
    all_roots,
    calibration_orders,
    calibration_real,
    distances,
    published,
    standard_normal,
)
from benchmarks.calibration_methods import Fit
from benchmarks.corner_sets import CornerSet, CornerView
import numpy as np
from p4pfr_ros import CalibrationState, DivisionCamera
from p4pfr_ros.core.jit import COMPILED
from p4pfr_ros.core.minimal.solution import H
from p4pfr_ros.scenes.camera_views import board_grid, draw_camera_view
from p4pfr_ros.scenes.instances import IMAGE_SIZE
import pytest

N = 2_000 if COMPILED else 100


def solved():
    return standard_normal.solve(*standard_normal.draw(N, 1))


def test_published_classes_are_measured():
    assert set(published.RECALL) <= set(accuracy.CLASSES)


def test_recall_is_of_ground_truth_and_of_nothing_else():
    patch = accuracy.CLASSES['patch']
    measured = accuracy.measure(patch, N)
    assert measured.to_1e6 >= 0.99 * N
    assert measured.valid
    drawn = patch.draw(N, 0)
    batch = accuracy.solve_p4pfr_batch(drawn.image_points, drawn.board_points)
    wrong = dataclasses.replace(drawn, focal_px=1.001 * drawn.focal_px)
    assert (accuracy.errors(wrong, batch) > 1e-6).all()


def test_accuracies_are_combined():
    one = accuracy.Accuracy(10, 9, 10, 20, 1e-15, 0, 1e-9, 1, 0)
    two = accuracy.Accuracy(5, 5, 5, 8, 2e-15, 1, 1e-10, 0, 0)
    assert one + two == accuracy.Accuracy(15, 14, 15, 28, 2e-15, 1, 1e-9, 1, 0)
    assert one.valid
    assert not (one + two).valid


def test_residuals_are_small_and_detect_a_wrong_camera():
    right = solved()
    wrong = dataclasses.replace(right, rows=right.rows.copy())
    wrong.rows[:, H] *= 1.0 + 1e-6
    for residual in (distances.undistorted, distances.in_image):
        assert np.median(residual(right)) < 1e-13
        assert np.median(residual(wrong)) > 1e-9
    assert np.median(distances.paper(right, nearest_horizon=True)) < 1e-14


def test_all_roots_with_positive_depths_are_solutions():
    counts = all_roots.count(*standard_normal.draw(N, 1))
    assert abs(counts.depths_of_one_sign - len(solved().rows)) <= 0.01 * len(solved().rows)
    assert counts.depths_of_one_sign < counts.z_of_one_sign < counts.real


def test_poses_alone_leave_the_noise_and_the_error_of_the_camera():
    rng = np.random.default_rng(0)
    camera = DivisionCamera(800.0, (650.0, 470.0), -0.2)
    noise_px, count = 0.3, 8
    board = board_grid(9, 6)
    drawn = [draw_camera_view(rng, camera, board, noise_px=noise_px) for _ in range(count)]
    views = tuple(CornerView(view.image_points, np.arange(len(board))) for view in drawn)
    corners = CornerSet('synthetic', IMAGE_SIZE, board, views)
    poses = [view.camera_from_board for view in drawn]
    # Some way from the minimum, where the search should end all the same.
    start = 0.02 + np.array([[*pose.rotation_vector, *pose.translation] for pose in poses])
    squares = {}
    for name, project in {
        'right': camera.project,
        'wrong': dataclasses.replace(camera, k=-0.1).project,
    }.items():
        shape = np.pad(board, ((0, 0), (0, 1)))
        fit = Fit(project, shape, (800.0, 800.0), camera.center_px, 0.0)
        squares[name] = calibration_real.squared_distances(
            fit, corners, np.arange(count), start
        ).sum()
    # 108 coordinates a view, six of which the pose takes.
    degrees_of_freedom = count * (2 * len(board) - 6)
    assert squares['right'] == pytest.approx(degrees_of_freedom * noise_px**2, rel=0.15)
    assert squares['wrong'] > 3.0 * squares['right']


def test_a_camera_that_is_lost_is_counted():
    done, before = CalibrationState.CALIBRATED, CalibrationState.CONVERGING
    states = [before, done, before, done, done]
    cameras = [None, 'one', None, 'two', 'two', 'two']
    run = calibration_orders.Run(None, states, [], cameras, [], [])
    assert run.lost_calibrated == 1
    assert run.lost_cameras == 1
    assert run.first_calibrated == 1
