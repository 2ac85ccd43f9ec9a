# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

import re
import struct
import zlib

from board_views import BOARDS, CAMERAS, CENTER, distance_m, project, seen_from, SIZE
import cv2
import numpy as np
from p4pfr_ros.boards import Marker
from p4pfr_ros.core.cameras.division import DivisionCamera
from p4pfr_ros.core.minimal.solution import Solution
from p4pfr_ros.detection import detect
from p4pfr_ros.files.images import read_image
from p4pfr_ros.files.yaml_fields import ConfigError
from p4pfr_ros.rendering import render
from p4pfr_ros.rendering.pattern import black_quads
from p4pfr_ros.rendering.printing import describe, print_board
from p4pfr_ros.report.drawing import annotate, straighten, straightened_camera
import pytest

BOARD, CAMERA, POSE = BOARDS['charuco'], CAMERAS['strong'], seen_from(0.4, (0.3, 0.2), 0.2)
PICTURE = render(BOARD, CAMERA, POSE, SIZE)
every_camera = pytest.mark.parametrize('camera', CAMERAS.values(), ids=list(CAMERAS))


def near(drawn, picture, points, radius_px=3):
    """Say whether each of the points (N, 2) has something drawn near to it."""
    changed = (drawn != picture[..., None]).any(axis=2).astype(np.uint8)
    reach = cv2.dilate(changed, np.ones((2 * radius_px + 1,) * 2, np.uint8))
    x, y = np.rint(points).astype(int).T
    return reach[y, x].astype(bool)


def test_corners_are_circled():
    found = detect(PICTURE, BOARD)
    drawn = annotate(PICTURE, found)
    assert drawn.shape == (480, 640, 3)
    assert near(drawn, PICTURE, found.image_points, 4).all()
    # A circle, and nothing elsewhere.
    assert (drawn != PICTURE[..., None]).any(axis=2).sum() < 80 * len(found.ids)


def test_the_outline_bends_as_the_lens_bends_it():
    found = detect(PICTURE, BOARD)
    drawn = annotate(PICTURE, found, Solution(CAMERA, POSE), BOARD)
    x, y = 0.5 * np.array(BOARD.sheet_size_m)
    upper = np.linspace((-x, y), (x, y), 60)
    assert near(drawn, PICTURE, project(CAMERA, POSE, upper), 1).all()
    chord = np.linspace(*project(CAMERA, POSE, upper[[0, -1]]), 60)
    assert not near(drawn, PICTURE, chord[25:35], 1).any()


def test_axes_are_red_green_and_blue():
    drawn = annotate(PICTURE, detect(PICTURE, BOARD), Solution(CAMERA, POSE), BOARD).astype(int)
    length = 0.2 * min(BOARD.sheet_size_m)
    tips = CAMERA.project(POSE.transform(length * np.eye(3)))
    for (x, y), strongest in zip(np.rint(tips).astype(int), (2, 1, 0), strict=True):
        assert np.argmax(drawn[y, x]) == strongest
        assert np.ptp(drawn[y, x]) > 100


def test_a_reason_is_written_and_the_picture_is_not_touched():
    blank = np.full((480, 640, 3), 90, np.uint8)
    drawn = annotate(blank, detect(blank, BOARD))
    assert (blank == 90).all()
    assert drawn[:30].max() > 200  # letters, on a bar that is darker than the picture
    assert drawn[:30].min() < 30
    assert (drawn[40:] == 90).all()


def test_a_board_around_the_camera_is_drawn_as_far_as_it_is_seen():
    wide = Solution(CAMERAS['pinhole'], seen_from(0.05, (1.4, 0.0)))
    drawn = annotate(PICTURE, detect(PICTURE, BOARD), wide, BOARD)
    assert drawn.shape == (480, 640, 3)


@every_camera
def test_straight_lines_of_the_board_are_straight_in_the_straightened_picture(camera):
    board = BOARDS['chessboard']
    pose = seen_from(distance_m(camera), (0.3, 0.2))
    picture = render(board, camera, pose, SIZE, blur_sigma_px=0.7)
    pinhole = straightened_camera(camera, SIZE)
    found = detect(straighten(picture, camera), board)
    assert (pinhole.k, pinhole.center_px) == (0.0, CENTER)
    assert len(found.ids) == 54
    errors = found.image_points - project(pinhole, pose, found.board_points)
    assert np.abs(errors.mean(axis=0)).max() < 0.03
    assert np.linalg.norm(errors, axis=1).mean() < 0.1


@pytest.mark.parametrize('name', ['pinhole', 'strong'])
def test_the_straightened_picture_keeps_all_that_was_seen(name):
    pinhole = straightened_camera(CAMERAS[name], SIZE)
    border = [[0, 240], [639, 240], [320, 0], [320, 479], [0, 0], [639, 479]]
    seen = pinhole.project(CAMERAS[name].unproject(border))
    assert (seen > -0.01).all()
    assert (seen < [639.01, 479.01]).all()
    # And no more of nothing than that needs.
    assert np.abs(seen[4]).min() < 0.01


def test_a_lens_that_sees_behind_itself_is_bounded():
    camera = DivisionCamera(150.0, CENTER, -0.4)
    assert camera.unproject((0.0, 0.0))[2] < 0.0
    pinhole = straightened_camera(camera, SIZE)
    corner = pinhole.unproject((0.0, 0.0))
    assert np.degrees(np.arctan(np.hypot(*corner[:2]))) == pytest.approx(60.0)
    picture = straighten(np.full((480, 640, 3), 77, np.uint8), camera)
    assert picture.shape == (480, 640, 3)
    assert (picture == 77).all()
    with pytest.raises(ValueError, match='max_fov_deg must be within 1 to 170'):
        straightened_camera(camera, SIZE, max_fov_deg=180.0)


@pytest.mark.parametrize('name', BOARDS)
def test_a_printed_png_is_to_scale(tmp_path, name):
    board, dpi, path = BOARDS[name], 150.0, tmp_path / 'board.png'
    print_board(board, path, dpi=dpi)
    x_per_m, y_per_m, unit = struct.unpack('>IIB', chunk(path.read_bytes(), b'pHYs'))
    assert (x_per_m, y_per_m, unit) == (round(dpi / 0.0254), round(dpi / 0.0254), 1)
    found = detect(read_image(path), board)
    np.testing.assert_array_equal(found.ids, np.arange(len(board.points)))
    px_per_m = dpi / 0.0254
    middle = 0.5 * np.array(read_image(path).shape[1::-1]) - 0.5
    truth = middle + px_per_m * board.points * [1.0, -1.0]
    assert np.abs(found.image_points - truth).max() < 0.2


def chunk(png, name):
    """Return the data of a PNG's chunk."""
    place = png.index(name)
    (length,) = struct.unpack('>I', png[place - 4 : place])
    return png[place + 4 : place + 4 + length]


@pytest.mark.parametrize('name', BOARDS)
def test_a_printed_pdf_is_to_scale(tmp_path, name):
    board, path = BOARDS[name], tmp_path / 'board.pdf'
    print_board(board, path)
    data = path.read_bytes()
    box = re.search(rb'/MediaBox \[ *0 0 ([\d.]+) ([\d.]+) *\]', data)
    points_per_m = 72.0 / 0.0254
    page = np.array([float(side) for side in box.groups()])
    np.testing.assert_allclose(page, points_per_m * np.array(board.sheet_size_m), rtol=1e-6)
    # Each quad begins with "x y m" (its first corner) in the page's content.
    starts = [
        [float(n) for n in found]
        for content in streams(data)
        for found in re.findall(rb'([\d.-]+) ([\d.-]+) m\n', content)
    ]
    wanted = 0.5 * page + points_per_m * black_quads(board)[:, 0]
    for corner in wanted:
        assert np.abs(np.array(starts) - corner).max(axis=1).min() < 1e-3
    print_board(board, tmp_path / 'again.pdf')
    assert (tmp_path / 'again.pdf').read_bytes() == data


def streams(pdf):
    """Yield the compressed contents of a PDF."""
    for found in re.finditer(rb'stream\r?\n(.*?)endstream', pdf, re.DOTALL):
        try:
            yield zlib.decompress(found[1])
        except zlib.error:
            continue


def test_print_says_what_is_wrong(tmp_path):
    with pytest.raises(ConfigError, match=r'board.svg: expected a name that ends in .pdf or .png'):
        print_board(BOARD, tmp_path / 'board.svg')
    with pytest.raises(ConfigError, match='expected a place to write to: No such file'):
        print_board(BOARD, tmp_path / 'none/board.pdf')
    with pytest.raises(ConfigError, match=r'expected at most 30000 px a side, got \d+: use .pdf'):
        print_board(BOARD, tmp_path / 'board.png', dpi=1e5)
    with pytest.raises(ValueError, match='dpi must be > 0'):
        print_board(BOARD, tmp_path / 'board.png', dpi=0.0)


def test_names_of_all_kinds_print(tmp_path):
    for name in ('a$b$', 'Brett_ä', '板'):
        print_board(
            Marker(id=1, size_m=0.02, dictionary='DICT_4X4_50', name=name), tmp_path / 'a.pdf'
        )


def test_descriptions_name_the_sizes():
    assert describe(BOARDS['chessboard']) == 'board: chessboard 9x6 inner corners, squares 25 mm'
    assert 'markers 22 mm, DICT_5X5_100, legacy pattern' in describe(BOARDS['charuco_legacy'])
    assert describe(BOARDS['marker']) == 'board: marker 3 of DICT_APRILTAG_36h11, side 150 mm'
    assert 'gaps 12.5 mm, DICT_6X6_250 from 0' in describe(BOARDS['marker_grid'])
    assert describe(BOARDS['bundle']) == 'board: bundle of 4 markers of DICT_APRILTAG_36h11'
