# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""Derivatives against central differences, and the error against the camera's own projection."""

import numpy as np
from p4pfr_ros import DivisionCamera, Pose
from p4pfr_ros.core.geometry import TRANSLATION
from p4pfr_ros.core.linalg import rotate
from p4pfr_ros.core.minimal.solution import G, H, ROW_SIZE
from p4pfr_ros.core.one_view.free_camera import Gates
from p4pfr_ros.core.one_view.least_squares import (
    free_problem,
    known_problem,
    linearise,
    POSE_AND_CAMERA,
    squared_errors,
)
import pytest

GATES = Gates(800.0, 0.0, 3.0, 2.0)
CENTER_PX = np.array([639.5, 479.5])
CAMERAS = {
    'pinhole': DivisionCamera(700.0, tuple(CENTER_PX)),
    'barrel': DivisionCamera(700.0, tuple(CENTER_PX), -0.3),
    'pincushion': DivisionCamera(700.0, tuple(CENTER_PX), 0.1),
    'nearly none': DivisionCamera(700.0, tuple(CENTER_PX), -1e-13),
    'behind its image plane': DivisionCamera(300.0, tuple(CENTER_PX), -0.6),
}


def scene(camera, distance=0.7):
    """Return image points with errors up to 3 px, board points, and the true row."""
    pose = Pose.from_rotation_vector([2.5, 0.4, -0.3], [0.3, -0.2, distance])
    board = np.random.default_rng(0).uniform(-0.5, 0.5, (12, 2))
    projected = camera.project(pose.transform(np.column_stack([board, np.zeros(12)])))
    image = projected + np.random.default_rng(1).uniform(-3.0, 3.0, projected.shape) - CENTER_PX
    row = np.empty(ROW_SIZE)
    row[:TRANSLATION] = pose.rotation.ravel()
    row[TRANSLATION:G] = pose.translation
    row[G], row[H] = camera.focal_px, camera.k / camera.focal_px
    return image, board, row


def stepped(row, column, step):
    """Return a row after a step in one unknown, as the optimiser takes it."""
    out = row.copy()
    if column < 3:
        turn = np.zeros(3)
        turn[column] = step
        rotate(row, *turn, out)
    else:
        out[TRANSLATION + column - 3] += step
    return out


def residual(row, problem, i):
    """Return the (2,) residual."""
    jacobian = np.empty((2, POSE_AND_CAMERA + 1))
    linearise(row, problem, i, jacobian)
    return jacobian[:, 8].copy()


@pytest.mark.parametrize('name', CAMERAS)
@pytest.mark.parametrize('known', [False, True], ids=['free', 'known'])
def test_the_jacobian_is_the_derivative_of_the_residual(name, known):
    camera = CAMERAS[name]
    # At that distance the wide lens sees points behind its image plane.
    image, board, row = scene(camera, distance=0.15 if camera.k < -0.5 else 0.7)
    problem = (
        known_problem(image, board, GATES, camera) if known else free_problem(image, board, GATES)
    )
    for i in range(len(image)):
        jacobian = np.empty((2, POSE_AND_CAMERA + 1))
        linearise(row, problem, i, jacobian)
        for column in range(6 if known else 8):
            size = 1.0 if column < 6 else abs(row[G]) if column == 6 else 1.0 / row[G]
            step = 1e-6 * size
            difference = (
                residual(stepped(row, column, step), problem, i)
                - residual(stepped(row, column, -step), problem, i)
            ) / (2.0 * step)
            scale = max(1.0, np.abs(difference).max())
            np.testing.assert_allclose(jacobian[:, column], difference, atol=2e-6 * scale)


def squares_of(row, problem):
    """Return the squared errors of all points, px²."""
    squares = np.empty(len(problem.image))
    squared_errors(row, problem, 0, len(squares), squares)
    return squares


@pytest.mark.parametrize('name', CAMERAS)
def test_the_squared_error_is_that_of_the_cameras_projection(name):
    camera = CAMERAS[name]
    image, board, row = scene(camera, distance=0.15 if camera.k < -0.5 else 0.7)
    pose = Pose(row[:TRANSLATION].reshape(3, 3), row[TRANSLATION:G])
    projected = camera.project(pose.transform(np.column_stack([board, np.zeros(12)])))
    expected = np.sum((projected - image - CENTER_PX) ** 2, axis=1)
    free = free_problem(image, board, GATES)
    errors = squares_of(row, free)
    np.testing.assert_allclose(errors, expected, rtol=1e-9)
    # A known camera's error is a first-order approximation, within percents at 3 px.
    known = known_problem(image, board, GATES, camera)
    errors = squares_of(row, known)
    np.testing.assert_allclose(np.sqrt(errors), np.sqrt(expected), rtol=0.05)


def test_a_point_behind_the_camera_has_an_infinite_error():
    image, board, row = scene(CAMERAS['pinhole'])
    row[TRANSLATION + 2] = -5.0
    camera = CAMERAS['pinhole']
    for problem in (free_problem(image, board, GATES), known_problem(image, board, GATES, camera)):
        assert squares_of(row, problem)[0] == np.inf
        assert np.isnan(residual(row, problem, 0)).all()
