# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""Pictures on disk."""

from __future__ import annotations

import os
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray
from p4pfr_ros.files.boards import ConfigError

ImageArray = NDArray[np.uint8]

# How a format's files begin, and what stands near their end.
_JPEG_BEGINS, _JPEG_ENDS = b'\xff\xd8', b'\xff\xd9'
_JPEG_SCAN = 0xDA
_PNG_BEGINS, _PNG_ENDS = b'\x89PNG\r\n\x1a\n', b'IEND'


def read_image(path: str | os.PathLike[str]) -> ImageArray:
    """
    Read a picture: (h, w, 3) BGR uint8, the camera's pixels as they are.

    A rotation that is noted in the file is for people: it is not applied.

    Raises
    ------
    ConfigError
        There is no such file, it is no picture, or it is cut short.

    """
    picture = image_or_reason(path)
    if isinstance(picture, str):
        raise ConfigError(f'{path}: {picture}')
    return picture


def image_or_reason(path: str | os.PathLike[str]) -> ImageArray | str:
    """Read a picture as `read_image` does, or return why there is none."""
    try:
        data = Path(path).read_bytes()
    except OSError as error:
        return f'expected a readable picture: {error.strerror}'
    # OpenCV decodes a file that is cut short too, with the rest grey.
    if _is_cut_short(data):
        return 'expected a whole picture, got a file that is cut short'
    image = decode_image(data)
    return 'expected a picture (png, jpg, ...), got something else' if image is None else image


def decode_image(data: bytes) -> ImageArray | None:
    """Decode a file's bytes as `read_image` does; None where they are no picture."""
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
    Write a picture, (h, w) or (h, w, 3) BGR uint8, in the format that the path's ending names.

    Raises
    ------
    ConfigError
        OpenCV writes no such format, or there is no such place to write to.

    """
    ending = Path(path).suffix
    if not ending or not cv2.haveImageWriter(f'picture{ending}'):
        raise ConfigError(f'{path}: expected a name that ends in .png or .jpg')
    _, data = cv2.imencode(ending, image)
    try:
        Path(path).write_bytes(data.tobytes())
    except OSError as error:
        raise ConfigError(f'{path}: expected a place to write to: {error.strerror}') from None


def _is_cut_short(data: bytes) -> bool:
    if data.startswith(_PNG_BEGINS):
        return _PNG_ENDS not in data
    if data.startswith(_JPEG_BEGINS):
        return data.find(_JPEG_ENDS, _scan_at(data)) < 0
    return False


def _scan_at(data: bytes) -> int:
    """Return where a JPEG's own picture begins, behind its header with a thumbnail perhaps."""
    # Each segment is FF, its kind, and its length, which counts itself (two bytes).
    at = len(_JPEG_BEGINS)
    while at + 4 <= len(data) and data[at] == 0xFF and data[at + 1] != _JPEG_SCAN:
        is_padding = data[at + 1] == 0xFF
        at += 1 if is_padding else 2 + int.from_bytes(data[at + 2 : at + 4], 'big')
    return at
