# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""Marker candidates that are not the board's: wrong border, wrong colours, two boards."""

import dataclasses
import re

from board_views import BOARDS, CAMERAS, project, seen_from, SIZE
import numpy as np
from p4pfr_ros import DivisionCamera, Pose
from p4pfr_ros.boards import AprilGrid, Charuco, Marker, MarkerGrid
from p4pfr_ros.detection import detect
from p4pfr_ros.rendering import render
import pytest

REAL_LENS = {'noise_sigma': 2.0, 'blur_sigma_px': 0.7}
CAMERA = CAMERAS['strong']
POSE = seen_from(0.42, (0.4, -0.3), 0.3)
GRID = MarkerGrid(
    columns=4, rows=3, marker_m=0.05, separation_m=0.02, dictionary='DICT_APRILTAG_36h11'
)
KALIBR = AprilGrid(columns=4, rows=3, tag_m=0.05, spacing=0.3)
MARKER = Marker(id=7, size_m=0.12, dictionary='DICT_5X5_100')
CHARUCO_4X4 = BOARDS['charuco']
CHARUCO = dataclasses.replace(CHARUCO_4X4, dictionary='DICT_4X4_100')


def with_border(board, bits):
    """Return the board with another width of the black border."""
    return dataclasses.replace(board, border_bits=bits)


def assert_on_their_projections(detection, board, pose=POSE):
    truth = project(CAMERA, pose, board.points[detection.ids])
    assert detection.reason == ''
    assert np.linalg.norm(detection.image_points - truth, axis=1).max() < 0.3


@pytest.mark.parametrize(
    ('board', 'printed'),
    [(GRID, 1), (GRID, 2), (GRID, 3), (KALIBR, 1), (KALIBR, 2)],
    ids=['marker_grid_1', 'marker_grid_2', 'marker_grid_3', 'aprilgrid_1', 'aprilgrid_2'],
)
def test_only_the_right_border_gives_corners(board, printed):
    """With another one the reason names both."""
    image = render(with_border(board, printed), CAMERA, POSE, SIZE, **REAL_LENS)
    detection = detect(image, with_border(board, printed))
    assert len(detection.ids) == len(board.points)
    assert_on_their_projections(detection, board)
    for expected in {1, 2, 3} - {printed}:
        detection = detect(image, with_border(board, expected))
        assert len(detection.ids) == 0
        # Corner squares distort the outlines that the widths are read in.
        cells = rf'{printed} cells?|more than {expected} cells?' if board is GRID else '.* cells?'
        assert re.search(
            f'a black border of ({cells}), but border_bits is {expected}', detection.reason
        )


@pytest.mark.parametrize('distance_m', [0.3, 0.35, 0.4])
def test_either_colour_of_a_charuco_board_with_wide_borders_is_found(distance_m):
    board = dataclasses.replace(
        CHARUCO, dictionary='DICT_6X6_250', square_m=0.04, marker_m=0.024, border_bits=2, rows=4
    )
    pose = seen_from(distance_m, (0.2, 0.1), 0.1)
    for printed in (board, dataclasses.replace(board, inverted=True)):
        image = render(printed, CAMERAS['strong'], pose, SIZE, **REAL_LENS)
        either = detect(image, dataclasses.replace(board, inverted='any'))
        np.testing.assert_array_equal(either.ids, detect(image, printed).ids)
        assert len(either.ids) == len(board.points)


@pytest.mark.parametrize('distance_m', [0.5, 0.45, 0.4])
def test_tags_whose_outlines_touch_corner_squares_are_found(distance_m):
    """Only the inner outline of a tag's blurred edge is closed, up to a cell inside the tag."""
    board = dataclasses.replace(KALIBR, columns=6, rows=6, tag_m=0.03)
    pose = seen_from(distance_m, (0.05, 0.02), 0.05)
    detection = detect(render(board, CAMERAS['strong'], pose, SIZE, **REAL_LENS), board)
    truth = project(CAMERAS['strong'], pose, board.points[detection.ids])
    assert len(detection.ids) == len(board.points)
    assert np.linalg.norm(detection.image_points - truth, axis=1).max() < 0.3


def test_a_charuco_board_may_have_wide_borders():
    board = dataclasses.replace(CHARUCO, border_bits=2, marker_m=0.03)
    image = render(board, CAMERA, POSE, SIZE, **REAL_LENS)
    detection = detect(image, board)
    assert len(detection.ids) == len(board.points)
    assert_on_their_projections(detection, board)
    assert 'border_bits is 1' in detect(image, with_border(board, 1)).reason


@pytest.mark.parametrize('printed', [False, True])
@pytest.mark.parametrize('board', [MARKER, GRID, CHARUCO], ids=['marker', 'grid', 'charuco'])
def test_inverted_decides_which_colours_are_accepted(board, printed):
    """'any' accepts both, as accurately."""
    image = render(dataclasses.replace(board, inverted=printed), CAMERA, POSE, SIZE, **REAL_LENS)
    for inverted in (False, True, 'any'):
        detection = detect(image, dataclasses.replace(board, inverted=inverted))
        if inverted in (printed, 'any'):
            assert len(detection.ids) == len(board.points)
            assert_on_their_projections(detection, board)
        else:
            assert len(detection.ids) == 0
            colours = 'white on black' if printed else 'black on white'
            reason = f'{colours}, but inverted is {str(inverted).lower()}'
            assert reason in detection.reason


@pytest.mark.parametrize(
    'board',
    [
        dataclasses.replace(GRID, columns=2, rows=2),
        Charuco(columns=4, rows=3, square_m=0.03, marker_m=0.022, dictionary='DICT_4X4_50'),
    ],
    ids=['marker_grid', 'charuco'],
)
def test_two_equal_boards_are_refused_with_the_reason(board):
    """Also where one of them is cut off, so that some markers are seen once."""
    poses = [seen_from(0.5, (0.3, 0.2), 0.1, (x, 0.0)) for x in (-0.33, 0.3)]
    image = np.full(SIZE[::-1], 110.0)
    for pose in poses:
        image = render(board, CAMERA, pose, SIZE, background=image.astype(float), **REAL_LENS)
    whole = detect(image, board)
    assert len(whole.ids) == 0
    assert whole.reason.startswith('two equal boards in the image: ')
    (right, bottom) = project(CAMERA, poses[1], board.marker_corners[1]).max(axis=0).astype(int)
    image[bottom + 4 :, right - 40 :] = 110
    assert detect(image, board).reason.startswith('two equal boards in the image: ')


def test_ids_begin_with_the_first():
    """A board with other ids is another board."""
    board = dataclasses.replace(CHARUCO, first_id=40)
    image = render(board, CAMERA, POSE, SIZE, **REAL_LENS)
    detection = detect(image, board)
    assert len(detection.ids) == len(board.points)
    assert_on_their_projections(detection, board)
    other = detect(image, CHARUCO)
    assert len(other.ids) == 0
    assert {each.reason for each in other.rejected} >= {'marker 40: not on the board'}
    assert re.search(r'found, but marker \d+: not on the board \(and \d+ more', other.reason)


def test_rejected_candidates_are_where_they_were_seen():
    """Their outlines surround the marker."""
    image = render(dataclasses.replace(MARKER, id=9), CAMERA, POSE, SIZE, **REAL_LENS)
    rejected = {each.reason: each.outline for each in detect(image, MARKER).rejected}
    truth = project(CAMERA, POSE, MARKER.points)
    outline = rejected['marker 9: not on the board']
    assert np.linalg.norm(outline - truth, axis=1).max() < 3.0


def test_markers_whose_outline_is_not_closed_are_found_from_their_neighbours():
    """Paint a bridge from one marker to the next, as glare or a pen would."""
    image = render(GRID, CAMERA, POSE, SIZE, **REAL_LENS)
    left, right = GRID.marker_corners[5:7].mean(axis=1)
    bridge = np.linspace(left, right, 400)
    for x, y in np.rint(project(CAMERA, POSE, bridge)).astype(int):
        if image[y - 1 : y + 2, x - 1 : x + 2].min() > 120:
            image[y - 1 : y + 2, x - 1 : x + 2] = 25
    detection = detect(image, GRID)
    assert set(detection.ids // 4) >= {5, 6}
    assert_on_their_projections(detection, GRID)


def test_charuco_corners_between_large_markers_are_right_or_absent():
    """The markers leave gaps of 3 px: a fit may end beside the corner, 2.5 px away."""
    board = dataclasses.replace(
        CHARUCO, columns=5, rows=7, square_m=0.03, marker_m=0.0244, dictionary='DICT_5X5_100'
    )
    board = with_border(board, 2)
    camera = DivisionCamera(948.2, (639.5, 479.5), -0.498)
    pose = Pose.from_rotation_vector((0.2599, 2.6477, 0.6225), (0.1837, -0.0614, 0.5673))
    lens = {'noise_sigma': 3.3, 'blur_sigma_px': 1.07}
    for seed in range(8):
        detection = detect(render(board, camera, pose, (1280, 960), **lens, seed=seed), board)
        truth = project(camera, pose, board.points[detection.ids])
        assert len(detection.ids) >= 12
        assert np.linalg.norm(detection.image_points - truth, axis=1).max() < 1.0


@pytest.mark.parametrize('n', range(8, 14))
def test_charuco_corners_of_small_squares_are_right_or_absent(n):
    """The fit of a corner may begin 2.5 px beside it, and end between two cells of a marker."""
    camera = CAMERAS['strong']
    pose = seen_from(1.8 * (0.42 / 1.8) ** (n / 23), (0.2, 0.1), 0.02 * n, (0.05, 0.0))
    image = render(CHARUCO_4X4, camera, pose, SIZE, noise_sigma=2, blur_sigma_px=0.7, seed=n)
    detection = detect(image, CHARUCO_4X4)
    truth = project(camera, pose, CHARUCO_4X4.points[detection.ids])
    assert len(detection.ids) >= 8
    assert np.linalg.norm(detection.image_points - truth, axis=1).max() < 0.3


def others_outlines(detection):
    """Return the outlines (4, 2) by the ids of markers that are not on the board."""
    matches = [
        (re.fullmatch(r'marker (\d+): not on the board', each.reason), each.outline)
        for each in detection.rejected
    ]
    return {int(match[1]): outline for match, outline in matches if match}


@pytest.mark.parametrize('dictionary', ['DICT_6X6_1000', 'DICT_APRILTAG_36h11'])
@pytest.mark.parametrize('scale', [1.0, 2.25])
def test_all_markers_of_another_board_are_named_at_any_resolution(scale, dictionary):
    """With a large dictionary, too, and where small cells of the codes are candidates as well."""
    board = dataclasses.replace(GRID, dictionary=dictionary)
    size = round(640 * scale), round(480 * scale)
    camera = DivisionCamera(500.0 * scale, ((size[0] - 1) / 2, (size[1] - 1) / 2), -0.2)
    pose = seen_from(0.5, (0.25, 0.2), 0.15)
    image = render(board, camera, pose, size, **REAL_LENS)
    outlines = others_outlines(detect(image, dataclasses.replace(board, first_id=40)))
    assert sorted(outlines) == list(range(12))
    for marker_id, outline in outlines.items():
        truth = project(camera, pose, board.marker_corners[marker_id])
        assert np.linalg.norm(outline - truth, axis=1).max() < 3.0


@pytest.mark.parametrize('size_m', [0.12, 0.04])
@pytest.mark.parametrize(
    ('printed', 'expected', 'reason'),
    [
        ({'inverted': True}, {}, 'marker 7: white on black, but inverted is false'),
        ({}, {'border_bits': 2}, 'marker 7: a black border of 1 cell, but border_bits is 2'),
        ({'id': 8}, {}, 'marker 8: not on the board'),
    ],
    ids=['inverted', 'border', 'id'],
)
def test_a_marker_on_a_visible_sheet_is_explained(printed, expected, reason, size_m):
    """OpenCV reports only the outline of the sheet, which is near that of the marker."""
    board = dataclasses.replace(MARKER, size_m=size_m)
    pose = seen_from(0.5, (0.25, 0.2), 0.15)
    image = render(dataclasses.replace(board, **printed), CAMERA, pose, SIZE, **REAL_LENS)
    detection = detect(image, dataclasses.replace(board, **expected))
    assert len(detection.ids) == 0
    assert detection.reason == reason or 'id' in printed
    [outline] = [each.outline for each in detection.rejected if each.reason == reason]
    distance_px = np.linalg.norm(outline[:, None] - project(CAMERA, pose, board.points), axis=2)
    assert distance_px.min(axis=1).max() < 4.0


@pytest.mark.parametrize('distance_m', [0.3, 0.9])
def test_the_reason_names_the_width_of_a_wide_border(distance_m):
    """Widths of 2 and 3 cells place the centres of a small code within the same cells."""
    board = dataclasses.replace(MARKER, dictionary='DICT_4X4_50', border_bits=3)
    image = render(board, CAMERA, seen_from(distance_m, (0.3, 0.1), 0.2), SIZE, **REAL_LENS)
    reason = 'marker 7: a black border of 3 cells, but border_bits is 1'
    assert detect(image, with_border(board, 1)).reason == reason


def test_an_image_without_markers_gives_no_reason():
    """The squares of a chessboard are candidates, and its sheet."""
    board = BOARDS['chessboard']
    image = render(board, CAMERA, seen_from(0.42, (0.4, -0.3), 0.3), SIZE, **REAL_LENS)
    detection = detect(image, CHARUCO)
    assert detection.reason == 'no corner of a 7x5 ChArUco board found'
    assert {each.reason for each in detection.rejected} == {'no code'}
