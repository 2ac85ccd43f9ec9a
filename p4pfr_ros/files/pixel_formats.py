# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""
The pixels of ROS's picture messages to arrays: (h, w) grey or (h, w, 3) BGR, 8 bits.

16 bits are scaled as the encodings' names say, 65535 to 255. Of pictures with alpha the colours
are kept; Bayer patterns are demosaiced. Whoever deserialised the message, its fields are alike,
so that a node and a reader of bags share this.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Protocol

import cv2
import numpy as np
from numpy.typing import NDArray
from p4pfr_ros.files.images import decode_image, ImageArray


class ImageFields(Protocol):
    """What sensor_msgs/Image holds; data is a buffer of bytes."""

    height: int
    width: int
    encoding: str
    is_bigendian: int
    step: int
    data: Any


class CompressedImageFields(Protocol):
    """What sensor_msgs/CompressedImage holds; data is a buffer of bytes."""

    format: str
    data: Any


@dataclass(frozen=True, slots=True)
class Unreadable:
    """Why a message holds no picture: a short name to count under, and a sentence for humans."""

    cause: str
    reason: str


@dataclass(frozen=True, slots=True)
class _Encoding:
    """Numbers per pixel, bytes per number, and cv2's code to grey or BGR (None: as it is)."""

    channels: int
    bytes: int = 1
    code: int | None = None


# cv2 names a Bayer pattern after its second row's second and third pixel, ROS after the corner.
_BAYER = {
    'rggb': cv2.COLOR_BayerBG2BGR,
    'bggr': cv2.COLOR_BayerRG2BGR,
    'gbrg': cv2.COLOR_BayerGR2BGR,
    'grbg': cv2.COLOR_BayerGB2BGR,
}
_ENCODINGS = {
    'mono8': _Encoding(1),
    'mono16': _Encoding(1, 2),
    '8UC1': _Encoding(1),
    '8UC3': _Encoding(3),
    '16UC1': _Encoding(1, 2),
    'bgr8': _Encoding(3),
    'rgb8': _Encoding(3, 1, cv2.COLOR_RGB2BGR),
    'bgr16': _Encoding(3, 2),
    'rgb16': _Encoding(3, 2, cv2.COLOR_RGB2BGR),
    'bgra8': _Encoding(4, 1, cv2.COLOR_BGRA2BGR),
    'rgba8': _Encoding(4, 1, cv2.COLOR_RGBA2BGR),
    '8UC4': _Encoding(4, 1, cv2.COLOR_BGRA2BGR),
    'yuv422': _Encoding(2, 1, cv2.COLOR_YUV2BGR_UYVY),
    'uyvy': _Encoding(2, 1, cv2.COLOR_YUV2BGR_UYVY),
    'yuv422_yuy2': _Encoding(2, 1, cv2.COLOR_YUV2BGR_YUYV),
    'yuyv': _Encoding(2, 1, cv2.COLOR_YUV2BGR_YUYV),
    **{f'bayer_{name}8': _Encoding(1, 1, code) for name, code in _BAYER.items()},
    **{f'bayer_{name}16': _Encoding(1, 2, code) for name, code in _BAYER.items()},
}


def image_from_fields(msg: ImageFields) -> ImageArray | Unreadable:
    """Take the picture out of an Image."""
    encoding = _ENCODINGS.get(msg.encoding)
    if encoding is None:
        return Unreadable(
            'encoding',
            f'image: the encoding {msg.encoding!r} is unknown; known: {", ".join(_ENCODINGS)}',
        )
    wrong = _wrong_size(msg, encoding)
    if wrong is not None:
        return wrong
    used = msg.width * encoding.channels * encoding.bytes
    rows = np.frombuffer(msg.data, np.uint8, msg.height * msg.step).reshape(msg.height, msg.step)
    picture = _eight_bits(np.ascontiguousarray(rows[:, :used]), encoding.bytes, msg.is_bigendian)
    if encoding.channels > 1:
        picture = picture.reshape(msg.height, msg.width, encoding.channels)
    return picture if encoding.code is None else _as_picture(cv2.cvtColor(picture, encoding.code))


def image_from_compressed_fields(msg: CompressedImageFields) -> ImageArray | Unreadable:
    """Take the picture out of a CompressedImage: JPEG, PNG or what else OpenCV reads."""
    picture = decode_image(bytes(msg.data))
    if picture is None:
        return Unreadable('encoding', f'image: the data are no picture (format {msg.format!r})')
    return picture


def _wrong_size(msg: ImageFields, encoding: _Encoding) -> Unreadable | None:
    used = msg.width * encoding.channels * encoding.bytes
    if used == 0 or msg.height == 0:
        return Unreadable('empty', f'image: expected a picture, got {msg.width}x{msg.height}')
    if msg.step < used:
        return Unreadable('layout', f'image: expected step >= {used}, got {msg.step}')
    if len(msg.data) < msg.height * msg.step:
        return Unreadable(
            'truncated',
            f'image: {msg.height * msg.step} bytes expected, {len(msg.data)} came',
        )
    if encoding.channels == 2 and msg.width % 2:
        return Unreadable('layout', f'image: {msg.encoding} needs an even width, got {msg.width}')
    return None


def _eight_bits(rows: ImageArray, size: int, is_bigendian: int) -> ImageArray:
    """Turn rows of bytes into rows of numbers of 8 bits."""
    if size == 1:
        return rows
    # The upper byte is the number over 256: within half a grey level of 255 / 65535.
    return np.ascontiguousarray(rows[:, 0 if is_bigendian else 1 :: 2])


def _as_picture(picture: NDArray[np.generic]) -> ImageArray:
    return picture.astype(np.uint8, copy=False)
