# SPDX-License-Identifier: Apache-2.0
"""Pictures on disk."""

from __future__ import annotations

import os
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray
from p4pfr_ros.files import ConfigError

# How a format's files begin, and what stands near their end. OpenCV decodes a file that is cut
# short too, with the rest grey and a warning on the terminal, so that is looked at before.
_BEGIN_AND_END = {
    b'\xff\xd8\xff': b'\xff\xd9',  # JPEG
    b'\x89PNG\r\n\x1a\n': b'IEND',
}


def read_image(path: str | os.PathLike[str]) -> NDArray[np.uint8]:
    """
    Read a picture: (h, w, 3) BGR uint8.

    Raises
    ------
    ConfigError
        There is no such file, it is no picture, or it is cut short.

    """
    try:
        data = Path(path).read_bytes()
    except OSError as error:
        raise ConfigError(f'{path}: expected a readable picture: {error.strerror}') from None
    for begin, end in _BEGIN_AND_END.items():
        if data.startswith(begin) and end not in data[len(begin) :]:
            raise ConfigError(f'{path}: expected a whole picture, got a file that is cut short')
    image = _decoded(data)
    if image is None:
        raise ConfigError(f'{path}: expected a picture (png, jpg, ...), got something else')
    return image


def write_image(path: str | os.PathLike[str], image: NDArray[np.uint8]) -> None:
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


def _decoded(data: bytes) -> NDArray[np.uint8] | None:
    if not data:
        return None
    try:
        image = cv2.imdecode(np.frombuffer(data, dtype=np.uint8), cv2.IMREAD_COLOR)
    except cv2.error:
        return None
    return None if image is None else np.asarray(image, dtype=np.uint8)
