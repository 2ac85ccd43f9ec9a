# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

import struct

from board_views import BOARDS, CAMERAS, seen_from, SIZE
import cv2
import numpy as np
from p4pfr_ros.files.boards import ConfigError
from p4pfr_ros.files.images import read_image, write_image
from p4pfr_ros.rendering import render
import pytest

PICTURE = render(BOARDS['charuco'], CAMERAS['strong'], seen_from(0.4, (0.3, 0.2), 0.2), SIZE)


def test_pictures_are_read_as_they_were_written(tmp_path):
    colour = np.random.default_rng(3).integers(0, 256, (31, 17, 3), dtype=np.uint8)
    write_image(tmp_path / 'a.png', colour)
    np.testing.assert_array_equal(read_image(tmp_path / 'a.png'), colour)
    write_image(tmp_path / 'b.jpg', PICTURE)
    back = read_image(tmp_path / 'b.jpg')
    assert back.shape == (480, 640, 3)
    assert np.abs(back[..., 0].astype(int) - PICTURE).mean() < 2.0


@pytest.mark.parametrize('ending', ['png', 'jpg'])
def test_a_picture_cut_short_is_refused(tmp_path, ending, capfd):
    whole = tmp_path / f'whole.{ending}'
    write_image(whole, PICTURE)
    for kept in (0.02, 0.5, 0.98):
        short = tmp_path / f'short.{ending}'
        short.write_bytes(whole.read_bytes()[: int(kept * whole.stat().st_size)])
        with pytest.raises(ConfigError, match='expected a whole picture'):
            read_image(short)
    assert capfd.readouterr() == ('', '')


def with_exif(jpeg, exif):
    """Put an EXIF segment, as a camera writes it, behind a JPEG's beginning."""
    content = b'Exif\0\0' + exif
    return jpeg[:2] + b'\xff\xe1' + struct.pack('>H', 2 + len(content)) + content + jpeg[2:]


def test_the_end_of_a_thumbnail_is_not_that_of_the_picture(tmp_path):
    path = tmp_path / 'a.jpg'
    write_image(path, PICTURE[::8, ::8])
    thumbnail = path.read_bytes()
    write_image(path, PICTURE)
    plain = read_image(path)
    whole = with_exif(path.read_bytes(), thumbnail)
    path.write_bytes(whole)
    np.testing.assert_array_equal(read_image(path), plain)
    for kept in (100, len(thumbnail) + 100, len(whole) - 2):
        path.write_bytes(whole[:kept])
        with pytest.raises(ConfigError, match='expected a whole picture'):
            read_image(path)


def test_a_rotation_noted_in_the_file_is_not_applied(tmp_path):
    path = tmp_path / 'a.jpg'
    write_image(path, PICTURE)
    plain = read_image(path)
    # A directory with one entry: orientation (0x112), one short, 6: a quarter turn.
    entry = struct.pack('<HHIHH', 0x112, 3, 1, 6, 0)
    tiff = b'II*\0' + struct.pack('<IH', 8, 1) + entry + bytes(4)
    path.write_bytes(with_exif(path.read_bytes(), tiff))
    assert cv2.imread(str(path)).shape == (640, 480, 3)
    np.testing.assert_array_equal(read_image(path), plain)


def test_what_is_no_picture_is_refused(tmp_path, capfd):
    for name, data in (
        ('text.png', b'hello'),
        ('empty.jpg', b''),
        ('p.png', b'\x89PNG\r\n\x1a\n'),
    ):
        (tmp_path / name).write_bytes(data)
        with pytest.raises(ConfigError, match=f'{name}: expected a '):
            read_image(tmp_path / name)
    with pytest.raises(ConfigError, match=r'none\.png: expected a readable picture: No such file'):
        read_image(tmp_path / 'none.png')
    with pytest.raises(ConfigError, match=r'expected a name that ends in \.png or \.jpg'):
        write_image(tmp_path / 'a.xyz', PICTURE)
    with pytest.raises(ConfigError, match='expected a place to write to: No such file'):
        write_image(tmp_path / 'none/a.png', PICTURE)
    assert capfd.readouterr() == ('', '')
