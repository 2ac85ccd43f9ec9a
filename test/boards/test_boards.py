# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

import dataclasses

from board_views import BOARDS
import numpy as np
from p4pfr_ros.boards import (
    AprilGrid,
    Bundle,
    Charuco,
    Chessboard,
    CircleGrid,
    Marker,
    MarkerGrid,
    PlacedMarker,
)
import pytest

every_board = pytest.mark.parametrize('board', BOARDS.values(), ids=BOARDS)


@every_board
def test_frame_is_in_the_middle_of_the_sheet(board):
    if not isinstance(board, Bundle):  # its marker positions define the origin
        middle = 0.5 * (board.points.min(axis=0) + board.points.max(axis=0))
        np.testing.assert_allclose(middle, 0.0, atol=1e-15)
    printed = np.concatenate(
        [board.points, board.black_squares.reshape(-1, 2), *board.marker_corners]
    )
    extent = np.abs(printed).max(axis=0)
    assert np.all(np.abs(board.points) <= extent + 1e-12)
    assert np.all(extent < 0.5 * np.array(board.sheet_size_m))


def test_chessboard_points_run_from_the_top_left_row_by_row():
    points = Chessboard(columns=3, rows=4, square_m=2.0).points.reshape(4, 3, 2)
    np.testing.assert_allclose(points[0], [[-2, 3], [0, 3], [2, 3]])
    np.testing.assert_allclose(points[-1], [[-2, -3], [0, -3], [2, -3]])


def test_chessboard_top_left_square_is_black():
    board = Chessboard(columns=9, rows=6, square_m=0.025)
    assert len(board.black_squares) == 35  # of 10 x 7
    np.testing.assert_allclose(board.black_squares[0], [-0.125, 0.0625, -0.1, 0.0875])
    np.testing.assert_allclose(board.black_squares[-1], [0.075, -0.0875, 0.1, -0.0625])


def test_charuco_markers_are_in_the_white_squares():
    board = BOARDS['charuco']
    centres = board.marker_corners.mean(axis=1)
    black = 0.5 * (board.black_squares[:, :2] + board.black_squares[:, 2:])
    distance = np.linalg.norm(centres[:, None] - black, axis=2).min()
    assert len(centres) == 17 == len(board.marker_ids)
    assert distance == pytest.approx(board.square_m)


def test_legacy_pattern_changes_only_boards_with_an_even_number_of_rows():
    def first_black(rows, legacy):
        board = dataclasses.replace(BOARDS['charuco'], rows=rows, legacy_pattern=legacy)
        return board.black_squares[0, 0]

    assert first_black(5, False) == first_black(5, True)
    assert first_black(6, True) == pytest.approx(first_black(6, False) + 0.035)


@pytest.mark.parametrize('name', ['marker', 'marker_grid'])
def test_marker_corners_run_clockwise_from_the_top_left(name):
    corners = BOARDS[name].points.reshape(-1, 4, 2)
    side = corners[0, 1, 0] - corners[0, 0, 0]
    np.testing.assert_allclose(
        corners[:, 1] - corners[:, 0], np.tile([side, 0], (len(corners), 1))
    )
    np.testing.assert_allclose(
        corners[:, 2] - corners[:, 1], np.tile([0, -side], (len(corners), 1)), atol=1e-15
    )
    assert side > 0.0


def test_marker_grid_ids_count_row_by_row_from_the_first():
    board = MarkerGrid(
        columns=3, rows=2, marker_m=1.0, separation_m=0.5, dictionary='DICT_4X4_50', first_id=7
    )
    assert board.marker_ids == (7, 8, 9, 10, 11, 12)
    centres = board.marker_corners.mean(axis=1)
    np.testing.assert_allclose(centres[[0, 2, 3]], [[-1.5, 0.75], [1.5, 0.75], [-1.5, -0.75]])


def test_aprilgrid_ids_count_from_the_bottom_left():
    """Upright tags, as Kalibr prints them; its corner squares fill the gaps."""
    board = AprilGrid(columns=3, rows=2, tag_m=1.0, spacing=0.5, first_id=7)
    assert board.marker_ids == (7, 8, 9, 10, 11, 12)
    centres = board.marker_corners.mean(axis=1)
    np.testing.assert_allclose(centres[[0, 2, 3]], [[-1.5, -0.75], [1.5, -0.75], [-1.5, 0.75]])
    np.testing.assert_allclose(board.marker_corners[0, 0], [-2.0, -0.25])
    assert len(board.black_squares) == 12
    corners = board.points[:, None]
    low, high = board.black_squares[:, :2], board.black_squares[:, 2:]
    touching = np.minimum(np.abs(corners - low), np.abs(corners - high)).max(axis=2)
    np.testing.assert_allclose(touching.min(axis=1), 0.0, atol=1e-12)


def test_charuco_ids_begin_with_the_first():
    board = dataclasses.replace(BOARDS['charuco'], first_id=20)
    assert board.marker_ids == tuple(range(20, 37))


def test_circle_rows_are_spaced_as_opencv_spaces_them():
    """Rows one spacing apart; in an asymmetric grid every second one is shifted by it."""
    board = CircleGrid(columns=3, rows=4, spacing_m=1.0, diameter_m=0.5)
    np.testing.assert_allclose(
        board.points[:4] - board.points[0], [[0, 0], [1, 0], [2, 0], [0, -1]]
    )
    board = dataclasses.replace(board, asymmetric=True)
    rows = board.points.reshape(4, 3, 2) - board.points[0]
    np.testing.assert_allclose(rows[0], [[0, 0], [2, 0], [4, 0]])
    np.testing.assert_allclose(rows[1], [[1, -1], [3, -1], [5, -1]])
    np.testing.assert_allclose(rows[2, 0], [0, -2])


PLACED = PlacedMarker(id=1, x_m=0.0, y_m=0.0, size_m=1.0)


def bundle(*places, size_m=1.0):
    """Return a bundle of markers 0, 1, ... placed at (x, y, angle_deg)."""
    markers = tuple(
        PlacedMarker(id=n, x_m=x, y_m=y, size_m=size_m, angle_deg=angle)
        for n, (x, y, angle) in enumerate(places)
    )
    return Bundle(markers=markers, dictionary='DICT_4X4_50')


def test_bundle_markers_are_where_they_are_placed():
    corners = bundle((5.0, -2.0, 0.0), (1.0, 3.0, 90.0), size_m=2.0).marker_corners
    np.testing.assert_allclose(corners[0], [[4, -1], [6, -1], [6, -3], [4, -3]])
    # A counter-clockwise quarter turn moves the top left corner to the bottom left.
    np.testing.assert_allclose(corners[1], [[0, 2], [0, 4], [2, 4], [2, 2]], atol=1e-15)


def test_a_bundles_sheet_is_centred_on_the_origin_and_holds_all_markers():
    board = bundle((5.0, -2.0, 0.0), (1.0, 3.0, 0.0), size_m=2.0)
    assert board.sheet_size_m == (2 * 6.5, 2 * 4.5)


def test_duplicate_ids_in_a_bundle_are_rejected():
    duplicate = dataclasses.replace(PLACED, x_m=5.0)
    with pytest.raises(ValueError, match='markers: expected each id once, got 1 2 times'):
        Bundle(markers=(PLACED, duplicate), dictionary='DICT_4X4_50')


@pytest.mark.parametrize(
    'place',
    [
        (0.0, 0.0, 0.0),
        (0.99, 0.0, 0.0),
        (1.0, 0.0, 0.0),  # no white between them
        (0.0, -1.0, 90.0),
        (0.8, 0.8, 0.0),
        (0.8, 0.8, 45.0),  # corner in the middle of a side
        (1.2, 0.0, 45.0),
        (0.3, 0.2, 20.0),
    ],
    ids=str,
)
def test_overlapping_bundle_markers_are_rejected(place):
    apart = (9.0, 9.0, 0.0)
    with pytest.raises(ValueError, match=r'between any two, got 0 and 2, which touch or overlap'):
        bundle((0.0, 0.0, 0.0), apart, place)
    # Rotating the whole bundle changes nothing.
    x, y, angle = place
    rotated = (0.6 * x - 0.8 * y, 0.8 * x + 0.6 * y, angle + np.degrees(np.arctan2(0.8, 0.6)))
    with pytest.raises(ValueError, match='got 0 and 2'):
        bundle((0.0, 0.0, np.degrees(np.arctan2(0.8, 0.6))), apart, rotated)


@pytest.mark.parametrize(
    'place', [(1.001, 0.0, 0.0), (0.9, 0.9, 45.0), (1.208, 0.0, 45.0), (1.001, 1.001, 0.0)]
)
def test_bundle_markers_may_be_close(place):
    assert len(bundle((0.0, 0.0, 0.0), place).points) == 8


INVALID = [
    (Chessboard, {'columns': 2}, 'columns: expected an integer of at least 3, got 2'),
    (Chessboard, {'columns': True}, 'columns: expected an integer'),
    (Chessboard, {'rows': 6.0}, 'rows: expected an integer'),
    (Chessboard, {'square_m': -0.025}, 'square_m: expected a length > 0'),
    (Chessboard, {'square_m': float('nan')}, 'square_m: expected a length > 0'),
    (Chessboard, {'square_m': True}, 'square_m: expected a length > 0'),
    (Chessboard, {'square_m': '1'}, 'square_m: expected a length > 0'),
    (Chessboard, {'name': ' '}, 'name: expected a word'),
    (Charuco, {'marker_m': 0.035}, 'marker_m: expected less than square_m = 0.035'),
    (Charuco, {'legacy_pattern': 1}, 'legacy_pattern: expected true or false'),
    (Charuco, {'columns': 2}, 'columns: expected an integer of at least 3, got 2'),
    (Bundle, {'markers': ()}, 'markers: expected 1 to 2500, got 0'),
    (Bundle, {'name': 7}, 'name: expected a word'),
    (PlacedMarker, {'id': True}, 'id: expected an integer of at least 0, got True'),
    (PlacedMarker, {'size_m': -1.0}, 'size_m: expected a length > 0'),
    (PlacedMarker, {'x_m': float('nan')}, 'x_m: expected a finite number, got nan'),
    (PlacedMarker, {'y_m': '1'}, "y_m: expected a finite number, got '1'"),
    (PlacedMarker, {'angle_deg': float('inf')}, 'angle_deg: expected a finite number, got inf'),
    (Marker, {'id': -1}, 'id: expected an integer of at least 0'),
    (Marker, {'dictionary': 4}, 'dictionary: expected the name of an OpenCV dictionary'),
    (Marker, {'size_m': 0}, 'size_m: expected a length > 0'),
    (MarkerGrid, {'separation_m': 0.0}, 'separation_m: expected a length > 0'),
    (MarkerGrid, {'first_id': 1.5}, 'first_id: expected an integer'),
    (MarkerGrid, {'columns': 1, 'rows': 1}, 'columns: expected at least two markers'),
    (MarkerGrid, {'rows': 1001}, 'rows: expected at most 1000, got 1001'),
    (Chessboard, {'columns': 10**9}, 'columns: expected at most 1000, got 1000000000'),
    (Chessboard, {'columns': 101, 'rows': 100}, 'columns: expected at most 10000 .* got 10100'),
]


@pytest.mark.parametrize(('kind', 'change', 'message'), INVALID)
def test_invalid_arguments_are_rejected(kind, change, message):
    valid = next(board for board in [*BOARDS.values(), PLACED] if type(board) is kind)
    with pytest.raises(ValueError, match=message):
        dataclasses.replace(valid, **change)
