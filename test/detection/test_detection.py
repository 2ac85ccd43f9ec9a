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
from p4pfr_ros.detection.chessboard import is_smooth, order_as_printed
from p4pfr_ros.rendering import render
import pytest

NAMES = list(BOARDS)
every_board = pytest.mark.parametrize('board', BOARDS.values(), ids=NAMES)
every_camera = pytest.mark.parametrize('camera', CAMERAS.values(), ids=list(CAMERAS))
VIEWS = [((0.0, 0.0), 0.1), ((0.5, -0.2), -0.3), ((-0.3, 0.6), 0.4), ((0.2, 0.5), 1.5)]
REAL_LENS = {'noise_sigma': 2.0, 'blur_sigma_px': 0.7}


def errors_px(board, camera, options):
    """Return the errors (N, 2) of the points detected in all views."""
    errors = []
    for seed, (tilt_rad, roll_rad) in enumerate(VIEWS):
        pose = seen_from(distance_m(camera), tilt_rad, roll_rad, (0.05, -0.03))
        detection = detect(render(board, camera, pose, SIZE, seed=seed, **options), board)
        assert detection.reason == ''
        np.testing.assert_array_equal(detection.ids, np.arange(len(board.points)))
        np.testing.assert_array_equal(detection.board_points, board.points)
        errors.append(detection.image_points - project(camera, pose, board.points))
    return np.concatenate(errors)


@every_board
@every_camera
def test_points_match_their_projections(board, camera):
    if board == BOARDS['aprilgrid'] and camera == CAMERAS['wide'] and cv2.__version__ < '4.7':
        pytest.skip('OpenCV 4.6 misses so many of these tags that one is not predicted')
    for options in ({}, REAL_LENS):
        errors = errors_px(board, camera, options)
        assert np.abs(errors.mean(axis=0)).max() < 0.02
        # Without blur, an edge carries little information on its position within a pixel, and a
        # marker has few edges.
        assert np.linalg.norm(errors, axis=1).mean() < (0.03 if options else 0.07)
        assert np.linalg.norm(errors, axis=1).max() < 0.3


@pytest.mark.parametrize('roll_deg', range(0, 360, 45))
def test_a_chessboards_frame_is_the_same_at_any_roll(roll_deg):
    board, camera = BOARDS['chessboard'], CAMERAS['strong']
    pose = seen_from(0.45, (0.3, 0.2), np.radians(roll_deg))
    detection = detect(render(board, camera, pose, SIZE, **REAL_LENS), board)
    errors = detection.image_points - project(camera, pose, detection.board_points)
    assert len(detection.ids) == 54
    assert np.abs(errors).max() < 0.1


@pytest.mark.parametrize(('columns', 'rows'), [(7, 5), (6, 6), (5, 5)])
@pytest.mark.parametrize('roll_deg', [0, 60, 120, 180, 240, 300])
def test_a_symmetric_chessboards_y_axis_points_up(columns, rows, roll_deg):
    board, camera = Chessboard(columns=columns, rows=rows, square_m=0.03), CAMERAS['pinhole']
    pose = seen_from(0.5, (0.2, 0.1), np.radians(roll_deg))
    detection = detect(render(board, camera, pose, SIZE, **REAL_LENS), board)
    grid = detection.image_points.reshape(rows, columns, 2)
    down, along = grid[-1, 0] - grid[0, 0], grid[0, -1] - grid[0, 0]
    assert down[1] > 0.0
    assert along[0] * down[1] - along[1] * down[0] > 0.0  # not mirrored
    # The frame may be another of the symmetric board, but the points are the board's.
    truth = project(camera, pose, board.points)
    nearest = np.linalg.norm(detection.image_points[:, None] - truth, axis=2).min(axis=1)
    assert nearest.max() < 0.1


def test_a_board_with_inverted_colours_is_detected():
    """Both ends of this board are white: we never print it, but its corners are valid."""
    board = Chessboard(columns=7, rows=5, square_m=0.03)
    image = render(
        board, CAMERAS['pinhole'], seen_from(0.5), SIZE, black=220.0, white=25.0, background=25.0
    )
    image[image == 25] = 25
    detection = detect(cv2.bitwise_not(image), board)
    assert len(detection.ids) == 35


def test_a_covered_corner_is_left_out():
    board, camera, pose = BOARDS['charuco'], CAMERAS['strong'], seen_from(0.4, (0.3, 0.1))
    image = render(board, camera, pose, SIZE, **REAL_LENS)
    truth = project(camera, pose, board.points)
    x, y = np.rint(truth[8]).astype(int)
    image[y - 14 : y + 15, x - 14 : x + 15] = 130
    detection = detect(image, board)
    assert 8 not in detection.ids.tolist()
    assert len(detection.ids) >= 20
    assert np.abs(detection.image_points - truth[detection.ids]).max() < 0.1


def test_texture_over_a_corner_is_not_a_corner():
    board, camera, pose = BOARDS['charuco'], CAMERAS['strong'], seen_from(0.4, (0.3, 0.1))
    image = render(board, camera, pose, SIZE, **REAL_LENS)
    x, y = np.rint(project(camera, pose, board.points)[8]).astype(int)
    texture = np.random.default_rng(1).integers(0, 256, (25, 25), dtype=np.uint8)
    image[y - 12 : y + 13, x - 12 : x + 13] = texture
    assert sorted(detect(image, board).ids) == [i for i in range(24) if i != 8]


def test_mirrored_corners_are_reordered():
    board, camera, pose = BOARDS['chessboard'], CAMERAS['strong'], seen_from(0.4, (0.3, 0.1), 0.2)
    image = render(board, camera, pose, SIZE)
    truth = project(camera, pose, board.points).reshape(6, 9, 2)
    for grid in (truth, truth[::-1, ::-1], truth[:, ::-1], truth[::-1]):
        np.testing.assert_array_equal(order_as_printed(image, grid), truth)


@pytest.mark.parametrize('camera', CAMERAS.values(), ids=list(CAMERAS))
def test_a_misplaced_corner_makes_the_grid_not_smooth(camera):
    pose = seen_from(distance_m(camera), (0.5, 0.6))
    grid = project(camera, pose, BOARDS['chessboard'].points).reshape(6, 9, 2)
    assert is_smooth(grid)
    for row, column in ((0, 0), (2, 4), (5, 8)):
        wrong = grid.copy()
        wrong[row, column] += 0.9 * (grid[3, 4] - grid[2, 4])
        assert not is_smooth(wrong)


def test_all_points_of_a_distorted_charuco_board_at_the_image_corner_are_detected():
    """With k r² = -0.3 at the image corner, where the board is."""
    corner2 = (319.5**2 + 239.5**2) / 420.0**2
    camera = DivisionCamera(420.0, (319.5, 239.5), -0.3 / corner2)
    pose = seen_from(0.4, (-0.3, 0.5), 0.1, (0.55, 0.4))
    board = BOARDS['charuco']
    truth = project(camera, pose, board.points)
    printed = project(camera, pose, board.marker_corners.reshape(-1, 2))
    assert 625 < printed[:, 0].max() < 635
    assert 460 < printed[:, 1].max() < 475
    detection = detect(render(board, camera, pose, SIZE, **REAL_LENS), board)
    np.testing.assert_array_equal(detection.ids, np.arange(24))
    assert np.linalg.norm(detection.image_points - truth, axis=1).mean() < 0.05


def test_small_markers_are_detected_to_a_fraction_of_a_pixel():
    """Markers of twenty pixels: three pixels per cell."""
    board, camera = BOARDS['marker_grid'], CAMERAS['strong']
    pose = seen_from(1.1, (0.4, 0.2))
    detection = detect(render(board, camera, pose, SIZE, **REAL_LENS), board)
    errors = detection.image_points - project(camera, pose, detection.board_points)
    assert len(detection.ids) >= 40
    assert np.linalg.norm(errors, axis=1).mean() < 0.25


def test_markers_of_other_boards_are_ignored():
    board, camera, pose = BOARDS['marker_grid'], CAMERAS['pinhole'], seen_from(0.4)
    image = render(board, camera, pose, SIZE, **REAL_LENS)
    only = Marker(id=5, size_m=0.05, dictionary=board.dictionary)
    detection = detect(image, only)
    np.testing.assert_array_equal(detection.ids, np.arange(4))
    truth = project(camera, pose, board.marker_corners[5])
    assert np.linalg.norm(detection.image_points - truth, axis=1).max() < 0.3
    absent = detect(image, Marker(id=12, size_m=0.05, dictionary=board.dictionary))
    assert absent.reason.startswith('no marker 12 of DICT_6X6_250 found, but marker ')


def test_colour_and_grey_images_give_the_same_points():
    board, pose = BOARDS['chessboard'], seen_from(0.45)
    grey = render(board, CAMERAS['strong'], pose, SIZE, **REAL_LENS)
    colour = detect(np.dstack([grey, grey, grey]), board)
    np.testing.assert_array_equal(colour.image_points, detect(grey, board).image_points)
    strided = np.repeat(grey, 2, axis=1)[:, ::2]
    np.testing.assert_array_equal(colour.image_points, detect(strided, board).image_points)


@every_board
@pytest.mark.parametrize('shape', [(0, 0), (3, 4), (16, 16), (20, 900), (240, 320)], ids=str)
def test_images_without_a_board_give_a_reason(board, shape):
    rng = np.random.default_rng(7)
    images = [
        np.zeros(shape, np.uint8),
        np.full((*shape, 3), 255, np.uint8),
        rng.integers(0, 256, shape, dtype=np.uint8),
        (np.indices(shape).sum(axis=0) // 4 % 2 * 255).astype(np.uint8),
    ]
    for image in images:
        detection = detect(image, board)
        assert detection.image_points.shape == detection.board_points.shape == (0, 2)
        assert detection.ids.shape == (0,)
        expected = 'image too small: ' if min(shape) < 16 else ('no ', 'none of ')
        assert detection.reason.startswith(expected)


@pytest.mark.parametrize(
    'image',
    [
        np.zeros((100, 100)),
        np.zeros((100, 100), np.uint16),
        np.zeros((100, 100, 4), np.uint8),
        np.zeros(100, np.uint8),
        [[0, 0], [0, 0]],
    ],
    ids=['float', 'uint16', 'rgba', 'line', 'list'],
)
def test_other_arrays_are_rejected(image):
    with pytest.raises(ValueError, match=r'image must be \(h, w\) or \(h, w, 3\) of uint8, got'):
        detect(image, BOARDS['chessboard'])


def test_a_board_with_an_unknown_dictionary_is_rejected():
    board = Charuco(columns=3, rows=3, square_m=1, marker_m=0.5, dictionary='DICT_NONE')
    with pytest.raises(ValueError, match='dictionary: expected a dictionary of OpenCV'):
        detect(np.zeros((100, 100), np.uint8), board)


@pytest.mark.skipif('P4PFR_DATA' not in os.environ, reason='P4PFR_DATA is not set')
def test_photographs_calibrate_better_than_with_corners_of_opencv():
    """All corners of all 13 are detected; OpenCV's (11x11 cornerSubPix) have 0.183 px rms."""
    board = BOARDS['chessboard']
    paths = sorted(Path(os.environ['P4PFR_DATA']).glob('left*.jpg'))
    views = [detect(cv2.imread(str(path)), board) for path in paths]
    assert [len(view.ids) for view in views] == [54] * 13
    on_board = [np.pad(v.board_points, ((0, 0), (0, 1))).astype(np.float32) for v in views]
    in_image = [v.image_points.astype(np.float32) for v in views]
    rms, _, _, rotations, _ = cv2.calibrateCamera(on_board, in_image, SIZE, None, None)
    assert rms < 0.17
    for rotation in rotations:
        assert cv2.Rodrigues(rotation)[0][2, 2] < 0.0  # z out of the board, towards the camera


@pytest.mark.parametrize('width', [640, 1280, 3840])
def test_markers_of_sixteen_pixels_are_found_in_images_of_all_sizes(width):
    """OpenCV's own limit is a share of the image."""
    size = (width, width * 9 // 16)
    camera = DivisionCamera(float(width), (0.5 * (size[0] - 1), 0.5 * (size[1] - 1)))
    for dictionary in ('DICT_APRILTAG_36h11', 'DICT_4X4_50'):
        marker = Marker(id=3, size_m=0.1, dictionary=dictionary)
        pose = seen_from(width * marker.size_m / 16.0, (0.2, 0.1), 0.3, (0.2, 0.1))
        image = render(marker, camera, pose, size, noise_sigma=2.0, blur_sigma_px=0.5)
        detection = detect(image, marker)
        truth = project(camera, pose, marker.points)
        assert len(detection.ids) == 4
        assert np.linalg.norm(detection.image_points - truth, axis=1).max() < 0.6
        assert detect(image, marker, min_marker_px=40.0).reason.startswith('no marker')
