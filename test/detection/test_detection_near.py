# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""Detection near the last place: the same points, and nothing lost."""

from board_views import BOARDS, CAMERAS, project, seen_from, SIZE
import cv2
import numpy as np
from p4pfr_ros.boards import Marker
from p4pfr_ros.detection import detect
from p4pfr_ros.rendering import render
import pytest

CAMERA = CAMERAS['strong']
REAL_LENS = {'noise_sigma': 2.0, 'blur_sigma_px': 0.7}


def sequence(board, count=8):
    """Yield images of a board that moves and turns, and the true points."""
    for n in range(count):
        pose = seen_from(0.7, (0.1 * n, -0.2), 0.2 * n, (-0.2 + 0.05 * n, 0.1 - 0.02 * n))
        image = render(board, CAMERA, pose, SIZE, seed=n, **REAL_LENS)
        yield image, project(CAMERA, pose, board.points)


@pytest.mark.parametrize('name', ['chessboard', 'charuco', 'marker', 'marker_grid', 'circle_grid'])
def test_a_sequence_gives_the_points_of_its_images_alone(name):
    """Or more: OpenCV's thresholds depend on the size of the image."""
    # The older ArUco interface misses a marker of this board in the smaller image.
    misses = name == 'charuco' and cv2.__version__ < '4.7'
    board, before = BOARDS[name], None
    for image, _ in sequence(board):
        alone, near = detect(image, board), detect(image, board, near=before)
        assert len(alone.ids) >= 4
        assert misses or set(alone.ids.tolist()) <= set(near.ids.tolist())
        common = near.image_points[np.isin(near.ids, alone.ids)]
        there = alone.image_points[np.isin(alone.ids, near.ids)]
        assert len(common) >= 4
        assert np.linalg.norm(common - there, axis=1).max() < 0.05
        before = near


@pytest.mark.parametrize('name', ['chessboard', 'marker'])
def test_a_board_that_jumps_is_found_in_the_next_image(name):
    board = BOARDS[name]
    poses = [seen_from(1.1, (0.2, 0.1), 0.1, offset) for offset in ((-0.4, -0.25), (0.4, 0.25))]
    first, second = (render(board, CAMERA, pose, SIZE, **REAL_LENS) for pose in poses)
    before = detect(first, board)
    after = detect(second, board, near=before)
    truth = project(CAMERA, poses[1], board.points)
    assert len(after.ids) == len(board.points)
    assert np.linalg.norm(after.image_points - truth, axis=1).max() < 0.3
    assert (
        detect(np.full_like(first, 110), board, near=before).reason
        == detect(np.full_like(first, 110), board).reason
    )


def test_only_the_surroundings_of_the_last_place_are_searched():
    """So a second marker with the same id elsewhere does not matter there."""
    board = Marker(id=3, size_m=0.05, dictionary='DICT_APRILTAG_36h11')
    image = render(board, CAMERA, seen_from(0.5, offset=(-0.4, 0.0)), SIZE, **REAL_LENS)
    before = detect(image, board)
    image[:, 320:] = image[:, :320]
    assert len(detect(image, board).ids) == 0
    near = detect(image, board, near=before)
    np.testing.assert_allclose(near.image_points, before.image_points, atol=0.01)


def test_the_window_holds_the_whole_board_even_if_a_part_was_seen():
    """All markers but one are covered, then visible."""
    board, pose = BOARDS['marker_grid'], seen_from(0.9, (0.2, 0.1), 0.1, (0.1, 0.0))
    image = render(board, CAMERA, pose, SIZE, **REAL_LENS)
    covered = np.full_like(image, 110)
    outline = project(
        CAMERA, pose, 1.3 * board.marker_corners[0] - 0.3 * board.marker_corners[0].mean(axis=0)
    )
    mask = cv2.fillConvexPoly(np.zeros_like(image), np.rint(outline).astype(np.int32), 255)
    covered[mask > 0] = image[mask > 0]
    before = detect(covered, board)
    assert len(before.ids) == 4
    assert len(detect(image, board, near=before).ids) == len(board.points)


def test_a_last_place_in_an_image_of_another_size_does_no_harm():
    board = BOARDS['chessboard']
    image, truth = next(sequence(board))
    large = np.pad(image, ((700, 0), (900, 0)), constant_values=110)
    before = detect(large, board)
    assert before.reason == ''
    after = detect(image, board, near=before)
    assert np.linalg.norm(after.image_points - truth, axis=1).max() < 0.3


def test_a_board_that_the_window_cuts_is_searched_in_the_whole_image():
    """A board that came in partly may show as many points in the window, and more beside it."""
    board, images = BOARDS['charuco'], []
    for n in (4, 5):
        offset = 0.42 * np.sin(1.1 * n), 0.25 * np.sin(0.9 * n + 0.5)
        pose = seen_from(0.9, (0.2, 0.1), 0.1 * n, offset)
        images.append(render(board, CAMERA, pose, SIZE, **REAL_LENS, seed=n))
    before, alone = (detect(image, board) for image in images)
    near = detect(images[1], board, near=before)
    assert 4 <= len(before.ids) < len(alone.ids)
    assert set(near.ids.tolist()) == set(alone.ids.tolist())
