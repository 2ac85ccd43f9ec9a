# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""The search for circle grids: bounded work, own sides, several grids, covered circles."""

from board_views import BOARDS, CAMERAS, CENTER, project, seen_from, SIZE
import cv2
import numpy as np
from p4pfr_ros.boards import CircleGrid
from p4pfr_ros.core.cameras.division import DivisionCamera
from p4pfr_ros.detection import circle_grid, detect
from p4pfr_ros.detection.circle_lattice import circle_lattices
from p4pfr_ros.detection.ellipse_blobs import Blobs, find_blobs, LEVELS, MOST_BLOBS
from p4pfr_ros.rendering import render
import pytest

REAL_LENS = {'noise_sigma': 2.0, 'blur_sigma_px': 0.7}
PINHOLE = CAMERAS['pinhole']
ASYMMETRIC, SYMMETRIC = BOARDS['circle_grid'], BOARDS['symmetric_circles']
LAYOUTS = pytest.mark.parametrize('board', [SYMMETRIC, ASYMMETRIC], ids=['7x5', 'asymmetric'])


def grid_of(columns, rows, asymmetric=False):
    return CircleGrid(
        columns=columns, rows=rows, spacing_m=0.03, diameter_m=0.018, asymmetric=asymmetric
    )


def dots(spacing_px, shape=(480, 640), radius_px=None):
    """Draw a plain lattice of dark dots that fills an image."""
    image = np.full(shape, 230, np.uint8)
    radius = round(16 * (radius_px or 0.3 * spacing_px))
    for y in np.arange(spacing_px / 2, shape[0], spacing_px):
        for x in np.arange(spacing_px / 2, shape[1], spacing_px):
            cv2.circle(image, (int(16 * x), int(16 * y)), radius, 20, -1, cv2.LINE_AA, 4)
    return image


def checker(side_px):
    y, x = np.indices((480, 640))
    return (40 + 170 * ((x // side_px + y // side_px) % 2)).astype(np.uint8)


def blurred_noise(sigma_px):
    noise = np.random.default_rng(1).standard_normal((480, 640))
    noise = cv2.GaussianBlur(noise, (0, 0), sigma_px)
    return np.clip(128.0 + 60.0 * noise / noise.std(), 0, 255).astype(np.uint8)


def text():
    image, rng = np.full((480, 640), 245, np.uint8), np.random.default_rng(1)
    for y in range(13, 480, 13):
        line = ''.join(rng.choice(list('abdegopqO0869 .,')) for _ in range(150))
        cv2.putText(image, line, (2, y), cv2.FONT_HERSHEY_SIMPLEX, 0.4, 10, 1, cv2.LINE_AA)
    return image


HARD = {
    'noise': blurred_noise(1.0),
    'blobs': blurred_noise(3.0),
    'checkers of 3': checker(3),
    'checkers of 8': checker(8),
    'text': text(),
    'small dots': dots(6),
    'dots': dots(14),
}


@pytest.mark.parametrize('image', HARD.values(), ids=list(HARD))
def test_the_work_is_bounded_whatever_the_image_holds(image, monkeypatch):
    """One pass over the image for each level, and few regions; none of OpenCV's searches."""
    passes, examined = [], []
    components, region = cv2.connectedComponentsWithStatsWithAlgorithm, cv2.connectedComponents

    def count_pass(*arguments, **options):
        passes.append(arguments[0].size)
        return components(*arguments, **options)

    def count_region(*arguments, **options):
        examined.append(arguments[0].size)
        return region(*arguments, **options)

    def refuse(*_, **__):
        raise AssertionError('takes unbounded time')

    monkeypatch.setattr(cv2, 'connectedComponentsWithStatsWithAlgorithm', count_pass)
    monkeypatch.setattr(cv2, 'connectedComponents', count_region)
    for name in ('findCirclesGrid', 'SimpleBlobDetector_create', 'findContours'):
        monkeypatch.setattr(cv2, name, refuse)
    for board in (SYMMETRIC, ASYMMETRIC, grid_of(3, 3)):
        passes.clear()
        examined.clear()
        detection = detect(image, board)
        assert len(detection.ids) == 0
        assert passes == [image.size] * len(LEVELS)
        assert len(examined) <= 3000
        assert sum(examined) <= 2.0 * image.size
        assert len(detection.rejected) <= MOST_BLOBS


def test_of_too_many_dots_none_is_found_rather_than_some():
    """Else a part of a lattice could look like a board."""
    assert len(find_blobs(dots(6), 1000.0).middles) == 0
    assert len(find_blobs(dots(14), 1000.0).middles) == 34 * 45
    large = dots(6)
    large[100:300, 100:400] = dots(40)[100:300, 100:400]
    found = find_blobs(large, 1000.0)
    assert not found.are_all
    assert len(found.middles) >= 25
    assert found.diameters_px.min() > 10.0
    assert 'among the 0 largest dark circles' in detect(dots(6), SYMMETRIC).reason


@LAYOUTS
def test_a_part_of_a_plain_lattice_is_no_board(board):
    detection = detect(dots(30), board)
    assert len(detection.ids) == 0
    assert 'among 336 dark circles: ' in detection.reason
    assert '21x16 circles' in detection.reason or '16x21 circles' in detection.reason


@pytest.mark.parametrize(
    ('shown', 'given', 'hint'),
    [
        (grid_of(8, 6), grid_of(7, 5), ': 8x6 circles are visible'),
        (grid_of(8, 5), grid_of(7, 5), ': 8x5 circles are visible'),
        (grid_of(6, 5), grid_of(7, 5), ': 6x5 circles are visible'),
        (grid_of(4, 9, True), grid_of(4, 11, True), ': 4x9 circles are visible'),
        (grid_of(4, 12, True), grid_of(4, 11, True), ': 4x12 circles are visible'),
        (grid_of(5, 11, True), grid_of(4, 11, True), ': 5x11 circles are visible'),
        (grid_of(7, 5), grid_of(4, 9, True), ', in a symmetric grid'),
        (grid_of(4, 9, True), grid_of(7, 5), ': 4x9 circles are visible, in an asymmetric grid'),
    ],
)
@pytest.mark.parametrize('roll_rad', [0.1, 2.0])
def test_a_grid_of_another_size_is_named(shown, given, hint, roll_rad):
    image = render(shown, PINHOLE, seen_from(0.5, (0.3, 0.2), roll_rad), SIZE, **REAL_LENS)
    assert detect(image, shown).reason == ''
    reason = detect(image, given).reason
    assert reason.startswith(f'no grid of {given.columns}x{given.rows} circles found among ')
    assert reason.endswith(hint)


@pytest.mark.parametrize(
    ('board', 'hint'),
    [
        (SYMMETRIC, ': 6x5 circles are visible'),
        (grid_of(4, 11, True), ''),
        (grid_of(4, 4), ': 4x3 circles are visible'),
    ],
)
def test_a_grid_with_a_hidden_column_is_not_found(board, hint):
    """Else the circles could be those one column farther."""
    pose = seen_from(0.45)
    image = render(board, PINHOLE, pose, SIZE, **REAL_LENS)
    column = np.arange(len(board.points)) % board.columns == board.columns - 1
    for x, y in np.rint(project(PINHOLE, pose, board.points[column])).astype(int).tolist():
        cv2.circle(image, (x, y), 16, 219, -1)
    reason = detect(image, board).reason
    assert reason.startswith(f'no grid of {board.columns}x{board.rows} circles found among ')
    assert reason.endswith(hint)


def test_circles_that_the_search_misses_show_that_the_grid_continues(monkeypatch):
    """A sixth row that is found as no ellipse is still dark."""
    pose = seen_from(0.5)
    image = render(grid_of(7, 6), PINHOLE, pose, SIZE, **REAL_LENS)
    last_row = project(PINHOLE, pose, grid_of(7, 6).points[-7:])

    def without_last_row(grey, max_area_px):
        blobs = find_blobs(grey, max_area_px)
        far = np.linalg.norm(blobs.middles[:, None] - last_row, axis=2).min(axis=1) > 5.0
        return Blobs(blobs.middles[far], blobs.moments[far])

    monkeypatch.setattr(circle_grid, 'find_blobs', without_last_row)
    assert len(detect(image, grid_of(7, 5)).ids) == 0
    image[int(last_row[:, 1].min()) - 14 :] = 219
    assert len(detect(image, grid_of(7, 5)).ids) == 35


@LAYOUTS
def test_of_two_grids_the_larger_one_is_meant(board):
    pose = seen_from(1.0, (0.2, 0.1), 0.2, (-0.3, 0.0))
    image = render(board, PINHOLE, pose, SIZE, **REAL_LENS)
    truth = project(PINHOLE, pose, board.points)
    twice = image.copy()
    twice[:, 320:] = image[:, :320]
    detection = detect(twice, board)
    name = f'{board.columns}x{board.rows} circles'
    assert detection.reason == f'2 grids of {name} found, of about the same size'
    assert len(detection.rejected) == 2 * len(board.points)
    far = render(board, PINHOLE, seen_from(1.7, offset=(0.3, 0.0)), SIZE, **REAL_LENS)
    image[:, 380:] = far[:, 380:]
    detection = detect(image, board)
    assert len(detection.ids) == len(board.points)
    assert np.linalg.norm(detection.image_points - truth, axis=1).max() < 0.3


@LAYOUTS
def test_a_grid_with_covered_circles_is_found(board):
    """Up to a quarter of them, and less than a half of each side."""
    pose = seen_from(0.5, (0.3, 0.2), 0.3)
    image = render(board, PINHOLE, pose, SIZE, **REAL_LENS)
    truth = project(PINHOLE, pose, board.points)
    # A diagonal of them parts the others.
    covered = [1, 10, 13, 22, 33] if board.asymmetric else [1, 9, 10, 16, 24, 32]
    for x, y in np.rint(truth[covered]).astype(int).tolist():
        cv2.circle(image, (x, y), 14, 215, -1)
    detection = detect(image, board)
    visible = np.delete(np.arange(len(board.points)), covered)
    np.testing.assert_array_equal(detection.ids, visible)
    assert np.linalg.norm(detection.image_points - truth[visible], axis=1).max() < 0.3


def test_a_steep_view_through_a_wide_lens_is_found():
    """OpenCV's search needs trial lenses, and misses this one with all of them."""
    camera, board = DivisionCamera(250.0, CENTER, -0.45), grid_of(4, 11, True)
    pose = seen_from(0.25, (0.7, -0.5), 0.4)
    image = render(board, camera, pose, SIZE, **REAL_LENS)
    detection = detect(image, board)
    assert len(detection.ids) == len(board.points)
    errors_px = np.linalg.norm(
        detection.image_points - project(camera, pose, board.points), axis=1
    )
    assert errors_px.max() < 0.3


def test_ellipses_have_the_moments_of_their_outlines():
    image = np.full((200, 300), 220, np.uint8)
    cv2.ellipse(image, (90, 100), (30, 12), 30.0, 0.0, 360.0, 30, -1)
    cv2.circle(image, (200, 80), 10, 30, -1)
    cv2.circle(image, (240, 150), 10, 30, 3)  # a ring
    cv2.line(image, (20, 180), (200, 190), 30, 6)
    found = find_blobs(image, 5000.0)
    np.testing.assert_allclose(found.middles, [(90, 100), (200, 80)], atol=0.3)
    np.testing.assert_allclose(found.diameters_px, [2.0 * np.sqrt(30.0 * 12.0), 20.0], rtol=0.06)
    values, vectors = np.linalg.eigh(found.moments[0])
    np.testing.assert_allclose(2.0 * np.sqrt(values), [12.0, 30.0], rtol=0.06)
    assert abs(vectors[:, 1] @ (np.cos(np.pi / 6.0), np.sin(np.pi / 6.0))) > 0.99


def test_lattices_keep_their_direction_of_rotation():
    pose, board = seen_from(0.5, (0.5, -0.3), 0.4), grid_of(5, 4)
    image = render(board, PINHOLE, pose, SIZE, **REAL_LENS)
    blobs = find_blobs(image, 5000.0)
    (lattice,) = circle_lattices(blobs, 0.03 / 0.009, 12)
    assert sorted(lattice.shape) == [4, 5]
    points = blobs.middles[lattice]
    first, second = points[1, 0] - points[0, 0], points[0, 1] - points[0, 0]
    assert first[0] * second[1] - first[1] * second[0] > 0.0
    assert not circle_lattices(Blobs(np.empty((0, 2)), np.empty((0, 2, 2))), 3.0, 4)
