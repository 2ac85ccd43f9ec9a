# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

from pathlib import Path

from p4pfr_ros.boards import Bundle, Charuco, Chessboard, Marker, MarkerGrid, PlacedMarker
from p4pfr_ros.files.boards import ConfigError, load_board, load_boards
import pytest

READY = Path(__file__).parents[2] / 'config/boards'

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
    """Write a board file, and return its path."""

    def written(text):
        path = tmp_path / 'boards.yaml'
        path.write_bytes(text if isinstance(text, bytes) else text.encode())
        return path

    return written


def test_a_board_is_read_with_its_name(write):
    board = load_board(write(CHESSBOARD))
    assert board == Chessboard(columns=9, rows=6, square_m=0.025, name='wall')


def test_millimetres_are_metres_to_the_last_digit(write):
    for mm in (25, 26, 0.1, 12.5):
        text = CHESSBOARD.replace('square_m: 0.025', f'square_mm: {mm}')
        assert load_board(write(text)).square_m == float(f'{mm / 1000:.6g}')


def test_several_boards_keep_their_order(write):
    boards = load_boards(write(CHESSBOARD + TAG.split('boards:\n')[1]))
    assert list(boards) == ['wall', 'tag']
    assert boards['tag'] == Marker(id=5, size_m=0.15, dictionary='DICT_APRILTAG_36h11', name='tag')


def test_a_board_may_take_over_what_another_says(write):
    """YAML's merge key, of one board or several; what is written itself comes first."""
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


def test_a_bundles_markers_are_read_with_their_places(write):
    dock = load_board(write(BUNDLE))
    markers = (
        PlacedMarker(id=7, x_m=-0.1, y_m=0.0, size_m=0.08),
        PlacedMarker(id=3, x_m=0.1, y_m=0.02, size_m=0.05, angle_deg=30),
    )
    assert dock == Bundle(markers=markers, dictionary='DICT_APRILTAG_36h11', name='dock')


def together(*files):
    """Write the boards of several files into one."""
    return 'boards:\n' + ''.join(text.split('boards:\n')[1] for text in files)


def test_boards_that_a_picture_tells_apart_may_share_a_file(write):
    other = BUNDLE.replace('dock', 'far').replace('36h11', '25h9')
    wall = CHESSBOARD.replace('wall', 'floor').replace('9', '8')
    boards = load_boards(write(together(CHESSBOARD, wall, TAG, BUNDLE, other)))
    assert list(boards) == ['wall', 'floor', 'tag', 'dock', 'far']


def test_one_board_is_expected_where_one_is_read(write):
    path = write(CHESSBOARD + TAG.split('boards:\n')[1])
    with pytest.raises(ConfigError, match='boards: expected one board, got 2: wall, tag'):
        load_board(path)


def test_every_kind_has_a_file_that_is_ready_to_use():
    kinds = {type(load_board(path)) for path in READY.glob('*.yaml')}
    assert kinds == {Chessboard, Charuco, Marker, MarkerGrid, Bundle}
    photographed = load_board(READY / 'chessboard_9x6_25mm.yaml')
    assert photographed == Chessboard(columns=9, rows=6, square_m=0.025)


WRONG = {
    'empty': ('', "expected a key 'boards', got an empty file"),
    'scalar': ('9x6', "expected a key 'boards', got '9x6'"),
    'list': ('- a\n- b', "expected a key 'boards', got a list"),
    'no boards': ('boards:', 'boards: expected names of boards, got nothing'),
    'top key': ('board: {}', r'board: unknown key, .*did you mean boards\?'),
    'board is a word': ('boards: {wall: chessboard}', 'boards.wall: expected keys such as type'),
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
    'power': (CHESSBOARD.replace('0.025', '25e-3'), r"got '25e-3' \(YAML wants 25.0e-3\)"),
    'power, mm': (
        CHESSBOARD.replace('square_m: 0.025', 'square_mm: 2.5e1'),
        r"boards.wall.square_mm: .*got '2.5e1' \(YAML wants 2.5e\+1\)",
    ),
    'too many': (CHESSBOARD.replace('9', '1000000000'), 'boards.wall.columns: expected at most'),
    'bool count': (CHESSBOARD.replace('6', 'true'), 'boards.wall.rows: expected an integer'),
    'dictionary': (
        TAG.replace('36h11', '36h12'),
        r"boards.tag.dictionary: .*got 'DICT_APRILTAG_36h12' \(did you mean DICT_APRILTAG_36h1",
    ),
    'id': (TAG.replace('5', '587', 1), 'boards.tag.id: expected ids up to 586, .*got 587'),
    'duplicate': (CHESSBOARD + '    rows: 7', r"line 8: .*the key 'rows' stands there twice"),
    'one board twice': (
        CHESSBOARD + '  door: {type: chessboard, columns: 6, rows: 9, square_mm: 40}',
        'boards.door: expected what no other board has, got a chessboard of 9x6 corners, '
        'which boards.wall has too',
    ),
    'one marker twice': (
        BUNDLE + TAG.replace('boards:\n', '').replace('5', '3', 1),
        'boards.tag: .*, got marker 3 of DICT_APRILTAG_36H11, which boards.dock has too',
    ),
    'one marker in two sizes of a dictionary': (
        """boards:
  a: {type: charuco, columns: 5, rows: 4, square_mm: 30, marker_mm: 20, dictionary: DICT_4X4_50}
  b: {type: marker, id: 9, size_mm: 30, dictionary: DICT_4X4_1000}""",
        'boards.b: .*, got marker 9 of DICT_4X4, which boards.a has too',
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
    'no place': (
        BUNDLE.replace('x_m: 0.1, ', ''),
        r'boards.dock.markers\[1\].x_m: expected a value, got none \(or x_mm, in millimetres\)',
    ),
    'no unit of a place': (
        BUNDLE.replace('x_m:', 'x:'),
        r'boards.dock.markers\[1\].x: expected a unit: x_m or x_mm, got x',
    ),
    'place is text': (
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
    'not yaml': ('boards: [', r'line \d: expected YAML'),
    'tab': ('boards:\n\twall: 1', 'line 2: expected YAML'),
    'python object': ('boards: !!python/object:os.system {}', 'expected YAML: could not'),
    'binary': (b'\xff\xfe\x00', 'expected'),
    'unhashable key': ('? [a]\n: 1', 'expected YAML'),
}


@pytest.mark.parametrize(('text', 'message'), WRONG.values(), ids=WRONG)
def test_a_wrong_file_is_one_line_that_says_where_and_what(write, text, message):
    path = write(text)
    with pytest.raises(ConfigError, match=message) as caught:
        load_boards(path)
    assert str(caught.value).startswith(str(path))
    assert '\n' not in str(caught.value)


def test_a_missing_file_is_named(tmp_path):
    with pytest.raises(ConfigError, match=r'none.yaml: expected a readable file: No such file'):
        load_board(tmp_path / 'none.yaml')
    with pytest.raises(ConfigError, match='Is a directory'):
        load_board(tmp_path)
