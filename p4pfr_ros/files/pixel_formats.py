# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""
Decodes ROS image messages to arrays: (h, w) grey or (h, w, 3) BGR, 8 bits.

Deep images are scaled to 8 bits (``levels``), alpha is dropped, Bayer patterns become grey. Only
the fields of a message are used, so that messages of rclpy and rosbags both work.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Protocol

import cv2
import numpy as np
from p4pfr_ros.files.images import (
    decode_image,
    Decoding,
    DEFAULT_DECODING,
    ImageArray,
    size_error,
    Unreadable,
)
from p4pfr_ros.files.levels import to_eight_bits
from p4pfr_ros.files.printable import shown

__all__ = ['Unreadable', 'image_from_compressed_fields', 'image_from_fields']


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
class _Encoding:
    """
    The layout of the data, and cv2's conversion codes.

    ``type`` is NumPy's type of a value without byte order; ``code`` converts to BGR or grey,
    ``grey`` to grey (None: as it is). An image with ``planes`` has half as many rows of chroma,
    two interleaved values per two pixels, below those of luma.
    """

    channels: int = 1
    type: str = 'u1'
    code: int | None = None
    grey: int | None = None
    planes: bool = False

    @property
    def pixel_bytes(self) -> int:
        return self.channels * int(self.type[1:])


_BGR: dict[str, Any] = {'channels': 3, 'grey': cv2.COLOR_BGR2GRAY}
_RGB: dict[str, Any] = {'channels': 3, 'code': cv2.COLOR_RGB2BGR, 'grey': cv2.COLOR_RGB2GRAY}
_BGRA = _Encoding(4, code=cv2.COLOR_BGRA2BGR, grey=cv2.COLOR_BGRA2GRAY)
_UYVY = _Encoding(2, code=cv2.COLOR_YUV2BGR_UYVY, grey=cv2.COLOR_YUV2GRAY_UYVY)
_YUYV = _Encoding(2, code=cv2.COLOR_YUV2BGR_YUYV, grey=cv2.COLOR_YUV2GRAY_YUYV)
_NV12, _NV21 = cv2.COLOR_YUV2BGR_NV12, cv2.COLOR_YUV2BGR_NV21
# ROS names a Bayer pattern after its top left 2x2 pixels, cv2 after the second and third pixel of
# the second row. Detection needs grey, and colour would take twice as long.
_BAYER = {
    'rggb': cv2.COLOR_BayerBG2GRAY,
    'bggr': cv2.COLOR_BayerRG2GRAY,
    'gbrg': cv2.COLOR_BayerGR2GRAY,
    'grbg': cv2.COLOR_BayerGB2GRAY,
}
_ENCODINGS = {
    'mono8': _Encoding(),
    'mono16': _Encoding(type='u2'),
    '8UC1': _Encoding(),
    '8UC3': _Encoding(**_BGR),
    '16UC1': _Encoding(type='u2'),
    '16SC1': _Encoding(type='i2'),
    '32FC1': _Encoding(type='f4'),
    'bgr8': _Encoding(**_BGR),
    'rgb8': _Encoding(**_RGB),
    'bgr16': _Encoding(type='u2', **_BGR),
    'rgb16': _Encoding(type='u2', **_RGB),
    'bgra8': _BGRA,
    'rgba8': _Encoding(4, code=cv2.COLOR_RGBA2BGR, grey=cv2.COLOR_RGBA2GRAY),
    '8UC4': _BGRA,
    'yuv422': _UYVY,
    'uyvy': _UYVY,
    'yuv422_yuy2': _YUYV,
    'yuyv': _YUYV,
    'nv12': _Encoding(code=_NV12, grey=cv2.COLOR_YUV2GRAY_NV12, planes=True),
    'nv21': _Encoding(code=_NV21, grey=cv2.COLOR_YUV2GRAY_NV21, planes=True),
    **{f'bayer_{name}8': _Encoding(code=code, grey=code) for name, code in _BAYER.items()},
    **{f'bayer_{name}16': _Encoding(1, 'u2', code, code) for name, code in _BAYER.items()},
}


def image_from_fields(
    msg: ImageFields, how: Decoding = DEFAULT_DECODING
) -> ImageArray | Unreadable:
    """Decode an Image."""
    encoding = _ENCODINGS.get(msg.encoding)
    if encoding is None:
        return Unreadable(
            'encoding',
            f'image: unknown encoding {shown(msg.encoding)}, '
            f'expected one of {", ".join(_ENCODINGS)}',
        )
    unreadable = _layout_error(msg, encoding, how)
    if unreadable is not None:
        return unreadable
    height = _rows(msg, encoding)
    rows = np.frombuffer(msg.data, np.uint8, height * msg.step).reshape(height, msg.step)
    used = np.ascontiguousarray(rows[:, : msg.width * encoding.pixel_bytes])
    order = '>' if msg.is_bigendian else '<'
    values = used.view(order + encoding.type).astype(encoding.type, copy=False)
    image = to_eight_bits(values, by_content=how.by_content)
    if image is None:
        return Unreadable('values', 'image: expected finite levels, got none')
    if encoding.channels > 1:
        image = image.reshape(height, msg.width, encoding.channels)
    code = encoding.grey if how.as_grey else encoding.code
    return image if code is None else np.asarray(cv2.cvtColor(image, code), dtype=np.uint8)


def image_from_compressed_fields(
    msg: CompressedImageFields, how: Decoding = DEFAULT_DECODING
) -> ImageArray | Unreadable:
    """Decode a CompressedImage: a JPEG, PNG or another file that ``decode_image`` reads."""
    image = decode_image(bytes(msg.data), how)
    if isinstance(image, Unreadable):
        return Unreadable(image.cause, f'image: {image.reason} (format {shown(msg.format)})')
    return image


def _rows(msg: ImageFields, encoding: _Encoding) -> int:
    return msg.height + msg.height // 2 if encoding.planes else msg.height


def _layout_error(msg: ImageFields, encoding: _Encoding, how: Decoding) -> Unreadable | None:
    """Return why the data of an image cannot have the layout that its fields state, or None."""
    used = msg.width * encoding.pixel_bytes
    if used == 0 or msg.height == 0:
        return Unreadable(
            'empty', f'image: expected at least 1x1 px, got {msg.width}x{msg.height}'
        )
    if msg.step < used:
        return Unreadable('layout', f'image: expected step >= {used}, got {msg.step}')
    needed = _rows(msg, encoding) * msg.step
    if len(msg.data) < needed:
        return Unreadable('truncated', f'image: expected {needed} bytes, got {len(msg.data)}')
    if (encoding.channels == 2 or encoding.planes) and msg.width % 2:
        return Unreadable(
            'layout', f'image: {msg.encoding} requires an even width, got {msg.width}'
        )
    if encoding.planes and msg.height % 2:
        return Unreadable(
            'layout', f'image: {msg.encoding} requires an even height, got {msg.height}'
        )
    too_large = size_error(msg.width, msg.height, how)
    return None if too_large is None else Unreadable('too_large', f'image: {too_large.reason}')
