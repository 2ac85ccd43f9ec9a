# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""Which chessboards are found: small, large, blurred, bent, covered, several, none."""

from board_views import BOARDS, CAMERAS, CENTER, project, seen_from, SIZE
import cv2
import numpy as np
from p4pfr_ros.boards import Chessboard
from p4pfr_ros.core.cameras.division import DivisionCamera
from p4pfr_ros.detection import detect
from p4pfr_ros.detection.saddle_lattice import find_saddles, lattices
from p4pfr_ros.rendering import render
import pytest

BOARD = BOARDS['chessboard']
REAL_LENS = {'noise_sigma': 2.0, 'blur_sigma_px': 0.7}
PINHOLE = CAMERAS['pinhole']


def assert_detected(image, camera, pose, board=BOARD, at_most_px=0.3):
    """Assert that all corners are where they are."""
    detection = detect(image, board)
    assert detection.reason == ''
    assert len(detection.ids) == len(board.points)
    errors = detection.image_points - project(camera, pose, detection.board_points)
    assert np.linalg.norm(errors, axis=1).max() < at_most_px


@pytest.mark.parametrize('side_px', [4.5, 6.0, 20.0, 55.0])
def test_squares_of_all_sizes_are_found(side_px):
    pose = seen_from(500.0 * BOARD.square_m / side_px, (0.2, -0.1), 0.3)
    assert_detected(render(BOARD, PINHOLE, pose, SIZE, **REAL_LENS), PINHOLE, pose)


def test_few_large_squares_are_found():
    """Neighbours are farther apart than the search at the first size looks."""
    board, pose = Chessboard(columns=3, rows=3, square_m=0.1), seen_from(0.42, (0.1, 0.0), 0.1)
    assert_detected(render(board, PINHOLE, pose, SIZE, **REAL_LENS), PINHOLE, pose, board)


def test_small_squares_in_a_large_image_are_found():
    """At the size of the first search, a square has two pixels."""
    size = (1920, 1440)
    camera = DivisionCamera(1500.0, (959.5, 719.5))
    pose = seen_from(1500.0 * BOARD.square_m / 6.0, (0.1, 0.2), 0.2, (0.2, 0.1))
    assert_detected(render(BOARD, camera, pose, size, **REAL_LENS), camera, pose)


def test_a_strongly_blurred_board_is_found():
    pose = seen_from(0.4, (0.2, 0.1), 0.1)
    image = render(BOARD, PINHOLE, pose, SIZE, noise_sigma=2.0, blur_sigma_px=5.0)
    assert_detected(image, PINHOLE, pose, at_most_px=2.0)


def test_a_board_that_a_wide_lens_bends_is_found():
    """The first guess of two corners at the rim is two pixels off."""
    camera = DivisionCamera(170.0, CENTER, -0.45)
    pose = seen_from(0.1, (0.1, 0.3), 0.1, (-0.5, 0.2))
    assert_detected(render(BOARD, camera, pose, SIZE, **REAL_LENS), camera, pose)


def test_covered_corners_are_left_out():
    pose = seen_from(0.4, (0.3, 0.1), 0.1)
    image = render(BOARD, PINHOLE, pose, SIZE, **REAL_LENS)
    truth = project(PINHOLE, pose, BOARD.points)
    x, y = np.rint(truth[20]).astype(int)
    cv2.circle(image, (int(x), int(y)), 32, 140, -1)
    detection = detect(image, BOARD)
    assert 40 <= len(detection.ids) < 54
    assert 20 not in detection.ids
    assert np.linalg.norm(detection.image_points - truth[detection.ids], axis=1).max() < 0.3


@pytest.mark.parametrize('end', [slice(0, 1), slice(8, 9)], ids=['first', 'last'])
def test_a_board_with_a_hidden_column_is_not_found(end):
    """Else the corners could be those one square farther."""
    pose = seen_from(0.4)
    image = render(BOARD, PINHOLE, pose, SIZE, **REAL_LENS)
    column_px = project(PINHOLE, pose, BOARD.points).reshape(6, 9, 2)[:, end, 0].mean()
    hidden = slice(0, int(column_px) + 8) if end.start == 0 else slice(int(column_px) - 8, None)
    image[:, hidden] = 140
    hint = ': 8x6 inner corners are visible'
    assert detect(image, BOARD).reason == f'no 9x6 chessboard found{hint}'


@pytest.mark.parametrize(('columns', 'rows'), [(10, 6), (9, 7), (8, 6), (6, 8)])
def test_a_board_of_another_size_is_not_found(columns, rows):
    other = Chessboard(columns=columns, rows=rows, square_m=0.022)
    image = render(other, PINHOLE, seen_from(0.4, (0.2, 0.1)), SIZE, **REAL_LENS)
    assert detect(image, other).reason == ''
    assert detect(image, BOARD).reason.startswith('no 9x6 chessboard found: ')


@pytest.mark.parametrize(
    ('columns', 'rows', 'hint'),
    [
        (8, 6, ': 9x6 inner corners are visible'),
        (5, 9, ': 6x9 inner corners are visible'),
        (
            10,
            7,
            ': 9x6 inner corners are visible (columns and rows count inner corners, not squares)',
        ),
        (7, 5, ': 9x6 inner corners are visible'),
    ],
)
def test_the_size_that_is_visible_instead_is_named(columns, rows, hint):
    """So for a board file that has only a part of the board, or counts its squares."""
    image = render(BOARD, PINHOLE, seen_from(0.45, (0.2, 0.1), 0.1), SIZE, **REAL_LENS)
    given = Chessboard(columns=columns, rows=rows, square_m=0.025)
    assert detect(image, given).reason == f'no {columns}x{rows} chessboard found{hint}'


@pytest.mark.parametrize('scale', [1, 3])
def test_the_lattice_that_is_visible_instead_is_outlined(scale):
    """Along its outer corners, also where it was found in an image of half the size."""
    size, middle = (640 * scale, 480 * scale), (320.0 * scale - 0.5, 240.0 * scale - 0.5)
    camera = DivisionCamera(500.0 * scale, middle, -0.3)
    pose = seen_from(0.45, (0.2, 0.1), 0.1)
    image = render(BOARD, camera, pose, size, **REAL_LENS)
    detection = detect(image, Chessboard(columns=10, rows=7, square_m=0.025))
    [outline] = [each.outline for each in detection.rejected if 'inner corners' in each.reason]
    grid = project(camera, pose, BOARD.points).reshape(6, 9, 2)
    outer = np.concatenate([np.rot90(grid, turns)[0, :-1] for turns in range(4)])
    distance_px = np.linalg.norm(outline[:, None] - outer, axis=2)
    assert len(outline) == len(outer) == 26
    assert distance_px.min(axis=0).max() < 2.0 * scale
    # Its points follow each other around the board.
    order = distance_px.argmin(axis=1)
    assert set(np.diff(order) % 26) in ({1}, {25})


def test_clutter_is_no_board_of_another_size():
    noise = np.random.default_rng(1).integers(0, 256, (480, 640), dtype=np.uint8)
    assert detect(noise, BOARD).reason == 'no 9x6 chessboard found'


def test_of_two_boards_the_larger_one_is_meant():
    pose = seen_from(0.45, offset=(-0.25, 0.0))
    image = render(BOARD, PINHOLE, pose, SIZE, **REAL_LENS)
    small = render(BOARD, PINHOLE, seen_from(0.9), SIZE, **REAL_LENS)[180:300, 230:410]
    image[340:460, 440:620] = small
    assert_detected(image, PINHOLE, pose)
    twice = np.hstack([small, np.full((120, 17), 60, np.uint8), small])
    reason = '2 9x6 chessboards found, of about the same size'
    detection = detect(twice, BOARD)
    assert detection.reason == reason
    assert len(detection.rejected) == 2


def test_saddles_lie_on_the_corners_with_their_edges_near_the_lines():
    pose = seen_from(0.4, (0.3, -0.2), 0.4)
    grid = project(PINHOLE, pose, BOARD.points).reshape(6, 9, 2)
    saddles = find_saddles(render(BOARD, PINHOLE, pose, SIZE, **REAL_LENS), 200)
    ((members, cells),) = lattices(saddles, 40)
    found = saddles[members]
    assert len(members) == 54
    assert sorted((cells.max(axis=0) + 1).tolist()) == [6, 9]
    distance = np.linalg.norm(found[:, None, :2] - grid.reshape(-1, 2), axis=2)
    assert distance.min(axis=1).max() < 0.5
    nearest = distance.argmin(axis=1)
    along = np.gradient(grid, axis=1).reshape(-1, 2)[nearest]
    along /= np.linalg.norm(along, axis=1, keepdims=True)
    sine = found[:, 2] * along[:, 1] - found[:, 3] * along[:, 0]
    either = np.minimum(np.abs(sine), np.sqrt(1.0 - sine**2))
    assert either.max() < np.sin(np.radians(20.0))


def test_no_more_saddles_than_asked_for():
    noise = np.random.default_rng(2).integers(0, 256, (200, 300), dtype=np.uint8)
    assert len(find_saddles(noise, 10_000)) > 300
    strongest = find_saddles(noise, 50)
    assert 30 < len(strongest) <= 50
    assert not lattices(strongest[:0], 4)
