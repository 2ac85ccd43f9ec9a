# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

import itertools

import numpy as np
from p4pfr_ros.boards import Chessboard, Marker
from p4pfr_ros.core.cameras.division import DivisionCamera
from p4pfr_ros.scenes.board_path import FILL, SimulatedPath, TILT_DEG
import pytest

BOARD = Chessboard(columns=9, rows=6, square_m=0.025)
TAG = Marker(id=3, size_m=0.1, dictionary='DICT_4X4_50')
CAMERAS = [
    (DivisionCamera(520.0, (319.5, 239.5), -0.25), (640, 480)),
    (DivisionCamera(300.0, (319.5, 239.5), -0.3), (640, 480)),
    (DivisionCamera(2000.0, (639.5, 359.5), 0.1), (1280, 720)),
    (DivisionCamera(520.0, (319.5, 239.5), 0.1), (640, 480)),
]


@pytest.mark.parametrize('board', [BOARD, TAG], ids=['board', 'tag'])
@pytest.mark.parametrize(('camera', 'size'), CAMERAS, ids=['normal', 'wide', 'tele', 'pincushion'])
def test_the_board_is_always_inside_the_image_with_tilt_and_size_in_range(camera, size, board):
    corners = 0.5 * np.array([[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]], dtype=float)
    share = np.linspace(0.0, 1.0, 20)[:, None, None]
    edges = (share * corners + (1.0 - share) * np.roll(corners, 1, axis=0)).reshape(-1, 3)
    sheet = edges * [*board.sheet_size_m, 1.0]
    tilts_deg = []
    for seed in range(3):
        path = SimulatedPath(board, size, seed)
        for time_s in np.arange(0.0, 60.0, 0.7):
            pose = path.at(time_s, camera)
            pixels = camera.project(pose.transform(sheet))
            assert (pixels >= 0.0).all()
            assert (pixels <= np.array(size) - 1.0).all()
            fill = (np.ptp(pixels, axis=0) / size).max()
            assert FILL[0] - 0.02 <= fill <= FILL[1] + 0.02
            tilts_deg.append(np.degrees(np.arccos(-pose.rotation[2, 2])))
            # The printed side faces the camera.
            assert pose.rotation[:, 2] @ pose.translation < 0.0
    assert TILT_DEG[0] <= min(tilts_deg) < max(tilts_deg) <= TILT_DEG[1]
    assert max(tilts_deg) - min(tilts_deg) > 25.0


def test_the_path_is_smooth():
    camera, size = CAMERAS[0]
    path = SimulatedPath(BOARD, size, 0)
    poses = [path.at(time_s, camera) for time_s in np.arange(0.0, 20.0, 1 / 30)]
    steps = [np.linalg.norm(b.translation - a.translation) for a, b in itertools.pairwise(poses)]
    assert 0.0 < max(steps) < 0.02


def test_the_seed_determines_the_path():
    camera, size = CAMERAS[0]
    first, again, other = (
        SimulatedPath(BOARD, size, seed).at(3.0, camera).translation for seed in (0, 0, 1)
    )
    np.testing.assert_array_equal(first, again)
    assert np.linalg.norm(other - first) > 0.01
