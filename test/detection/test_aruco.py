# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

from board_views import BOARDS
import cv2
import numpy as np
from p4pfr_ros.boards import Bundle, Charuco, Marker, MarkerGrid, PlacedMarker
from p4pfr_ros.boards.parts import code_family
from p4pfr_ros.detection.aruco import check_markers, detect_markers, dictionary_names, marker_cells
from p4pfr_ros.rendering.pattern import black_shapes
from p4pfr_ros.rendering.rasterizer import coverage
import pytest

HAS_CLASSES = hasattr(cv2.aruco, 'ArucoDetector')
DICTIONARY = 'DICT_4X4_50'


def enlarged(cells, px_per_cell, margin_px):
    """Return an image of a marker's cells, black on white."""
    white = 255 * (1 - cells.astype(np.uint8))
    return np.pad(
        np.kron(white, np.ones((px_per_cell, px_per_cell), np.uint8)),
        margin_px,
        constant_values=255,
    )


@pytest.mark.parametrize('name', ['DICT_4X4_50', 'DICT_6X6_250', 'DICT_APRILTAG_36h11'])
def test_an_image_of_a_markers_cells_is_detected(name):
    corners, ids, _ = detect_markers(enlarged(marker_cells(name, 17), 10, 40), name)
    side = 10 * len(marker_cells(name, 17))
    assert ids.tolist() == [17]
    expected = 39.5 + side * np.array([[0, 0], [1, 0], [1, 1], [0, 1]])
    np.testing.assert_allclose(corners[0], expected, atol=1.5)


@pytest.mark.parametrize('white_px', [10, 20])
@pytest.mark.parametrize('grey_px', [1, 2])
def test_a_sheet_that_touches_the_border_does_not_take_its_marker_along(white_px, grey_px):
    """The outlines of marker and sheet are a group to OpenCV, which it drops with the sheet."""
    cells = marker_cells('DICT_APRILTAG_36h11', 17)
    image = np.pad(enlarged(cells, 10, white_px), grey_px, constant_values=110)
    corners, ids, _ = detect_markers(image, 'DICT_APRILTAG_36h11')
    assert ids.tolist() == [17]
    np.testing.assert_allclose(corners[0][0], white_px + grey_px - 0.5, atol=1.5)


def test_a_marker_that_touches_the_border_is_not_reported():
    """The border may cut it."""
    image = enlarged(marker_cells(DICTIONARY, 17), 10, 2)
    for shown in (image, image[4:, 4:]):
        corners, ids, quads = detect_markers(np.ascontiguousarray(shown), DICTIONARY)
        assert (len(corners), len(ids)) == (0, 0)
        assert (quads >= 3.0).all()


def test_cells_have_a_black_border_around_the_code():
    cells = marker_cells(DICTIONARY, 0)
    assert cells.shape == (6, 6)
    assert cells[0].all()
    assert cells[-1].all()
    assert cells[:, 0].all()
    assert cells[:, -1].all()
    # Code of marker 0 of the dictionary; 1 is white.
    code = [[1, 0, 1, 1], [0, 1, 0, 1], [0, 0, 1, 1], [0, 0, 1, 0]]
    np.testing.assert_array_equal(~cells[1:-1, 1:-1], code)


def test_an_apriltag_is_upright():
    """The cells match AprilTag's own image, in whichever orientation OpenCV stores them."""
    cells = ~marker_cells('DICT_APRILTAG_36h11', 0)[1:-1, 1:-1]
    # Code of tag 0 as AprilTag publishes it: row by row from the top left.
    bits = f'{0xD5D628584:036b}'
    assert ''.join(str(int(cell)) for cell in cells.ravel()) == bits


def test_an_image_without_markers_gives_empty_arrays():
    corners, ids, _ = detect_markers(np.full((100, 100), 90, np.uint8), DICTIONARY)
    assert corners.shape == (0, 4, 2)
    assert ids.shape == (0,)


def test_unknown_dictionary_is_rejected_with_a_suggestion():
    assert DICTIONARY in dictionary_names()
    board = Marker(id=0, size_m=0.1, dictionary='DICT_4X4_5O')
    with pytest.raises(ValueError, match=r"got 'DICT_4X4_5O' \(did you mean DICT_4X4_50\?\)"):
        check_markers(board)


def test_ids_beyond_the_dictionary_are_rejected():
    grid = {'columns': 5, 'rows': 4, 'marker_m': 0.1, 'separation_m': 0.1}
    check_markers(MarkerGrid(**grid, dictionary=DICTIONARY, first_id=30))
    with pytest.raises(ValueError, match=r'first_id: expected ids up to 49, .*got 50'):
        check_markers(MarkerGrid(**grid, dictionary=DICTIONARY, first_id=31))
    with pytest.raises(ValueError, match=r'markers: expected ids up to 49, .*got 50'):
        check_markers(
            Bundle(
                markers=tuple(
                    PlacedMarker(id=n, x_m=float(n), y_m=0.0, size_m=0.5) for n in (3, 50, 7)
                ),
                dictionary=DICTIONARY,
            )
        )
    with pytest.raises(ValueError, match='id: expected ids up to 49'):
        check_markers(Marker(id=50, size_m=0.1, dictionary=DICTIONARY))
    with pytest.raises(ValueError, match='columns: expected ids up to 49'):
        check_markers(
            Charuco(columns=11, rows=10, square_m=1, marker_m=0.5, dictionary=DICTIONARY)
        )


@pytest.mark.parametrize('bits', [4, 5, 6, 7])
def test_a_large_dictionary_begins_with_the_smaller_ones(bits):
    """Boards from both can have the same markers, so they share a code family."""
    sizes = (50, 100, 250, 1000)
    names = [f'DICT_{bits}X{bits}_{size}' for size in sizes]
    for name, size in zip(names, sizes, strict=True):
        for marker_id in (0, 17, size - 1):
            np.testing.assert_array_equal(
                marker_cells(name, marker_id), marker_cells(names[-1], marker_id)
            )
    assert {code_family(name) for name in names} == {f'DICT_{bits}X{bits}'}


def test_other_dictionaries_are_code_families_of_their_own():
    names = [name for name in dictionary_names() if 'APRILTAG' in name.upper()]
    assert len({code_family(name) for name in names}) == len({name.upper() for name in names})
    assert code_family('DICT_ARUCO_ORIGINAL') == 'DICT_ARUCO_ORIGINAL'


def test_pattern_of_a_marker_beyond_the_dictionary_is_rejected():
    with pytest.raises(ValueError, match='id: expected ids up to 49'):
        black_shapes(Marker(id=50, size_m=0.1, dictionary=DICTIONARY))


def opencv_charuco(board, size_px):
    """Return OpenCV's image of a ChArUco board."""
    dictionary = cv2.aruco.getPredefinedDictionary(getattr(cv2.aruco, board.dictionary))
    lengths = board.square_m, board.marker_m
    if not HAS_CLASSES:
        make = cv2.aruco.CharucoBoard_create
        return make(board.columns, board.rows, *lengths, dictionary).draw(size_px)
    charuco = cv2.aruco.CharucoBoard((board.columns, board.rows), *lengths, dictionary)
    charuco.setLegacyPattern(board.legacy_pattern)
    return charuco.generateImage(size_px)


@pytest.mark.parametrize('legacy', [False, True])
@pytest.mark.parametrize(('columns', 'rows'), [(7, 5), (7, 6), (6, 5), (6, 6)])
def test_charuco_pattern_equals_that_of_opencv(columns, rows, legacy):
    if legacy and rows % 2 == 0 and not HAS_CLASSES:
        pytest.skip('OpenCV 4.6 draws the new pattern only')
    board = Charuco(
        columns=columns,
        rows=rows,
        square_m=0.04,
        marker_m=0.03,
        dictionary=DICTIONARY,
        legacy_pattern=legacy,
    )
    size_px = 80 * columns, 80 * rows
    image = 255.0 * (1.0 - black_coverage(board, 2000.0, size_px))
    np.testing.assert_allclose(image, opencv_charuco(board, size_px), atol=1e-9)


def black_coverage(board, px_per_m, size_px):
    """Return the black coverage of each pixel in a head-on image of the pattern."""
    corners = px_per_m * black_shapes(board) * [1, -1] + 0.5 * np.array(size_px) - 0.5
    sides = np.concatenate([corners, np.roll(corners, -1, axis=1)], axis=2)
    return coverage(sides.reshape(-1, 4), size_px)


@pytest.mark.parametrize('name', BOARDS)
def test_quads_are_clockwise_and_do_not_overlap(name):
    board = BOARDS[name]
    size_px = tuple(int(2000 * side) for side in board.sheet_size_m)
    black = black_coverage(board, 2000.0, size_px)
    x, y = np.moveaxis(black_shapes(board), -1, 0)
    areas = -0.5 * (x * np.roll(y, -1, axis=1) - y * np.roll(x, -1, axis=1)).sum(axis=1)
    assert (areas > 0.0).all()
    assert black.max() < 1.0 + 1e-9
    assert black.sum() == pytest.approx(2000.0**2 * areas.sum())


@pytest.mark.parametrize('pattern', ['fence', 'tiles'])
def test_cells_of_a_pattern_are_not_compared_with_each_other(pattern):
    """That takes seconds; a marker in front of them is found all the same."""
    y, x = np.mgrid[:480, :640]
    is_dark = (x % 10 < 2) | (y % 10 < 2) if pattern == 'fence' else (x // 12 + y // 12) % 2 == 0
    image = np.where(is_dark, 40, 200).astype(np.uint8)
    corners, _, quads = detect_markers(image, 'DICT_4X4_50')
    assert len(corners) == 0
    assert len(quads) < 100
    cells = np.kron(marker_cells('DICT_4X4_50', 3), np.ones((10, 10), bool))
    image[200:280, 300:380] = 200
    image[210:270, 310:370] = np.where(cells, 40, 200)
    assert detect_markers(image, 'DICT_4X4_50')[1].tolist() == [3]
