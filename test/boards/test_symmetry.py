# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""Boards that look the same after a turn: the turns by rendering, and the turned poses."""

from dataclasses import replace

from board_views import BOARDS
import numpy as np
from p4pfr_ros import detect, DivisionCamera, estimate_pose, Pose
from p4pfr_ros.boards import Chessboard
from p4pfr_ros.boards.symmetry import NO_TURN, symmetry_note, turn_about_z, with_turned_poses
from p4pfr_ros.core.geometry import rotation_angle_rad
from p4pfr_ros.rendering import render
import pytest

CAMERA = DivisionCamera(500.0, (319.5, 239.5), -0.1)
SIZE = (640, 480)
HEAD_ON = Pose(np.diag([1.0, -1.0, -1.0]), [0.01, -0.02, 0.6])
TILTED = HEAD_ON @ Pose.from_rotation_vector([0.4, 0.2, 0.1], np.zeros(3))
GRIDS = [(columns, rows) for columns in range(3, 9) for rows in range(3, 9)]


def chessboard(columns, rows):
    return Chessboard(columns=columns, rows=rows, square_m=0.03)


def image_of(board, pose):
    return render(board, CAMERA, pose, SIZE, noise_sigma=0.0).astype(float)


@pytest.mark.parametrize('angle', [90, 180, 270])
@pytest.mark.parametrize(
    'board',
    [*(chessboard(*grid) for grid in GRIDS), *BOARDS.values()],
    ids=[*(f'{columns}x{rows}' for columns, rows in GRIDS), *BOARDS],
)
def test_the_turns_of_a_board_are_those_that_leave_its_image_as_it_is(board, angle):
    turn = turn_about_z(angle)
    difference = np.abs(image_of(board, TILTED @ turn) - image_of(board, TILTED)).max()
    is_same = difference < 3.0
    assert is_same == any(np.array_equal(turn.matrix, each.matrix) for each in board.turns)
    assert is_same or difference > 50.0


@pytest.mark.parametrize('board', [chessboard(7, 5), chessboard(6, 6)], ids=['7x5', '6x6'])
@pytest.mark.parametrize('roll_deg', [0.0, 100.0, 170.0, 250.0])
def test_one_of_the_poses_of_a_view_is_the_true_one(board, roll_deg):
    roll = Pose.from_rotation_vector([0.0, 0.0, np.radians(roll_deg)], np.zeros(3))
    true = TILTED @ roll
    detection = detect(render(board, CAMERA, true, SIZE), board)
    points = detection.image_points, detection.board_points
    before = estimate_pose(*points, camera=CAMERA)
    estimate, turn = with_turned_poses(before, board.turns)
    assert turn is NO_TURN
    assert estimate.model == before.model
    assert len(estimate.alternatives) == len(board.turns) + len(before.alternatives) * (
        len(board.turns) + 1
    )
    solutions = [estimate.model, *estimate.alternatives]
    angles = [
        np.degrees(rotation_angle_rad(s.camera_from_board.rotation, true.rotation))
        for s in solutions
    ]
    assert min(angles) < 1.0
    # With a recent pose the true one is the answer, and the others are the alternatives.
    nearby = Pose.from_rotation_vector([0.1, -0.2, 0.4], np.zeros(3))
    chosen, turn = with_turned_poses(before, board.turns, true @ nearby)
    assert rotation_angle_rad(chosen.model.camera_from_board.rotation, true.rotation) < 0.02
    # The turned points have the same pixels in the turned pose.
    in_board = turn.inverse().transform(np.pad(points[1], ((0, 0), (0, 1))))
    projected = CAMERA.project(chosen.model.camera_from_board.transform(in_board))
    assert np.sqrt(np.mean(np.sum((projected - points[0]) ** 2, axis=1))) < 0.3
    np.testing.assert_array_equal(chosen.covariance, before.covariance)


def test_the_covariance_is_that_of_the_turned_points():
    """The estimate from the turned points has the turned pose and the same covariance."""
    board = chessboard(7, 5)
    noise = np.random.default_rng(0).normal(0.0, 0.2, board.points.shape)
    pixels = CAMERA.project(TILTED.transform(np.pad(board.points, ((0, 0), (0, 1))))) + noise
    direct = estimate_pose(pixels, -board.points, camera=CAMERA)
    estimate = estimate_pose(pixels, board.points, camera=CAMERA)
    [turned] = with_turned_poses(replace(estimate, alternatives=()), board.turns)[0].alternatives
    np.testing.assert_allclose(
        turned.camera_from_board.matrix, direct.model.camera_from_board.matrix, atol=1e-9
    )
    np.testing.assert_allclose(estimate.covariance, direct.covariance, rtol=1e-5, atol=1e-12)


def test_without_turns_or_model_an_estimate_stays_as_it_is():
    good = estimate_pose(
        CAMERA.project(TILTED.transform(np.pad(chessboard(9, 6).points, ((0, 0), (0, 1))))),
        chessboard(9, 6).points,
        camera=CAMERA,
    )
    assert with_turned_poses(good, (), TILTED)[0] is good
    none = replace(good, model=None)
    assert with_turned_poses(none, chessboard(7, 5).turns)[0] is none


def test_the_note_names_the_turns():
    assert symmetry_note('wall', ()) == ''
    assert 'turn of 180 degrees, so each view has 2 poses' in symmetry_note(
        'wall', chessboard(7, 5).turns
    )
    assert 'turn of 90, 180, 270 degrees' in symmetry_note('wall', chessboard(6, 6).turns)
