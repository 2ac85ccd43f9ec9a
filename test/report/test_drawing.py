# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""Annotated and undistorted images."""

import dataclasses

from board_views import BOARDS, CAMERAS, CENTER, distance_m, project, seen_from, SIZE
import cv2
import numpy as np
from p4pfr_ros.boards import Marker
from p4pfr_ros.core.cameras.division import DivisionCamera
from p4pfr_ros.core.minimal.solution import Solution
from p4pfr_ros.detection import detect
from p4pfr_ros.rendering import render
from p4pfr_ros.report.drawing import (
    annotate,
    board_lines,
    captioned,
    remap,
    straighten,
    straightened_camera,
    straightening_map,
)
import pytest

BOARD, CAMERA, POSE = BOARDS['charuco'], CAMERAS['strong'], seen_from(0.4, (0.3, 0.2), 0.2)
IMAGE = render(BOARD, CAMERA, POSE, SIZE)
every_camera = pytest.mark.parametrize('camera', CAMERAS.values(), ids=list(CAMERAS))


def near(drawn, image, points, radius_px=3):
    """Return (N,) bool: whether something is drawn near each of the points (N, 2)."""
    changed = (drawn != image[..., None]).any(axis=2).astype(np.uint8)
    reach = cv2.dilate(changed, np.ones((2 * radius_px + 1,) * 2, np.uint8))
    x, y = np.rint(points).astype(int).T
    return reach[y, x].astype(bool)


def test_corners_are_circled():
    detection = detect(IMAGE, BOARD)
    drawn = annotate(IMAGE, detection)
    assert drawn.shape == (480, 640, 3)
    assert near(drawn, IMAGE, detection.image_points, 4).all()
    # Circles, and nothing else.
    assert (drawn != IMAGE[..., None]).any(axis=2).sum() < 80 * len(detection.ids)


def test_the_outline_is_distorted_like_the_image():
    detection = detect(IMAGE, BOARD)
    drawn = annotate(IMAGE, detection, Solution(CAMERA, POSE), BOARD)
    x, y = 0.5 * np.array(BOARD.sheet_size_m)
    upper = np.linspace((-x, y), (x, y), 60)
    assert near(drawn, IMAGE, project(CAMERA, POSE, upper), 1).all()
    chord = np.linspace(*project(CAMERA, POSE, upper[[0, -1]]), 60)
    assert not near(drawn, IMAGE, chord[25:35], 1).any()


def test_axes_are_red_green_and_blue():
    drawn = annotate(IMAGE, detect(IMAGE, BOARD), Solution(CAMERA, POSE), BOARD).astype(int)
    length = 0.2 * min(BOARD.sheet_size_m)
    tips = CAMERA.project(POSE.transform(length * np.eye(3)))
    for (x, y), strongest in zip(np.rint(tips).astype(int), (2, 1, 0), strict=True):
        assert np.argmax(drawn[y, x]) == strongest
        assert np.ptp(drawn[y, x]) > 100


def test_a_reason_is_written_and_the_input_is_unchanged():
    blank = np.full((480, 640, 3), 90, np.uint8)
    drawn = annotate(blank, detect(blank, BOARD))
    assert (blank == 90).all()
    assert drawn[:30].max() > 200  # letters, on a bar that is darker than the image
    assert drawn[:30].min() < 30
    assert (drawn[40:] == 90).all()


def test_rejected_candidates_are_outlined_with_their_reason():
    """A marker that is not on the board."""
    other = Marker(id=40, size_m=0.05, dictionary=BOARD.dictionary)
    pose = seen_from(0.4, (0.3, 0.2), 0.2, (-0.4, -0.25))
    alone = render(other, CAMERA, pose, SIZE)
    outline = project(CAMERA, pose, other.points)
    detection = detect(alone, BOARD)
    drawn = annotate(alone, detection)
    plain = annotate(alone, dataclasses.replace(detection, rejected=()))
    assert near(drawn, alone, outline, 4).all()
    assert (drawn != plain).any(axis=2).sum() > 150  # the outline and the text above it


def test_a_board_partly_behind_the_camera_is_drawn():
    wide = Solution(CAMERAS['pinhole'], seen_from(0.05, (1.4, 0.0)))
    drawn = annotate(IMAGE, detect(IMAGE, BOARD), wide, BOARD)
    assert drawn.shape == (480, 640, 3)


@every_camera
def test_a_straightened_image_is_that_of_the_pinhole_camera(camera):
    board = BOARDS['chessboard']
    pose = seen_from(distance_m(camera), (0.3, 0.2))
    image = render(board, camera, pose, SIZE, blur_sigma_px=0.7)
    pinhole = straightened_camera(camera, SIZE)
    detection = detect(straighten(image, camera), board)
    assert (pinhole.k, pinhole.center_px) == (0.0, CENTER)
    assert len(detection.ids) == 54
    errors = detection.image_points - project(pinhole, pose, detection.board_points)
    assert np.abs(errors.mean(axis=0)).max() < 0.03
    assert np.linalg.norm(errors, axis=1).mean() < 0.1


@pytest.mark.parametrize('name', ['pinhole', 'strong'])
def test_the_straightened_image_has_the_whole_field_of_view(name):
    pinhole = straightened_camera(CAMERAS[name], SIZE)
    border = [[0, 240], [639, 240], [320, 0], [320, 479], [0, 0], [639, 479]]
    pixels = pinhole.project(CAMERAS[name].unproject(border))
    assert (pixels > -0.01).all()
    assert (pixels < [639.01, 479.01]).all()
    # The focal length is the largest possible.
    assert np.abs(pixels[4]).min() < 0.01


def test_the_field_of_view_is_limited():
    camera = DivisionCamera(150.0, CENTER, -0.4)
    assert camera.unproject((0.0, 0.0))[2] < 0.0
    pinhole = straightened_camera(camera, SIZE)
    corner = pinhole.unproject((0.0, 0.0))
    assert np.degrees(np.arctan(np.hypot(*corner[:2]))) == pytest.approx(60.0)
    straight = straighten(np.full((480, 640, 3), 77, np.uint8), camera)
    assert straight.shape == (480, 640, 3)
    assert (straight == 77).all()
    with pytest.raises(ValueError, match='max_fov_deg must be within 1 to 170'):
        straightened_camera(camera, SIZE, max_fov_deg=180.0)


@every_camera
def test_an_interpolated_map_straightens_like_an_exact_one(camera):
    image = render(BOARD, camera, seen_from(0.5), SIZE)
    exact = straighten(image, camera)
    fast = remap(image, straightening_map(camera, SIZE, step_px=8))
    assert fast.shape == exact.shape
    differs = np.abs(fast.astype(int) - exact) > 12
    # At the border of what the lens sees both end within a step of each other.
    assert differs.mean() < 0.01
    assert not differs[100:380, 140:500].any()


def test_the_lines_of_a_board_pass_through_its_corners():
    lines = board_lines(BOARD, POSE, CAMERA)
    [outline] = lines['outline']
    x, y = 0.5 * np.array(BOARD.sheet_size_m)
    corners = project(CAMERA, POSE, np.array([(-x, y), (x, y), (x, -y), (-x, -y)]))
    np.testing.assert_allclose(outline[[0, 48, 96, 144, 192]], corners[[0, 1, 2, 3, 0]])
    origin = CAMERA.project(POSE.translation)
    for axis in 'xyz':
        np.testing.assert_allclose(lines[axis][0][0], origin)


def test_a_caption_is_below_the_image():
    image = cv2.cvtColor(IMAGE, cv2.COLOR_GRAY2BGR)
    drawn = captioned(image, 'one line', 'and another')
    np.testing.assert_array_equal(drawn[:480], image)
    bar = drawn[480:]
    assert 30 < len(bar) < 60
    half = len(bar) // 2
    assert np.ptp(bar[:half]) > 100
    assert np.ptp(bar[half:]) > 100
