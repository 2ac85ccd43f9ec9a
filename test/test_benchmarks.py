# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""The benchmarks measure what they claim: a wrong solver gives a wrong result."""

import dataclasses

from benchmarks import accuracy, all_roots, distances, published, standard_normal
import numpy as np
from p4pfr_ros.core.jit import COMPILED
from p4pfr_ros.core.minimal.solution import H

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
