# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""Boards that are partly visible, or have ambiguous markers."""

from board_views import BOARDS, CAMERAS, project, seen_from, SIZE
import numpy as np
from p4pfr_ros.boards import Marker
from p4pfr_ros.detection import detect
from p4pfr_ros.rendering import render

REAL_LENS = {'noise_sigma': 2.0, 'blur_sigma_px': 0.7}


def test_a_part_of_a_charuco_board_is_enough():
    board, camera, pose = BOARDS['charuco'], CAMERAS['wide'], seen_from(0.07, (0.4, 0.3))
    detection = detect(render(board, camera, pose, SIZE, **REAL_LENS), board)
    truth = project(camera, pose, detection.board_points)
    assert 18 < len(detection.ids) < 24
    assert np.linalg.norm(detection.image_points - truth, axis=1).max() < 0.1
    assert np.all(np.diff(detection.ids) > 0)


def test_too_few_points_for_a_pose_are_rejected_with_a_reason():
    """Only the left part of a ChArUco board is visible."""
    board, camera, pose = BOARDS['charuco'], CAMERAS['pinhole'], seen_from(0.5)
    image = render(board, camera, pose, SIZE)
    corners = project(camera, pose, board.points).reshape(4, 6, 2)
    image[:, round(corners[0, 1, 0]) - 5 :] = 220
    assert len(detect(image, board).ids) == 4
    image[round(corners[2, 0, 1]) + 5 :] = 220
    detection = detect(image, board)
    assert detection.reason == 'only 2 points of the board found, at least 4 needed'
    assert len(detection.image_points) == len(detection.board_points) == len(detection.ids) == 0


def test_markers_with_a_duplicate_id_are_left_out():
    marker, camera = Marker(id=3, size_m=0.1, dictionary='DICT_6X6_250'), CAMERAS['pinhole']
    half = render(marker, camera, seen_from(0.6), SIZE)[:, 160:480]
    twice = np.hstack([half, half])
    assert detect(half, marker).reason == ''
    assert detect(twice, marker).reason.startswith('marker 3 detected more than once: two equal')
    # On a grid, the other markers are still detected.
    grid, pose = BOARDS['marker_grid'], seen_from(0.4)
    image = render(grid, camera, pose, SIZE)
    x, y = np.rint(project(camera, pose, grid.marker_corners[3]).mean(axis=0)).astype(int)
    image[0:90, 0:90] = 220
    image[5:85, 5:85] = image[y - 40 : y + 40, x - 40 : x + 40]
    detection = detect(image, grid)
    assert sorted(set(detection.ids // 4)) == [0, 1, 2, 4, 5, 6, 7, 8, 9, 10, 11]
