# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""Circle grids: images of the centres, not middles of the images; frames; covered circles."""

import dataclasses

from board_views import BOARDS, CAMERAS, project, seen_from, SIZE
import cv2
import numpy as np
from p4pfr_ros.boards import CircleGrid
from p4pfr_ros.detection import detect
from p4pfr_ros.rendering import render
import pytest

REAL_LENS = {'noise_sigma': 2.0, 'blur_sigma_px': 0.7}
ASYMMETRIC, SYMMETRIC = BOARDS['circle_grid'], BOARDS['symmetric_circles']
# Circles so large that the middle of the image of a circle is far from that of its centre.
CLUSTERING = cv2.CALIB_CB_SYMMETRIC_GRID | cv2.CALIB_CB_CLUSTERING
LARGE = CircleGrid(columns=5, rows=4, spacing_m=0.05, diameter_m=0.038)


@pytest.mark.parametrize('camera', CAMERAS.values(), ids=list(CAMERAS))
def test_the_centres_are_corrected_for_perspective_and_lens(camera):
    """OpenCV's middles are tenths of a pixel off; what remains is noise, in all directions."""
    pose = seen_from(0.45 * camera.focal_px / 500.0, (0.6, -0.3), 0.2, (0.1, -0.05))
    image = render(LARGE, camera, pose, SIZE, **REAL_LENS)
    truth = project(camera, pose, LARGE.points)
    found, middles = cv2.findCirclesGrid(image, (5, 4), flags=CLUSTERING)
    assert found
    off_px = np.linalg.norm(middles.reshape(-1, 1, 2) - truth, axis=2).min(axis=0)
    detection = detect(image, LARGE)
    errors_px = np.linalg.norm(detection.image_points - truth[detection.ids], axis=1)
    assert len(detection.ids) == len(LARGE.points)
    assert errors_px.max() < 0.05
    assert np.median(errors_px) < 0.1 * np.median(off_px)


@pytest.mark.parametrize('roll_deg', range(0, 360, 60))
def test_an_asymmetric_grid_with_odd_rows_has_one_frame(roll_deg):
    assert not ASYMMETRIC.turns
    pose = seen_from(0.45, (0.3, 0.2), np.radians(roll_deg))
    detection = detect(render(ASYMMETRIC, CAMERAS['strong'], pose, SIZE, **REAL_LENS), ASYMMETRIC)
    truth = project(CAMERAS['strong'], pose, ASYMMETRIC.points[detection.ids])
    assert len(detection.ids) == len(ASYMMETRIC.points)
    assert np.abs(detection.image_points - truth).max() < 0.1


@pytest.mark.parametrize(
    'board',
    [
        SYMMETRIC,
        dataclasses.replace(SYMMETRIC, columns=5),
        dataclasses.replace(ASYMMETRIC, rows=8),
    ],
    ids=['7x5', '5x5', 'asymmetric_4x8'],
)
@pytest.mark.parametrize('roll_deg', [0, 100, 200, 290])
def test_other_grids_are_found_in_one_of_their_turns(board, roll_deg):
    """The one whose y axis points up most."""
    pose = seen_from(0.45, (0.3, 0.2), np.radians(roll_deg))
    camera = CAMERAS['strong']
    detection = detect(render(board, camera, pose, SIZE, **REAL_LENS), board)
    assert len(detection.ids) == len(board.points)
    poses = [pose, *(pose @ turn for turn in board.turns)]
    errors = [
        np.abs(project(camera, each, board.points[detection.ids]) - detection.image_points).max()
        for each in poses
    ]
    assert min(errors) < 0.1
    up = [each.rotation[1, 1] for each in poses]  # of the board's y axis, image y down
    assert up[int(np.argmin(errors))] == min(up)


def test_the_correction_does_not_depend_on_the_window_of_the_search():
    """The lens is that of the whole image, also where only a part of it is searched."""
    camera, pose = CAMERAS['wide'], seen_from(0.3, (0.6, -0.3), 0.2, (0.5, -0.3))
    image = render(LARGE, camera, pose, SIZE, **REAL_LENS)
    truth = project(camera, pose, LARGE.points)
    whole = detect(image, LARGE)
    near = detect(image, LARGE, near=whole)
    assert len(near.ids) == len(LARGE.points)
    assert np.abs(near.image_points - truth).max() < 0.06
    np.testing.assert_allclose(near.image_points, whole.image_points, atol=0.01)


def test_covered_circles_are_left_out():
    """A circle half covered by something dark has another centroid."""
    camera, pose = CAMERAS['pinhole'], seen_from(0.45, (0.3, 0.2))
    image = render(SYMMETRIC, camera, pose, SIZE, **REAL_LENS)
    truth = project(camera, pose, SYMMETRIC.points)
    x, y = np.rint(truth[16]).astype(int)
    image[y - 2 : y + 30, x - 4 : x + 5] = 25
    detection = detect(image, SYMMETRIC)
    errors_px = np.linalg.norm(detection.image_points - truth[detection.ids], axis=1)
    assert 16 not in detection.ids
    assert errors_px.max(initial=0.0) < 0.1


def test_an_image_without_a_grid_gives_a_reason():
    image = render(BOARDS['chessboard'], CAMERAS['pinhole'], seen_from(0.4), SIZE)
    assert detect(image, ASYMMETRIC).reason.startswith('no grid of 4x9 circles found among')
    circles = render(SYMMETRIC, CAMERAS['pinhole'], seen_from(0.4), SIZE)
    other = detect(circles, ASYMMETRIC)
    hint = ': 5x7 circles are visible, in a symmetric grid'
    assert other.reason == f'no grid of 4x9 circles found among 35 dark circles{hint}'
    assert len(other.rejected) == 35
    assert detect(np.full((480, 640), 128, np.uint8), SYMMETRIC).reason.startswith('no grid of')
