# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

import os
from pathlib import Path

from board_views import BOARDS, CAMERAS, distance_m, project, seen_from, SIZE
import cv2
import numpy as np
from p4pfr_ros.boards import Charuco, Chessboard, Marker
from p4pfr_ros.core.cameras.division import DivisionCamera
from p4pfr_ros.detection import detect
from p4pfr_ros.detection.chessboard import as_printed, is_smooth
from p4pfr_ros.rendering import render
import pytest

NAMES = list(BOARDS)
every_board = pytest.mark.parametrize('board', BOARDS.values(), ids=NAMES)
every_camera = pytest.mark.parametrize('camera', CAMERAS.values(), ids=list(CAMERAS))
VIEWS = [((0.0, 0.0), 0.1), ((0.5, -0.2), -0.3), ((-0.3, 0.6), 0.4), ((0.2, 0.5), 1.5)]
REAL_LENS = {'noise_sigma': 2.0, 'blur_sigma_px': 0.7}


def errors_px(board, camera, options):
    """Return how far from the truth (N, 2) the points are that are found in all views."""
    errors = []
    for seed, (tilt_rad, roll_rad) in enumerate(VIEWS):
        pose = seen_from(distance_m(camera), tilt_rad, roll_rad, (0.05, -0.03))
        found = detect(render(board, camera, pose, SIZE, seed=seed, **options), board)
        assert found.reason == ''
        np.testing.assert_array_equal(found.ids, np.arange(len(board.points)))
        np.testing.assert_array_equal(found.board_points, board.points)
        errors.append(found.image_points - project(camera, pose, board.points))
    return np.concatenate(errors)


@every_board
@every_camera
def test_points_are_where_the_camera_sees_them(board, camera):
    for options in ({}, REAL_LENS):
        errors = errors_px(board, camera, options)
        assert np.abs(errors.mean(axis=0)).max() < 0.02
        # An edge without blur says little of where it is within a pixel, and a marker has few.
        assert np.linalg.norm(errors, axis=1).mean() < (0.03 if options else 0.07)
        assert np.linalg.norm(errors, axis=1).max() < 0.3


@pytest.mark.parametrize('roll_deg', range(0, 360, 45))
def test_a_chessboards_frame_is_the_same_however_it_is_turned(roll_deg):
    board, camera = BOARDS['chessboard'], CAMERAS['strong']
    pose = seen_from(0.45, (0.3, 0.2), np.radians(roll_deg))
    found = detect(render(board, camera, pose, SIZE, **REAL_LENS), board)
    errors = found.image_points - project(camera, pose, found.board_points)
    assert len(found.ids) == 54
    assert np.abs(errors).max() < 0.1


@pytest.mark.parametrize(('columns', 'rows'), [(7, 5), (6, 6), (5, 5)])
@pytest.mark.parametrize('roll_deg', [0, 60, 120, 180, 240, 300])
def test_a_symmetric_chessboards_y_axis_points_up(columns, rows, roll_deg):
    board, camera = Chessboard(columns=columns, rows=rows, square_m=0.03), CAMERAS['pinhole']
    pose = seen_from(0.5, (0.2, 0.1), np.radians(roll_deg))
    found = detect(render(board, camera, pose, SIZE, **REAL_LENS), board)
    grid = found.image_points.reshape(rows, columns, 2)
    down, along = grid[-1, 0] - grid[0, 0], grid[0, -1] - grid[0, 0]
    assert down[1] > 0.0
    assert along[0] * down[1] - along[1] * down[0] > 0.0  # no mirror image
    # In another frame of the same board, the points are still points of the board.
    truth = project(camera, pose, board.points)
    nearest = np.linalg.norm(found.image_points[:, None] - truth, axis=2).min(axis=1)
    assert nearest.max() < 0.1


def test_a_board_in_other_colours_is_found_all_the_same():
    """Both ends of this one are white: it is none of ours, but its corners are."""
    board = Chessboard(columns=7, rows=5, square_m=0.03)
    picture = render(
        board, CAMERAS['pinhole'], seen_from(0.5), SIZE, black=220.0, white=25.0, background=25.0
    )
    picture[picture == 25] = 25
    found = detect(cv2.bitwise_not(picture), board)
    assert len(found.ids) == 35


def test_a_covered_corner_is_left_out():
    board, camera, pose = BOARDS['charuco'], CAMERAS['strong'], seen_from(0.4, (0.3, 0.1))
    picture = render(board, camera, pose, SIZE, **REAL_LENS)
    truth = project(camera, pose, board.points)
    x, y = np.rint(truth[8]).astype(int)
    picture[y - 14 : y + 15, x - 14 : x + 15] = 130
    found = detect(picture, board)
    assert 8 not in found.ids.tolist()
    assert len(found.ids) >= 20
    assert np.abs(found.image_points - truth[found.ids]).max() < 0.1


def test_what_covers_a_corner_is_no_corner_however_lively():
    board, camera, pose = BOARDS['charuco'], CAMERAS['strong'], seen_from(0.4, (0.3, 0.1))
    picture = render(board, camera, pose, SIZE, **REAL_LENS)
    x, y = np.rint(project(camera, pose, board.points)[8]).astype(int)
    texture = np.random.default_rng(1).integers(0, 256, (25, 25), dtype=np.uint8)
    picture[y - 12 : y + 13, x - 12 : x + 13] = texture
    assert sorted(detect(picture, board).ids) == [i for i in range(24) if i != 8]


def test_a_mirror_image_of_the_corners_is_turned_back():
    board, camera, pose = BOARDS['chessboard'], CAMERAS['strong'], seen_from(0.4, (0.3, 0.1), 0.2)
    picture = render(board, camera, pose, SIZE)
    truth = project(camera, pose, board.points).reshape(6, 9, 2)
    for grid in (truth, truth[::-1, ::-1], truth[:, ::-1], truth[::-1]):
        np.testing.assert_array_equal(as_printed(picture, grid), truth)


@pytest.mark.parametrize('camera', CAMERAS.values(), ids=list(CAMERAS))
def test_one_wrong_corner_shows_in_the_grid(camera):
    pose = seen_from(distance_m(camera), (0.5, 0.6))
    grid = project(camera, pose, BOARDS['chessboard'].points).reshape(6, 9, 2)
    assert is_smooth(grid)
    for row, column in ((0, 0), (2, 4), (5, 8)):
        wrong = grid.copy()
        wrong[row, column] += 0.9 * (grid[3, 4] - grid[2, 4])
        assert not is_smooth(wrong)


def test_a_strongly_distorted_charuco_board_in_the_corner_loses_no_point():
    """With k r² = -0.3 at the image's corner, where the board is."""
    corner2 = (319.5**2 + 239.5**2) / 420.0**2
    camera = DivisionCamera(420.0, (319.5, 239.5), -0.3 / corner2)
    pose = seen_from(0.4, (-0.3, 0.5), 0.1, (0.55, 0.4))
    board = BOARDS['charuco']
    truth = project(camera, pose, board.points)
    printed = project(camera, pose, board.marker_corners.reshape(-1, 2))
    assert 625 < printed[:, 0].max() < 635
    assert 460 < printed[:, 1].max() < 475
    found = detect(render(board, camera, pose, SIZE, **REAL_LENS), board)
    np.testing.assert_array_equal(found.ids, np.arange(24))
    assert np.linalg.norm(found.image_points - truth, axis=1).mean() < 0.05


def test_small_markers_are_found_to_a_fraction_of_a_pixel():
    """Some twenty pixels wide: a cell has three."""
    board, camera = BOARDS['marker_grid'], CAMERAS['strong']
    pose = seen_from(1.1, (0.4, 0.2))
    found = detect(render(board, camera, pose, SIZE, **REAL_LENS), board)
    errors = found.image_points - project(camera, pose, found.board_points)
    assert len(found.ids) >= 40
    assert np.linalg.norm(errors, axis=1).mean() < 0.25


def test_markers_of_no_board_are_ignored():
    board, camera, pose = BOARDS['marker_grid'], CAMERAS['pinhole'], seen_from(0.4)
    picture = render(board, camera, pose, SIZE, **REAL_LENS)
    only = Marker(id=5, size_m=0.05, dictionary=board.dictionary)
    found = detect(picture, only)
    np.testing.assert_array_equal(found.ids, np.arange(4))
    truth = project(camera, pose, board.marker_corners[5])
    assert np.linalg.norm(found.image_points - truth, axis=1).max() < 0.3
    absent = detect(picture, Marker(id=12, size_m=0.05, dictionary=board.dictionary))
    assert absent.reason == 'no marker 12 of DICT_6X6_250 found'


def test_colour_and_grey_pictures_are_alike():
    board, pose = BOARDS['chessboard'], seen_from(0.45)
    grey = render(board, CAMERAS['strong'], pose, SIZE, **REAL_LENS)
    colour = detect(np.dstack([grey, grey, grey]), board)
    np.testing.assert_array_equal(colour.image_points, detect(grey, board).image_points)
    strided = np.repeat(grey, 2, axis=1)[:, ::2]
    np.testing.assert_array_equal(colour.image_points, detect(strided, board).image_points)


@every_board
@pytest.mark.parametrize('shape', [(0, 0), (3, 4), (16, 16), (20, 900), (240, 320)], ids=str)
def test_pictures_without_a_board_give_a_reason(board, shape):
    rng = np.random.default_rng(7)
    pictures = [
        np.zeros(shape, np.uint8),
        np.full((*shape, 3), 255, np.uint8),
        rng.integers(0, 256, shape, dtype=np.uint8),
        (np.indices(shape).sum(axis=0) // 4 % 2 * 255).astype(np.uint8),
    ]
    for picture in pictures:
        found = detect(picture, board)
        assert found.image_points.shape == found.board_points.shape == (0, 2)
        assert found.ids.shape == (0,)
        expected = 'the picture is too small' if min(shape) < 16 else ('no ', 'none of ')
        assert found.reason.startswith(expected)


@pytest.mark.parametrize(
    'picture',
    [
        np.zeros((100, 100)),
        np.zeros((100, 100), np.uint16),
        np.zeros((100, 100, 4), np.uint8),
        np.zeros(100, np.uint8),
        [[0, 0], [0, 0]],
    ],
    ids=['float', 'uint16', 'rgba', 'line', 'list'],
)
def test_other_arrays_are_refused(picture):
    with pytest.raises(ValueError, match=r'image must be \(h, w\) or \(h, w, 3\) of uint8, got'):
        detect(picture, BOARDS['chessboard'])


def test_a_board_that_opencv_cannot_know_is_refused():
    board = Charuco(columns=3, rows=3, square_m=1, marker_m=0.5, dictionary='DICT_NONE')
    with pytest.raises(ValueError, match="dictionary: expected one of OpenCV's"):
        detect(np.zeros((100, 100), np.uint8), board)


@pytest.mark.skipif('P4PFR_DATA' not in os.environ, reason='P4PFR_DATA is not set')
def test_photographs_calibrate_better_than_with_opencvs_own_corners():
    """All 13 whole, in one frame; OpenCV's corners (11x11 cornerSubPix) leave 0.183 px."""
    board = BOARDS['chessboard']
    paths = sorted(Path(os.environ['P4PFR_DATA']).glob('left*.jpg'))
    views = [detect(cv2.imread(str(path)), board) for path in paths]
    assert [len(view.ids) for view in views] == [54] * 13
    on_board = [np.pad(v.board_points, ((0, 0), (0, 1))).astype(np.float32) for v in views]
    in_picture = [v.image_points.astype(np.float32) for v in views]
    rms, _, _, rotations, _ = cv2.calibrateCamera(on_board, in_picture, SIZE, None, None)
    assert rms < 0.17
    for rotation in rotations:
        assert cv2.Rodrigues(rotation)[0][2, 2] < 0.0  # z out of the board, towards the camera
