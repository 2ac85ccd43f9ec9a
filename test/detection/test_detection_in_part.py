# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""Boards of which a part is seen, or believed."""

from board_views import BOARDS, CAMERAS, project, seen_from, SIZE
import numpy as np
from p4pfr_ros.boards import Marker
from p4pfr_ros.detection import detect
from p4pfr_ros.rendering import render

REAL_LENS = {'noise_sigma': 2.0, 'blur_sigma_px': 0.7}


def test_a_part_of_a_charuco_board_is_enough():
    board, camera, pose = BOARDS['charuco'], CAMERAS['wide'], seen_from(0.07, (0.4, 0.3))
    found = detect(render(board, camera, pose, SIZE, **REAL_LENS), board)
    truth = project(camera, pose, found.board_points)
    assert 18 < len(found.ids) < 24
    assert np.linalg.norm(found.image_points - truth, axis=1).max() < 0.1
    assert np.all(np.diff(found.ids) > 0)


def test_too_few_points_for_a_pose_are_none_with_a_reason():
    """All but the left part of a ChArUco board is covered."""
    board, camera, pose = BOARDS['charuco'], CAMERAS['pinhole'], seen_from(0.5)
    picture = render(board, camera, pose, SIZE)
    corners = project(camera, pose, board.points).reshape(4, 6, 2)
    picture[:, round(corners[0, 1, 0]) - 5 :] = 220
    assert len(detect(picture, board).ids) == 4
    picture[round(corners[2, 0, 1]) + 5 :] = 220
    found = detect(picture, board)
    assert found.reason == "only 3 of the board's points found, 4 are needed"
    assert len(found.image_points) == len(found.board_points) == len(found.ids) == 0


def test_of_a_marker_seen_twice_neither_is_taken():
    marker, camera = Marker(id=3, size_m=0.1, dictionary='DICT_6X6_250'), CAMERAS['pinhole']
    half = render(marker, camera, seen_from(0.6), SIZE)[:, 160:480]
    twice = np.hstack([half, half])
    assert detect(half, marker).reason == ''
    assert detect(twice, marker).reason == 'marker 3 is seen more than once: which one is meant?'
    # On a grid the other markers remain.
    grid, pose = BOARDS['marker_grid'], seen_from(0.4)
    picture = render(grid, camera, pose, SIZE)
    x, y = np.rint(project(camera, pose, grid.marker_corners[3]).mean(axis=0)).astype(int)
    picture[0:90, 0:90] = 220
    picture[5:85, 5:85] = picture[y - 40 : y + 40, x - 40 : x + 40]
    found = detect(picture, grid)
    assert sorted(set(found.ids // 4)) == [0, 1, 2, 4, 5, 6, 7, 8, 9, 10, 11]
