# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""
Decodes ROS image messages to arrays: (h, w) grey or (h, w, 3) BGR, 8 bits.

16-bit values are scaled from 65535 to 255, alpha is dropped, Bayer patterns are demosaiced. Only
the fields of a message are used, so that messages of rclpy and rosbags both work.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Protocol

import cv2
import numpy as np
from numpy.typing import NDArray
from p4pfr_ros.files.images import decode_image, ImageArray


class ImageFields(Protocol):
    """The fields of sensor_msgs/Image; data is a buffer of bytes."""

    height: int
    width: int
    encoding: str
    is_bigendian: int
    step: int
    data: Any


class CompressedImageFields(Protocol):
    """The fields of sensor_msgs/CompressedImage; data is a buffer of bytes."""

    format: str
    data: Any


@dataclass(frozen=True, slots=True)
class Unreadable:
    """Why a message could not be decoded: a cause to count by, and a sentence for the log."""

    cause: str
    reason: str


@dataclass(frozen=True, slots=True)
class _Encoding:
    """Channels, bytes per channel, and cv2's conversion code to grey or BGR (None: no change)."""

    channels: int
    bytes: int = 1
    code: int | None = None


# ROS names a Bayer pattern after its top left 2x2 pixels, cv2 after the second and third pixel of
# the second row.
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
    """Decode an Image."""
    encoding = _ENCODINGS.get(msg.encoding)
    if encoding is None:
        return Unreadable(
            'encoding',
            f'image: unknown encoding {msg.encoding!r}, expected one of {", ".join(_ENCODINGS)}',
        )
    unreadable = _size_error(msg, encoding)
    if unreadable is not None:
        return unreadable
    used = msg.width * encoding.channels * encoding.bytes
    rows = np.frombuffer(msg.data, np.uint8, msg.height * msg.step).reshape(msg.height, msg.step)
    image = _to_eight_bits(np.ascontiguousarray(rows[:, :used]), encoding.bytes, msg.is_bigendian)
    if encoding.channels > 1:
        image = image.reshape(msg.height, msg.width, encoding.channels)
    return image if encoding.code is None else _as_uint8(cv2.cvtColor(image, encoding.code))


def image_from_compressed_fields(msg: CompressedImageFields) -> ImageArray | Unreadable:
    """Decode a CompressedImage: JPEG, PNG or any other format that OpenCV reads."""
    image = decode_image(bytes(msg.data))
    if image is None:
        return Unreadable('encoding', f'image: cannot decode the data (format {msg.format!r})')
    return image


def _size_error(msg: ImageFields, encoding: _Encoding) -> Unreadable | None:
    used = msg.width * encoding.channels * encoding.bytes
    if used == 0 or msg.height == 0:
        return Unreadable(
            'empty', f'image: expected at least 1x1 px, got {msg.width}x{msg.height}'
        )
    if msg.step < used:
        return Unreadable('layout', f'image: expected step >= {used}, got {msg.step}')
    if len(msg.data) < msg.height * msg.step:
        return Unreadable(
            'truncated',
            f'image: expected {msg.height * msg.step} bytes, got {len(msg.data)}',
        )
    if encoding.channels == 2 and msg.width % 2:
        return Unreadable(
            'layout', f'image: {msg.encoding} requires an even width, got {msg.width}'
        )
    return None


def _to_eight_bits(rows: ImageArray, size: int, is_bigendian: int) -> ImageArray:
    """Convert rows of bytes to rows of 8-bit values; size is the bytes per value."""
    if size == 1:
        return rows
    # The upper byte is value / 256, which is within one grey level of value * 255 / 65535.
    return np.ascontiguousarray(rows[:, 0 if is_bigendian else 1 :: 2])


def _as_uint8(image: NDArray[np.generic]) -> ImageArray:
    return image.astype(np.uint8, copy=False)
