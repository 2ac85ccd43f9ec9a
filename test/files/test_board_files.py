# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""Board files: units, merge keys, and one-line errors that name the key."""

from pathlib import Path
from typing import get_args

from p4pfr_ros.boards import AprilGrid, Board, Bundle, Chessboard, Marker, PlacedMarker
from p4pfr_ros.files.boards import load_board, load_boards
from p4pfr_ros.files.yaml_fields import ConfigError
import pytest

SHIPPED = Path(__file__).parents[2] / 'config/boards'

CHESSBOARD = """
boards:
  wall:
    type: chessboard
    columns: 9
    rows: 6
    square_m: 0.025
"""
TAG = """
boards:
  tag: {type: marker, id: 5, size_mm: 150, dictionary: DICT_APRILTAG_36h11}
"""
BUNDLE = """
boards:
  dock:
    type: bundle
    dictionary: DICT_APRILTAG_36h11
    markers:
      - {id: 7, x_mm: -100, y_m: 0, size_mm: 80}
      - {id: 3, x_m: 0.1, y_mm: 20, size_m: 0.05, angle_deg: 30}
"""


@pytest.fixture
def write(tmp_path):
    """Return a function that writes a board file and returns its path."""

    def write_file(text):
        path = tmp_path / 'boards.yaml'
        path.write_bytes(text if isinstance(text, bytes) else text.encode())
        return path

    return write_file


def test_a_board_is_loaded_with_its_name(write):
    board = load_board(write(CHESSBOARD))
    assert board == Chessboard(columns=9, rows=6, square_m=0.025, name='wall')


def test_millimetres_are_converted_to_the_last_digit(write):
    for mm in (25, 26, 0.1, 12.5):
        text = CHESSBOARD.replace('square_m: 0.025', f'square_mm: {mm}')
        assert load_board(write(text)).square_m == float(f'{mm / 1000:.6g}')


@pytest.mark.parametrize('length', ['square_m: 25e-3', 'square_m: 2.5e-2', 'square_mm: 2.5e1'])
def test_powers_of_ten_are_numbers(write, length):
    """YAML 1.1 reads them as strings, as it requires a point and a sign."""
    board = load_board(write(CHESSBOARD.replace('square_m: 0.025', length)))
    assert board.square_m == 0.025
    dock = load_board(write(BUNDLE.replace('30}', '3e1}')))
    assert dock.markers[1].angle_deg == 30.0


def test_several_boards_keep_their_order(write):
    boards = load_boards(write(CHESSBOARD + TAG.split('boards:\n')[1]))
    assert list(boards) == ['wall', 'tag']
    assert boards['tag'] == Marker(id=5, size_m=0.15, dictionary='DICT_APRILTAG_36h11', name='tag')


def test_merge_keys_are_supported(write):
    """From one board or several; explicit values take precedence."""
    boards = load_boards(
        write(
            """
boards:
  a: &a {type: chessboard, columns: 9, rows: 6, square_m: 0.025}
  b: &b {<<: *a, rows: 7}
  c: {columns: 8, square_m: 25.0e-3, <<: [*b, *a]}
"""
        )
    )
    assert boards['b'] == Chessboard(columns=9, rows=7, square_m=0.025, name='b')
    assert boards['c'] == Chessboard(columns=8, rows=7, square_m=0.025, name='c')


def test_the_markers_of_a_bundle_are_loaded_with_their_positions(write):
    dock = load_board(write(BUNDLE))
    markers = (
        PlacedMarker(id=7, x_m=-0.1, y_m=0.0, size_m=0.08),
        PlacedMarker(id=3, x_m=0.1, y_m=0.02, size_m=0.05, angle_deg=30),
    )
    assert dock == Bundle(markers=markers, dictionary='DICT_APRILTAG_36h11', name='dock')


def combined(*files):
    """Return one file with the boards of several."""
    return 'boards:\n' + ''.join(text.split('boards:\n')[1] for text in files)


def test_distinguishable_boards_may_share_a_file(write):
    other = BUNDLE.replace('dock', 'far').replace('36h11', '25h9')
    wall = CHESSBOARD.replace('wall', 'floor').replace('9', '8')
    boards = load_boards(write(combined(CHESSBOARD, wall, TAG, BUNDLE, other)))
    assert list(boards) == ['wall', 'floor', 'tag', 'dock', 'far']


def test_load_board_expects_one_board(write):
    path = write(CHESSBOARD + TAG.split('boards:\n')[1])
    with pytest.raises(ConfigError, match='boards: expected one board, got 2: wall, tag'):
        load_board(path)


def test_every_type_has_an_example_file():
    kinds = {type(load_board(path)) for path in SHIPPED.glob('*.yaml')}
    assert kinds == set(get_args(Board))
    chessboard = load_board(SHIPPED / 'chessboard_9x6_25mm.yaml')
    assert chessboard == Chessboard(columns=9, rows=6, square_m=0.025)


KALIBR = """
target_type: 'aprilgrid' #gridtype
tagCols: 6               #number of apriltags
tagRows: 5
tagSize: 0.088           #size of apriltag, edge to edge [m]
tagSpacing: 0.3          #ratio of space between tags to tagSize
codeOffset: 10
"""
APRILGRID = """
boards:
  wall: {type: aprilgrid, tagCols: 6, tagRows: 5, tagSize: 0.088, tagSpacing: 0.3}
"""


def test_kalibrs_target_file_is_a_board_file(write):
    expected = AprilGrid(columns=6, rows=5, tag_m=0.088, spacing=0.3, first_id=10)
    assert load_board(write(KALIBR)) == expected
    assert expected.border_bits == 2  # as Kalibr prints


def test_an_aprilgrid_has_kalibrs_keys_and_those_of_marker_boards(write):
    board = load_board(write(APRILGRID.replace('}', ', border_bits: 1, first_id: 3}')))
    assert board == AprilGrid(
        columns=6, rows=5, tag_m=0.088, spacing=0.3, first_id=3, border_bits=1, name='wall'
    )


def test_border_and_colours_are_keys_of_boards_with_markers(write):
    text = TAG.replace('}', ', border_bits: 2, inverted: any}')
    assert load_board(write(text)) == Marker(
        id=5,
        size_m=0.15,
        dictionary='DICT_APRILTAG_36h11',
        border_bits=2,
        inverted='any',
        name='tag',
    )


WRONG = {
    'empty': ('', "expected a key 'boards', got an empty file"),
    'scalar': ('9x6', "expected a key 'boards', got '9x6'"),
    'list': ('- a\n- b', r"expected a key 'boards', got \['a', 'b'\]"),
    'no boards': ('boards:', 'boards: expected names of boards, got nothing'),
    'top key': ('board: {}', r'board: unknown key, .*did you mean boards\?'),
    'board is a word': (
        'boards: {wall: chessboard}',
        "boards.wall: expected keys such as type, got 'chessboard'",
    ),
    'name': ('boards: {7: {type: marker}}', 'boards.7: expected a word as the name, got 7'),
    'no type': (CHESSBOARD.replace('type: chessboard', ''), 'boards.wall.type: expected one of'),
    'type': (
        CHESSBOARD.replace('chessboard', 'chesboard'),
        r"boards.wall.type: .*got 'chesboard' \(did you mean chessboard\?\)",
    ),
    'unknown key': (
        CHESSBOARD.replace('columns', 'colums'),
        r'boards.wall.colums: unknown key, .*did you mean columns\?',
    ),
    'missing key': (CHESSBOARD.replace('rows: 6', ''), 'boards.wall.rows: expected a value'),
    'missing length': (
        CHESSBOARD.replace('square_m: 0.025', ''),
        r'boards.wall.square_m: expected a value, got none \(or square_mm, in millimetres\)',
    ),
    'no unit': (
        CHESSBOARD.replace('square_m', 'square'),
        'boards.wall.square: expected a unit: square_m or square_mm',
    ),
    'both units': (CHESSBOARD + '    square_mm: 25', 'expected one of square_m and square_mm'),
    'negative': (
        CHESSBOARD.replace('square_m: 0.025', 'square_mm: -25'),
        'boards.wall.square_mm: expected a length > 0 in mm, got -25',
    ),
    'zero': (TAG.replace('150', '0'), 'boards.tag.size_mm: expected a length > 0 in mm, got 0'),
    'nan': (CHESSBOARD.replace('0.025', '.nan'), 'boards.wall.square_m: expected a length > 0'),
    'bool': (CHESSBOARD.replace('0.025', 'yes'), 'boards.wall.square_m: .*got True'),
    'text length': (CHESSBOARD.replace('0.025', '25 mm'), "boards.wall.square_m: .*got '25 mm'"),
    'not a power': (CHESSBOARD.replace('0.025', '25e'), r"boards.wall.square_m: .*got '25e'"),
    'huge': (
        CHESSBOARD.replace('0.025', '1' + 400 * '0'),
        r"boards.wall.square_m: expected a length > 0 in m, got '10+\.\.\.",
    ),
    'too many': (CHESSBOARD.replace('9', '1000000000'), 'boards.wall.columns: expected at most'),
    'bool count': (CHESSBOARD.replace('6', 'true'), 'boards.wall.rows: expected an integer'),
    'dictionary': (
        TAG.replace('36h11', '36h12'),
        r"boards.tag.dictionary: .*got 'DICT_APRILTAG_36h12' \(did you mean DICT_APRILTAG_36h1",
    ),
    'id': (TAG.replace('5', '587', 1), 'boards.tag.id: expected ids up to 586, .*got 587'),
    'duplicate': (CHESSBOARD + '    rows: 7', r"line 8: .*duplicate key 'rows'"),
    'same board twice': (
        CHESSBOARD + '  door: {type: chessboard, columns: 6, rows: 9, square_mm: 40}',
        'boards.door: expected a pattern that no other board shares, got a chessboard of 9x6 '
        'corners, also in boards.wall',
    ),
    'same marker twice': (
        BUNDLE + TAG.replace('boards:\n', '').replace('5', '3', 1),
        'boards.tag: .*, got marker 3 of DICT_APRILTAG_36H11, also in boards.dock',
    ),
    'same marker in two sizes of a dictionary': (
        """boards:
  a: {type: charuco, columns: 5, rows: 4, square_mm: 30, marker_mm: 20, dictionary: DICT_4X4_50}
  b: {type: marker, id: 9, size_mm: 30, dictionary: DICT_4X4_1000}""",
        'boards.b: .*, got marker 9 of DICT_4X4, also in boards.a',
    ),
    'no marker': (BUNDLE.split('      -')[0], r'boards.dock.markers: .* list of markers, got not'),
    'empty markers': (
        BUNDLE.split('\n      -')[0] + ' []',
        'boards.dock.markers: expected 1 to 2500, got 0',
    ),
    'no markers': (
        BUNDLE.split('    markers')[0],
        'boards.dock.markers: expected a value, got none$',
    ),
    'marker is a word': (
        BUNDLE + '      - 8',
        r'boards.dock.markers\[2\]: expected keys such as id',
    ),
    'unknown key of a marker': (
        BUNDLE.replace('angle_deg', 'angle'),
        r'boards.dock.markers\[1\].angle: unknown key, .*did you mean angle_deg\?',
    ),
    'type of a marker': (
        BUNDLE.replace('{id: 3', '{type: marker, id: 3'),
        r'boards.dock.markers\[1\].type: unknown key, expected one of id, x_m, y_m, size_m, ',
    ),
    'no position': (
        BUNDLE.replace('x_m: 0.1, ', ''),
        r'boards.dock.markers\[1\].x_m: expected a value, got none \(or x_mm, in millimetres\)',
    ),
    'no unit of a position': (
        BUNDLE.replace('x_m:', 'x:'),
        r'boards.dock.markers\[1\].x: expected a unit: x_m or x_mm, got x',
    ),
    'position is text': (
        BUNDLE.replace('x_m: 0.1', 'x_m: left'),
        r"boards.dock.markers\[1\].x_m: expected a finite coordinate in m, got 'left'",
    ),
    'negative size': (
        BUNDLE.replace('80', '-80'),
        r'boards.dock.markers\[0\].size_mm: expected a length > 0 in mm, got -80',
    ),
    'angle is text': (
        BUNDLE.replace('30}', 'up}'),
        r"boards.dock.markers\[1\].angle_deg: expected a finite number, got 'up'",
    ),
    'id of a marker': (
        BUNDLE.replace('id: 3', 'id: 587'),
        'boards.dock.markers: expected ids up to 586, .*got 587',
    ),
    'id twice': (
        BUNDLE.replace('id: 3', 'id: 7'),
        'boards.dock.markers: expected each id once, got 7 2 times',
    ),
    'overlap': (
        BUNDLE.replace('x_m: 0.1', 'x_m: -0.1'),
        'boards.dock.markers: expected white between any two, got 7 and 3',
    ),
    'no tagRows': (KALIBR.replace('tagRows', '#'), 'tagRows: expected a value, got none'),
    'tagRows': (KALIBR.replace('5', '5.5'), 'tagRows: expected an integer of at least 1, got 5.5'),
    'tagSize': (APRILGRID.replace('0.088', '-1'), 'boards.wall.tagSize: expected a length > 0'),
    'tagSpacing': (KALIBR.replace('0.3', '30'), 'tagSpacing: expected a number above 0, up to 1'),
    'two first ids': (KALIBR + 'first_id: 3', 'codeOffset: expected one of codeOffset and first'),
    'other target': (
        "{target_type: 'checkerboard', targetCols: 6}",
        "target_type: expected 'aprilgrid', got 'checkerboard': describe other targets",
    ),
    'border': (TAG.replace('}', ', border_bits: 0}'), 'border_bits: expected an integer from 1'),
    'inverted': (TAG.replace('}', ', inverted: both}'), 'inverted: expected true, false or any'),
    'circles touch': (
        'boards: {c: {type: circle_grid, columns: 4, rows: 5, spacing_mm: 20, diameter_mm: 20}}',
        'boards.c.diameter_m: expected less than the distance of two circles',
    ),
    'same circles twice': (
        """boards:
  a: &a {type: circle_grid, columns: 4, rows: 5, spacing_mm: 20, diameter_mm: 10}
  b: {<<: *a, spacing_mm: 30}""",
        'boards.b: .*, got a symmetric grid of 4x5 circles, also in boards.a',
    ),
    'not yaml': ('boards: [', r'line \d: expected YAML'),
    'tab': ('boards:\n\twall: 1', 'line 2: expected YAML'),
    'python object': ('boards: !!python/object:os.system {}', 'expected YAML: could not'),
    'no date': ('boards: 2026-13-45', "boards: expected names of boards, got '2026-13-45'"),
    'binary': (b'\xff\xfe\x00', 'expected'),
    'unhashable key': ('? [a]\n: 1', 'expected YAML'),
}


@pytest.mark.parametrize(('text', 'message'), WRONG.values(), ids=WRONG)
def test_a_wrong_file_is_reported_in_one_line_with_the_key(write, text, message):
    path = write(text)
    with pytest.raises(ConfigError, match=message) as caught:
        load_boards(path)
    assert str(caught.value).startswith(str(path))
    assert '\n' not in str(caught.value)


def test_a_missing_file_is_reported(tmp_path):
    with pytest.raises(ConfigError, match=r'none.yaml: expected a readable file: No such file'):
        load_board(tmp_path / 'none.yaml')
    with pytest.raises(ConfigError, match='expected a regular file, got a directory'):
        load_board(tmp_path)
