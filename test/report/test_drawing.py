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
from p4pfr_ros.detection import detect, Detection
from p4pfr_ros.detection.candidates import RejectedCandidate
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
from p4pfr_ros.report.lettering import wrapped
import pytest

BOARD, CAMERA, POSE = BOARDS['charuco'], CAMERAS['strong'], seen_from(0.4, (0.3, 0.2), 0.2)
IMAGE = render(BOARD, CAMERA, POSE, SIZE)
LONG = (
    'no 10x7 chessboard found: 9x6 inner corners are visible '
    '(columns and rows count inner corners, not squares)'
)
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


@pytest.mark.parametrize('width', [320, 640, 1280])
def test_a_long_reason_is_wrapped(width):
    """No letter is at the rim, where a text that is cut would be."""
    blank = np.full((480, width, 3), 90, np.uint8)
    detection = dataclasses.replace(detect(blank, BOARD), reason=LONG)
    bar = bar_at_top(annotate(blank, detection))
    assert bar[:, :4].max() < 30
    assert bar[:, -4:].max() < 30
    lines = count_lines(bar)
    # Letters are wider in older OpenCV.
    assert lines in {320: (3, 4), 640: (2,), 1280: (1,)}[width]


def test_reasons_of_several_boards_begin_a_line_each_and_leave_most_of_the_image():
    blank = np.full((480, 640, 3), 90, np.uint8)
    short = 'no marker 7 of DICT_5X5_100 found'
    detection = detect(blank, BOARD)
    bar = bar_at_top(annotate(blank, dataclasses.replace(detection, reason=f'{short}; {short}')))
    assert count_lines(bar) == 2
    many = '; '.join([LONG] * 20)
    bar = bar_at_top(annotate(blank, dataclasses.replace(detection, reason=many)))
    assert count_lines(bar) >= 6
    assert len(bar) <= 170
    assert bar[:, -4:].max() < 30


def bar_at_top(drawn):
    """Return the rows at the top of an image of level 90 that are darkened."""
    return drawn[: np.argmax(drawn[:, 0, 0] == 90)]


def count_lines(bar):
    """Return the number of lines of text in a bar."""
    has_letters = (bar.max(axis=(1, 2)) > 120).astype(int)
    # Dots and descenders are within 3 px of their line.
    has_letters = cv2.dilate(has_letters.astype(np.uint8)[:, None], np.ones((3, 1)))[:, 0]
    return int((np.diff(has_letters.astype(int), prepend=0) == 1).sum())


@pytest.mark.parametrize('scale', [1, 2])
@pytest.mark.parametrize(
    ('reason', 'labels'),
    [
        ('marker {}: not on the board', 3),
        ('marker {}: its cells do not fit its outline (wrong border_bits or blurred)', 3),
        ('circle, but no grid', 1),
        ('no code', 0),
    ],
)
def test_the_same_reason_is_written_a_few_times_without_overlap(reason, labels, scale):
    """Whatever the ids, in the image, on bars that are darker than it."""
    blank = np.full((480 * scale, 640 * scale, 3), 200, np.uint8)
    square = 40.0 * scale * np.array([(0, 0), (1, 0), (1, 1), (0, 1)])
    rejected = [
        RejectedCandidate(square + scale * np.array([x, y]), reason.format(10 * x + y))
        for y in (1, 60, 120, 300, 438)
        for x in (1, 100, 300, 450, 598)
    ]
    none = np.empty((0, 2))
    detection = Detection(none, none, np.empty(0, int), '', tuple(rejected))
    drawn = annotate(blank, detection)
    bars = np.uint8((drawn == 50).all(axis=2))
    bars = cv2.morphologyEx(bars, cv2.MORPH_CLOSE, np.ones((9 * scale, 9 * scale)))
    _, _, boxes, _ = cv2.connectedComponentsWithStats(bars)
    boxes = boxes[1:][boxes[1:, cv2.CC_STAT_AREA] > 100]
    assert len(boxes) == labels
    for left, top, width, height, area in boxes:
        assert area > 0.95 * width * height
        # Whole letters: none is in the margin of its bar.
        inside = drawn[top : top + height, left : left + width]
        margin = inside[4 * scale : -4 * scale, [4 * scale, -4 * scale - 1]]
        assert margin.max() < 100
        assert inside.max() > 150


def test_lines_are_as_wide_as_asked_and_complete():
    word = 'DICT_APRILTAG_36h11_' * 8
    for width_px in (60, 200, 500):
        lines = wrapped(f'{LONG} {word}', 0.5, width_px)
        assert ''.join(lines).replace(' ', '') == f'{LONG}{word}'.replace(' ', '')
        widest = max(
            cv2.getTextSize(each, cv2.FONT_HERSHEY_SIMPLEX, 0.5, 1)[0][0] for each in lines
        )
        assert widest <= width_px
    assert wrapped('', 0.5, 100) == ['']


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
