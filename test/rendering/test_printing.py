# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""Printed boards are to scale, and wrong output files are reported."""

import re
import struct
import zlib

from board_views import BOARDS
import numpy as np
from p4pfr_ros.boards import Marker
from p4pfr_ros.detection import detect
from p4pfr_ros.files.images import read_image
from p4pfr_ros.files.yaml_fields import ConfigError
from p4pfr_ros.rendering.pattern import black_shapes
from p4pfr_ros.rendering.printing import describe, print_board
import pytest

BOARD = BOARDS['charuco']


@pytest.mark.parametrize('name', BOARDS)
def test_a_printed_png_is_to_scale(tmp_path, name):
    board, dpi, path = BOARDS[name], 150.0, tmp_path / 'board.png'
    print_board(board, path, dpi=dpi)
    x_per_m, y_per_m, unit = struct.unpack('>IIB', chunk(path.read_bytes(), b'pHYs'))
    assert (x_per_m, y_per_m, unit) == (round(dpi / 0.0254), round(dpi / 0.0254), 1)
    detection = detect(read_image(path), board)
    np.testing.assert_array_equal(detection.ids, np.arange(len(board.points)))
    px_per_m = dpi / 0.0254
    middle = 0.5 * np.array(read_image(path).shape[1::-1]) - 0.5
    truth = middle + px_per_m * board.points * [1.0, -1.0]
    assert np.abs(detection.image_points - truth).max() < 0.2


def chunk(png, name):
    """Return the data of a chunk of a PNG."""
    at = png.index(name)
    (length,) = struct.unpack('>I', png[at - 4 : at])
    return png[at + 4 : at + 4 + length]


@pytest.mark.parametrize('name', BOARDS)
def test_a_printed_pdf_is_to_scale(tmp_path, name):
    board, path = BOARDS[name], tmp_path / 'board.pdf'
    print_board(board, path)
    data = path.read_bytes()
    box = re.search(rb'/MediaBox \[ *0 0 ([\d.]+) ([\d.]+) *\]', data)
    points_per_m = 72.0 / 0.0254
    page = np.array([float(side) for side in box.groups()])
    np.testing.assert_allclose(page, points_per_m * np.array(board.sheet_size_m), rtol=1e-6)
    # In the page's content, each quad starts with "x y m", its first corner.
    starts = [
        [float(n) for n in corner]
        for content in streams(data)
        for corner in re.findall(rb'([\d.-]+) ([\d.-]+) m\n', content)
    ]
    expected = 0.5 * page + points_per_m * black_shapes(board)[:, 0]
    for corner in expected:
        assert np.abs(np.array(starts) - corner).max(axis=1).min() < 1e-3
    print_board(board, tmp_path / 'again.pdf')
    assert (tmp_path / 'again.pdf').read_bytes() == data


def streams(pdf):
    """Yield the decompressed streams of a PDF."""
    for found in re.finditer(rb'stream\r?\n(.*?)endstream', pdf, re.DOTALL):
        try:
            yield zlib.decompress(found[1])
        except zlib.error:
            continue


def test_wrong_output_files_are_reported(tmp_path):
    with pytest.raises(ConfigError, match=r'board.svg: expected .* .pdf or .png'):
        print_board(BOARD, tmp_path / 'board.svg')
    with pytest.raises(ConfigError, match=r'board.pdf: expected .*: No such file'):
        print_board(BOARD, tmp_path / 'none/board.pdf')
    with pytest.raises(ConfigError, match=r'expected at most 30000 px a side, got \d+: use .pdf'):
        print_board(BOARD, tmp_path / 'board.png', dpi=1e5)
    with pytest.raises(ValueError, match='dpi must be > 0'):
        print_board(BOARD, tmp_path / 'board.png', dpi=0.0)


def test_names_with_any_characters_are_printed(tmp_path):
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
