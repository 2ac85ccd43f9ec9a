# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""Image files: pixels are preserved; damaged files and wrong names are reported."""

import struct

from board_views import BOARDS, CAMERAS, seen_from, SIZE
import cv2
import numpy as np
from p4pfr_ros.files.image_headers import is_image, size_of
from p4pfr_ros.files.images import decode_image, read_image, write_image
from p4pfr_ros.files.yaml_fields import ConfigError
from p4pfr_ros.rendering import render
import pytest

IMAGE = render(BOARDS['charuco'], CAMERAS['strong'], seen_from(0.4, (0.3, 0.2), 0.2), SIZE)


def test_images_are_read_as_written(tmp_path):
    colour = np.random.default_rng(3).integers(0, 256, (31, 17, 3), dtype=np.uint8)
    write_image(tmp_path / 'a.png', colour)
    np.testing.assert_array_equal(read_image(tmp_path / 'a.png'), colour)
    write_image(tmp_path / 'b.jpg', IMAGE)
    back = read_image(tmp_path / 'b.jpg')
    assert back.shape == (480, 640)  # grey stays grey
    assert np.abs(back.astype(int) - IMAGE).mean() < 2.0


@pytest.mark.parametrize('ending', ['png', 'jpg', 'bmp', 'webp', 'tiff', 'pgm', 'ppm'])
@pytest.mark.parametrize('size', [(640, 480), (37, 1), (300, 257)])
def test_sizes_are_read_from_the_header(ending, size):
    """The first 200 bytes are enough; no format is decoded to know its size."""
    width, height = size
    image = np.zeros((height, width, 3), np.uint8)
    data = cv2.imencode(f'.{ending}', image[..., 0] if ending == 'pgm' else image)[1].tobytes()
    assert size_of(data) == size
    for cut in (0, 3, 10, 20):
        assert size_of(data[:cut]) in (None, size)
    if ending != 'tiff':  # its header may stand at the end
        assert size_of(data[:1000]) == size


def test_bytes_between_the_segments_of_a_jpeg_are_skipped():
    """As decoders do."""
    data = cv2.imencode('.jpg', IMAGE)[1].tobytes()
    assert size_of(data[:2] + b'\0\0\xff' + data[2:]) == SIZE


def test_large_images_are_rejected_before_they_are_decoded(tmp_path, monkeypatch):
    """A small file with 100 megapixels."""
    path = tmp_path / 'bomb.png'
    path.write_bytes(cv2.imencode('.png', np.zeros((10000, 10000), np.uint8))[1].tobytes())
    assert path.stat().st_size < 200_000
    monkeypatch.delattr(cv2, 'imdecode')
    with pytest.raises(ConfigError, match=r'at most 64 megapixels .*got 100.0 \(10000x10000\)'):
        read_image(path)


def test_a_chunk_of_a_png_is_within_the_file():
    """A damaged length is not allocated: it states three gigabytes."""
    data = bytearray(cv2.imencode('.png', IMAGE)[1].tobytes())
    data[data.index(b'IDAT') - 4] = 0xB9
    assert decode_image(bytes(data)).cause == 'truncated'


def test_deep_image_files_are_scaled_by_their_content(tmp_path):
    """Twelve bits in sixteen."""
    write_image(tmp_path / 'deep.png', (16 * IMAGE.astype(np.uint16)).astype(np.uint16))
    low, high = IMAGE.min(), IMAGE.max()
    expected = (IMAGE.astype(float) - low) * 255.0 / (int(high) - int(low))
    np.testing.assert_allclose(read_image(tmp_path / 'deep.png'), expected, atol=2.0)


@pytest.mark.parametrize('ending', ['png', 'jpg'])
def test_truncated_images_are_rejected(tmp_path, ending, capfd):
    whole = tmp_path / f'whole.{ending}'
    write_image(whole, IMAGE)
    for share in (0.02, 0.5, 0.98):
        short = tmp_path / f'short.{ending}'
        short.write_bytes(whole.read_bytes()[: int(share * whole.stat().st_size)])
        with pytest.raises(ConfigError, match='expected a complete image'):
            read_image(short)
    assert capfd.readouterr() == ('', '')


def with_exif(jpeg, exif):
    """Insert an EXIF segment at the start of a JPEG, as cameras do."""
    content = b'Exif\0\0' + exif
    return jpeg[:2] + b'\xff\xe1' + struct.pack('>H', 2 + len(content)) + content + jpeg[2:]


def test_the_end_of_a_thumbnail_is_not_the_end_of_the_image(tmp_path):
    path = tmp_path / 'a.jpg'
    write_image(path, IMAGE[::8, ::8])
    thumbnail = path.read_bytes()
    write_image(path, IMAGE)
    plain = read_image(path)
    whole = with_exif(path.read_bytes(), thumbnail)
    path.write_bytes(whole)
    np.testing.assert_array_equal(read_image(path), plain)
    for size in (100, len(thumbnail) + 100, len(whole) - 2):
        path.write_bytes(whole[:size])
        with pytest.raises(ConfigError, match='expected a complete image'):
            read_image(path)


def test_exif_orientation_is_ignored(tmp_path):
    path = tmp_path / 'a.jpg'
    write_image(path, IMAGE)
    plain = read_image(path)
    # A directory with one entry: orientation (0x112), one short, 6: rotate by 90 degrees.
    entry = struct.pack('<HHIHH', 0x112, 3, 1, 6, 0)
    tiff = b'II*\0' + struct.pack('<IH', 8, 1) + entry + bytes(4)
    path.write_bytes(with_exif(path.read_bytes(), tiff))
    assert cv2.imread(str(path)).shape == (640, 480, 3)
    np.testing.assert_array_equal(read_image(path), plain)


@pytest.mark.parametrize('orientation', range(1, 9))
def test_tiff_orientation_is_ignored(tmp_path, orientation):
    path = tmp_path / 'a.tif'
    write_image(path, IMAGE)
    plain, data = read_image(path), path.read_bytes()
    # The same directory once more, at the end, with an entry for the orientation.
    (at,) = struct.unpack_from('<I', data, 4)
    (count,) = struct.unpack_from('<H', data, at)
    entries = [data[n : n + 12] for n in range(at + 2, at + 2 + 12 * count, 12)]
    entries = [each for each in entries if each[:2] != struct.pack('<H', 274)]
    entries.append(struct.pack('<HHIHH', 274, 3, 1, orientation, 0))
    entries.sort(key=lambda each: struct.unpack_from('<H', each))
    directory = struct.pack('<H', len(entries)) + b''.join(entries) + bytes(4)
    path.write_bytes(data[:4] + struct.pack('<I', len(data)) + data[8:] + directory)
    np.testing.assert_array_equal(read_image(path), plain)


def test_a_header_of_spaces_is_rejected_at_once():
    """A pattern that matches spaces in several ways would take years."""
    for data in (b'P5' + 900 * b' ' + b'x', b'P5' + 400 * b' #\n' + b'x'):
        assert size_of(data) is None
        assert not is_image(data)


def test_other_files_are_rejected(tmp_path, capfd):
    for name, data in (
        ('text.png', b'hello'),
        ('empty.jpg', b''),
        ('p.png', b'\x89PNG\r\n\x1a\n'),
    ):
        (tmp_path / name).write_bytes(data)
        with pytest.raises(ConfigError, match=f'{name}: expected an? '):
            read_image(tmp_path / name)
    with pytest.raises(ConfigError, match=r'none\.png: expected a readable image: No such file'):
        read_image(tmp_path / 'none.png')
    with pytest.raises(ConfigError, match=r'expected a file name ending in \.png or \.jpg'):
        write_image(tmp_path / 'a.xyz', IMAGE)
    with pytest.raises(ConfigError, match='expected a writable path: No such file'):
        write_image(tmp_path / 'none/a.png', IMAGE)
    assert capfd.readouterr() == ('', '')
