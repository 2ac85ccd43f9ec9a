# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""Image messages of every encoding to grey or BGR arrays, and back."""

from array import array
import struct

import cv2
import numpy as np
from p4pfr_ros.files.images import Decoding
from p4pfr_ros.ros.conversions import image_from_compressed, image_from_msg, image_msg
from p4pfr_ros.ros.runtime.rejections import Rejected
import pytest
import scenes
from sensor_msgs.msg import CompressedImage, Image

HEIGHT, WIDTH = 12, 16


def _image_array():
    """Make a colourful image that is smooth enough for subsampled colours."""
    y, x = np.mgrid[0:HEIGHT, 0:WIDTH]
    return np.stack([40 + 6 * x, 200 - 5 * y, 60 + 4 * x + 3 * y], axis=-1).astype(np.uint8)


BGR = _image_array()
GREY = BGR[..., 1]


def _image(encoding, pixels, *, padding=0, big_endian=False):
    """Make a message of pixels (h, w) or (h, w, channels), rows padded with garbage."""
    pixels = np.ascontiguousarray(pixels)
    if pixels.dtype.itemsize > 1:
        pixels = pixels.astype(pixels.dtype.newbyteorder('>' if big_endian else '<'))
    rows = [row.tobytes() + b'\xaa' * padding for row in pixels]
    msg = Image(header=scenes.header(1), height=HEIGHT, width=WIDTH, encoding=encoding)
    msg.step, msg.is_bigendian = len(rows[0]), int(big_endian)
    msg.data = array('B', b''.join(rows))
    return msg


def _alpha(pixels):
    return np.dstack([pixels, np.full((HEIGHT, WIDTH), 7, np.uint8)])


@pytest.mark.parametrize('padding', [0, 5])
@pytest.mark.parametrize(
    ('encoding', 'pixels', 'expected'),
    [
        ('mono8', GREY, GREY),
        ('8UC1', GREY, GREY),
        ('bgr8', BGR, BGR),
        ('8UC3', BGR, BGR),
        ('rgb8', BGR[..., ::-1], BGR),
        ('bgra8', _alpha(BGR), BGR),
        ('8UC4', _alpha(BGR), BGR),
        ('rgba8', _alpha(BGR[..., ::-1]), BGR),
    ],
)
def test_eight_bits_are_kept(encoding, pixels, expected, padding):
    """Grey stays grey, colours become BGR, with any channel order and padding."""
    np.testing.assert_array_equal(
        image_from_msg(_image(encoding, pixels, padding=padding)), expected
    )


@pytest.mark.parametrize('big_endian', [False, True])
@pytest.mark.parametrize(
    ('encoding', 'pixels', 'expected'),
    [
        ('mono16', GREY, GREY),
        ('16UC1', GREY, GREY),
        ('bgr16', BGR, BGR),
        ('rgb16', BGR[..., ::-1], BGR),
    ],
)
def test_the_whole_range_of_sixteen_bits_is_scaled(encoding, pixels, expected, big_endian):
    """65535 becomes 255, in either byte order; the lower byte is dropped."""
    lower = np.arange(pixels.size, dtype=np.uint16).reshape(pixels.shape) * 37 % 256
    deep = pixels.astype(np.uint16) * 256 + lower
    msg = _image(encoding, deep, padding=6, big_endian=big_endian)
    np.testing.assert_array_equal(image_from_msg(msg, Decoding(by_content=False)), expected)


@pytest.mark.parametrize(
    ('encoding', 'values'),
    [
        ('mono16', 300 + 12 * GREY.astype(np.uint16)),  # 12 bits in 16
        ('16UC1', 21000 + 4 * GREY.astype(np.uint16)),  # a thermal camera
        ('16SC1', 12 * GREY.astype(np.int16) - 900),
        ('32FC1', 0.01 * GREY.astype(np.float32) + 3.0),
    ],
)
def test_deep_images_are_scaled_by_the_levels_that_they_use(encoding, values):
    """The darkest and brightest pixel become 0 and 255; the order of levels is kept."""
    image = image_from_msg(_image(encoding, values))
    stretched = (GREY.astype(float) - GREY.min()) * 255.0 / np.ptp(GREY.astype(float))
    np.testing.assert_allclose(image, stretched, atol=2.0)


@pytest.mark.parametrize('encoding', ['16UC1', '32FC1'])
def test_pixels_without_a_measurement_do_not_count(encoding):
    """Depth cameras send 0."""
    values = 20000 + 4 * GREY.astype(np.uint16 if encoding == '16UC1' else np.float32)
    values[::5, ::2] = 0
    image = image_from_msg(_image(encoding, values))
    assert (image[::5, ::2] == 0).all()
    stretched = (GREY.astype(float) - GREY.min()) * 255.0 / np.ptp(GREY.astype(float))
    np.testing.assert_allclose(image[1::5], stretched[1::5], atol=2.0)


def test_levels_that_are_not_finite_are_black_and_do_not_count():
    values = 0.01 * GREY.astype(np.float32)
    values[3, 4], values[5, 6] = np.nan, np.inf
    image = image_from_msg(_image('32FC1', values))
    assert image[3, 4] == image[5, 6] == 0
    assert np.ptp(image) == 255
    rejected = image_from_msg(_image('32FC1', np.full((HEIGHT, WIDTH), np.nan, np.float32)))
    assert rejected.cause == 'values'


@pytest.mark.parametrize(
    ('encoding', 'channels'),
    [('bgr8', 3), ('rgba8', 4), ('yuyv', 2), ('nv12', 1), ('bayer_rggb8', 1), ('mono8', 1)],
)
def test_colour_can_be_decoded_to_grey(encoding, channels):
    """Which detection needs."""
    shape = (HEIGHT, WIDTH) if channels == 1 else (HEIGHT, WIDTH, channels)
    msg = _image(encoding, np.full(shape, 128, np.uint8))
    if encoding == 'nv12':
        msg.data = array('B', bytes([128]) * (WIDTH * HEIGHT * 3 // 2))
    image = image_from_msg(msg, Decoding(as_grey=True))
    np.testing.assert_array_equal(image, np.full((HEIGHT, WIDTH), 128))


@pytest.mark.parametrize('encoding', ['nv12', 'nv21'])
def test_planes_of_luma_and_chroma_are_decoded(encoding):
    """Four pixels share their chroma; nv12 has u first."""
    y, u, v = _yuv(BGR)
    chroma = np.empty((HEIGHT // 2, WIDTH), np.uint8)
    first, second = (u, v) if encoding == 'nv12' else (v, u)
    chroma[:, 0::2], chroma[:, 1::2] = first[::2, ::2], second[::2, ::2]
    msg = _image(encoding, y)
    msg.data = array('B', np.concatenate([y, chroma]).tobytes())
    np.testing.assert_allclose(image_from_msg(msg).astype(int), BGR.astype(int), atol=12)
    msg.data = msg.data[:-1]
    assert image_from_msg(msg).cause == 'truncated'


def test_images_above_the_limit_are_rejected():
    msg = _image('mono8', GREY)
    limit = Decoding(max_megapixels=1e-6 * (GREY.size - 1))
    assert image_from_msg(msg, limit).cause == 'too_large'
    png = cv2.imencode('.png', np.zeros((10000, 10000), np.uint8))[1].tobytes()
    rejected = image_from_compressed(_compressed('png', png))
    assert rejected.cause == 'too_large'
    assert '100.0 (10000x10000)' in rejected.reason


@pytest.mark.parametrize('bits', [8, 16])
@pytest.mark.parametrize('pattern', ['rggb', 'bggr', 'gbrg', 'grbg'])
def test_bayer_patterns_become_grey(pattern, bits):
    """The name lists the colours of the four pixels at the top left."""
    mosaic = np.empty((HEIGHT, WIDTH), np.uint8)
    for index, colour in enumerate(pattern):
        at = np.s_[index // 2 :: 2, index % 2 :: 2]
        mosaic[at] = BGR[..., 'bgr'.index(colour)][at]
    pixels = mosaic if bits == 8 else mosaic.astype(np.uint16) * 257
    msg = _image(f'bayer_{pattern}{bits}', pixels)
    decoded = image_from_msg(msg, Decoding(by_content=False))
    expected = cv2.cvtColor(BGR, cv2.COLOR_BGR2GRAY)
    inside = np.s_[2:-2, 2:-2]
    np.testing.assert_allclose(decoded[inside].astype(int), expected[inside].astype(int), atol=3)


@pytest.mark.parametrize(
    ('encoding', 'luma_first'),
    [('yuv422', False), ('uyvy', False), ('yuv422_yuy2', True), ('yuyv', True)],
)
def test_yuv_is_decoded(encoding, luma_first):
    """Two pixels share their chroma; the encoding gives the order of luma and chroma."""
    y, u, v = _yuv(BGR)
    packed = np.empty((HEIGHT, WIDTH, 2), np.uint8)
    luma, chroma = (0, 1) if luma_first else (1, 0)
    packed[..., luma] = y
    packed[:, 0::2, chroma] = u[:, 0::2]
    packed[:, 1::2, chroma] = v[:, 0::2]
    decoded = image_from_msg(_image(encoding, packed, padding=4))
    np.testing.assert_allclose(decoded.astype(int), BGR.astype(int), atol=8)


def _yuv(bgr):
    """Convert with ITU-R BT.601, studio range."""
    b, g, r = np.moveaxis(bgr.astype(float), -1, 0)
    y = 16 + (65.738 * r + 129.057 * g + 25.064 * b) / 256
    u = 128 + (-37.945 * r - 74.494 * g + 112.439 * b) / 256
    v = 128 + (112.439 * r - 94.154 * g - 18.285 * b) / 256
    return (np.rint(plane).astype(np.uint8) for plane in (y, u, v))


@pytest.mark.parametrize(
    ('changes', 'cause'),
    [
        ({'encoding': '64FC1'}, 'encoding'),
        ({'encoding': ''}, 'encoding'),
        ({'width': 0}, 'empty'),
        ({'height': 0}, 'empty'),
        ({'step': WIDTH - 1}, 'layout'),
        ({'height': HEIGHT + 1}, 'truncated'),
        ({'width': 2**31, 'step': 2**32 - 1}, 'truncated'),
        ({'data': array('B')}, 'truncated'),
        ({'encoding': 'yuv422', 'width': 7}, 'layout'),
    ],
)
def test_an_invalid_image_is_rejected_with_cause_and_reason(changes, cause):
    """The reason is a sentence that names the topic."""
    msg = _image('mono8', GREY)
    for name, value in changes.items():
        setattr(msg, name, value)
    rejected = image_from_msg(msg)
    assert isinstance(rejected, Rejected)
    assert rejected.cause == cause
    assert rejected.reason.startswith('image: ')


@pytest.mark.parametrize('image', [GREY, BGR], ids=['grey', 'colour'])
def test_an_image_survives_its_message(image):
    """Round trip."""
    np.testing.assert_array_equal(image_from_msg(image_msg(scenes.header(1), image)), image)


def test_compressed_images_are_decoded():
    """PNG exactly, JPEG approximately; garbage is rejected."""
    png = cv2.imencode('.png', BGR)[1].tobytes()
    np.testing.assert_array_equal(image_from_compressed(_compressed('png', png)), BGR)
    jpeg = cv2.imencode('.jpg', BGR, [cv2.IMWRITE_JPEG_QUALITY, 98])[1].tobytes()
    decoded = image_from_compressed(_compressed('bgr8; jpeg compressed bgr8', jpeg))
    np.testing.assert_allclose(decoded.astype(int), BGR.astype(int), atol=12)
    for data in (b'', b'garbage'):
        assert image_from_compressed(_compressed('png', data)).cause == 'encoding'
    assert image_from_compressed(_compressed('png', png[:40])).cause == 'truncated'


def test_the_exif_orientation_is_not_applied():
    """The camera model refers to the sensor's pixels."""
    jpeg = cv2.imencode('.jpg', BGR)[1].tobytes()
    # EXIF, a directory with one entry: orientation (0x112), one short, 6: rotated by 90 degrees.
    entry = struct.pack('<HHIHH', 0x112, 3, 1, 6, 0)
    exif = b'Exif\0\0II*\0' + struct.pack('<IH', 8, 1) + entry + bytes(4)
    rotated = jpeg[:2] + b'\xff\xe1' + struct.pack('>H', 2 + len(exif)) + exif + jpeg[2:]
    assert cv2.imdecode(np.frombuffer(rotated, np.uint8), cv2.IMREAD_COLOR).shape[0] == WIDTH
    np.testing.assert_array_equal(
        image_from_compressed(_compressed('jpeg', rotated)),
        image_from_compressed(_compressed('jpeg', jpeg)),
    )


def _compressed(kind, data):
    return CompressedImage(header=scenes.header(1), format=kind, data=array('B', data))
