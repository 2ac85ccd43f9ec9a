# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""Reads and writes image files."""

from __future__ import annotations

import os
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray
from p4pfr_ros.files.writing import not_writable
from p4pfr_ros.files.yaml_fields import ConfigError

ImageArray = NDArray[np.uint8]

# The first bytes of a format, and bytes near the end of every complete file.
_JPEG_BEGINS, _JPEG_ENDS = b'\xff\xd8', b'\xff\xd9'
_JPEG_SCAN = 0xDA
_PNG_BEGINS, _PNG_ENDS = b'\x89PNG\r\n\x1a\n', b'IEND'


def read_image(path: str | os.PathLike[str]) -> ImageArray:
    """
    Read an image: (h, w, 3) BGR uint8, as the sensor delivered it.

    The EXIF orientation is ignored: it would move the principal point and swap the image axes.

    Raises
    ------
    ConfigError
        The file is missing, not an image, or truncated.

    """
    image = image_or_reason(path)
    if isinstance(image, str):
        raise ConfigError(f'{path}: {image}')
    return image


def image_or_reason(path: str | os.PathLike[str]) -> ImageArray | str:
    """Read an image like `read_image`, or return why that failed."""
    try:
        data = Path(path).read_bytes()
    except OSError as error:
        return f'expected a readable image: {error.strerror}'
    # OpenCV decodes truncated files as well, and fills the rest with grey.
    if _is_truncated(data):
        return 'expected a complete image, got a truncated file'
    image = decode_image(data)
    return 'expected an image (png, jpg, ...), got another format' if image is None else image


def decode_image(data: bytes) -> ImageArray | None:
    """Decode the content of an image file like `read_image`; None if it is not an image."""
    if not data:
        return None
    try:
        image = cv2.imdecode(
            np.frombuffer(data, dtype=np.uint8),
            cv2.IMREAD_COLOR | cv2.IMREAD_IGNORE_ORIENTATION,
        )
    except cv2.error:
        return None
    return None if image is None else np.asarray(image, dtype=np.uint8)


def write_image(path: str | os.PathLike[str], image: ImageArray) -> None:
    """
    Write an image, (h, w) or (h, w, 3) BGR uint8, in the format of the file extension.

    Raises
    ------
    ConfigError
        OpenCV cannot write the format, or the path is not writable.

    """
    suffix = Path(path).suffix
    if not suffix or not cv2.haveImageWriter(f'image{suffix}'):
        raise ConfigError(f'{path}: expected a file name ending in .png or .jpg')
    _, data = cv2.imencode(suffix, image)
    try:
        Path(path).write_bytes(data.tobytes())
    except OSError as error:
        raise not_writable(path, error) from None


def _is_truncated(data: bytes) -> bool:
    if data.startswith(_PNG_BEGINS):
        return _PNG_ENDS not in data
    if data.startswith(_JPEG_BEGINS):
        return data.find(_JPEG_ENDS, _scan_offset(data)) < 0
    return False


def _scan_offset(data: bytes) -> int:
    """Return the offset of a JPEG's image data, after headers that may embed a thumbnail."""
    # A segment is FF, its type, and its length, which includes the two bytes of the length.
    at = len(_JPEG_BEGINS)
    while at + 4 <= len(data) and data[at] == 0xFF and data[at + 1] != _JPEG_SCAN:
        is_padding = data[at + 1] == 0xFF
        at += 1 if is_padding else 2 + int.from_bytes(data[at + 2 : at + 4], 'big')
    return at
