# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""Partly visible bundles, and several boards in one image."""

from board_views import BOARDS, CAMERAS, CENTER, project, seen_from, SIZE
import numpy as np
from p4pfr_ros import estimate_pose
from p4pfr_ros.boards import Marker
from p4pfr_ros.core.cameras.division import DivisionCamera
from p4pfr_ros.core.geometry import rotation_angle_rad
from p4pfr_ros.detection import detect
from p4pfr_ros.files.boards import load_boards
from p4pfr_ros.rendering import render
import pytest

REAL_LENS = {'noise_sigma': 2.0, 'blur_sigma_px': 0.7}
BUNDLE = BOARDS['bundle']

FILE = """
boards:
  shelf: {type: marker_grid, columns: 3, rows: 2, marker_mm: 40, separation_mm: 10,
          dictionary: DICT_4X4_50, first_id: 10}
  crate:
    type: bundle
    dictionary: DICT_4X4_50
    markers:
      - {id: 4, x_mm: 0, y_mm: 30, size_mm: 60, angle_deg: 45}
      - {id: 2, x_mm: 50, y_mm: -40, size_mm: 45}
  wall: {type: chessboard, columns: 6, rows: 5, square_mm: 20}
"""


def cover(image, camera, pose, corners):
    """Paint over the area around some corners (N, 2) of the board."""
    (left, top), (right, bottom) = (
        np.rint(edge(project(camera, pose, corners), axis=0)).astype(int)
        for edge in (np.min, np.max)
    )
    image[top - 3 : bottom + 4, left - 3 : right + 4] = 128


def test_a_bundle_is_detected_by_any_of_its_markers():
    camera, pose = CAMERAS['strong'], seen_from(0.4, (0.3, -0.2))
    image = render(BUNDLE, camera, pose, SIZE, **REAL_LENS)
    for index in (0, 2, 3):
        cover(image, camera, pose, BUNDLE.marker_corners[index])
        detection = detect(image, BUNDLE)
        assert index not in detection.ids // 4
        truth = project(camera, pose, BUNDLE.points[detection.ids])
        np.testing.assert_array_equal(detection.board_points, BUNDLE.points[detection.ids])
        assert np.linalg.norm(detection.image_points - truth, axis=1).max() < 0.3
    np.testing.assert_array_equal(detection.ids, [4, 5, 6, 7])
    cover(image, camera, pose, BUNDLE.marker_corners[1])
    assert detect(image, BUNDLE).reason == 'none of the 4 markers of board found'


def test_a_marker_with_another_id_does_not_belong_to_the_bundle():
    camera, pose = CAMERAS['pinhole'], seen_from(0.5)
    other = Marker(id=6, size_m=0.1, dictionary=BUNDLE.dictionary)
    assert detect(render(other, camera, pose, SIZE), BUNDLE).reason.startswith('none of the 4')
    member = Marker(id=586, size_m=0.1, dictionary=BUNDLE.dictionary)
    np.testing.assert_array_equal(
        detect(render(member, camera, pose, SIZE), BUNDLE).ids, [12, 13, 14, 15]
    )


def test_each_board_in_an_image_is_detected_with_its_own_pose(tmp_path):
    """Two of the boards share a dictionary."""
    path = tmp_path / 'boards.yaml'
    path.write_text(FILE)
    boards = load_boards(path)
    camera = DivisionCamera(520.0, CENTER, -0.25)
    poses = {
        'shelf': seen_from(0.5, (0.5, 0.2), 0.1, (-0.28, -0.2)),
        'crate': seen_from(0.55, (-0.3, 0.5), 0.4, (0.28, -0.18)),
        'wall': seen_from(0.5, (0.4, -0.4), 0.0, (0.02, 0.25)),
    }
    image = np.full(SIZE[::-1], 110.0)
    for name, board in boards.items():
        image = render(board, camera, poses[name], SIZE, background=image.astype(float))
    for name, board in boards.items():
        detection = detect(image, board)
        assert len(detection.ids) == len(board.points)
        truth = project(camera, poses[name], board.points)
        assert np.linalg.norm(detection.image_points - truth, axis=1).max() < 0.3
        estimate = estimate_pose(detection.image_points, detection.board_points, camera=camera)
        pose = estimate.model.camera_from_board
        assert rotation_angle_rad(pose.rotation, poses[name].rotation) < 0.02
        assert pose.translation == pytest.approx(poses[name].translation, abs=2e-3)
