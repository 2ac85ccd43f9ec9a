# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""Reads and writes image files."""

from __future__ import annotations

from dataclasses import dataclass
import os
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray
from p4pfr_ros.files.image_headers import size_of, without_orientation
from p4pfr_ros.files.levels import to_eight_bits
from p4pfr_ros.files.writing import not_writable
from p4pfr_ros.files.yaml_fields import ConfigError

ImageArray = NDArray[np.uint8]

_FORMATS = 'png, jpg, bmp, webp, tiff, pnm'
# The first bytes of a format, and bytes near the end of every complete file.
_JPEG_BEGINS, _JPEG_ENDS = b'\xff\xd8', b'\xff\xd9'
_JPEG_SCAN = 0xDA
_PNG_BEGINS, _PNG_ENDS = b'\x89PNG\r\n\x1a\n', b'IEND'
_TRUNCATED = 'expected a complete image, got a truncated file'


@dataclass(frozen=True, slots=True, kw_only=True)
class Decoding:
    """
    How images are decoded.

    Parameters
    ----------
    as_grey
        Decode colour to grey, which detection needs and which is faster.
    by_content
        Scale deep images by the levels that they use; see `to_eight_bits`.
    max_megapixels
        Larger images are rejected before they are decoded.

    """

    as_grey: bool = False
    by_content: bool = True
    max_megapixels: float = 64.0


DEFAULT_DECODING = Decoding()


@dataclass(frozen=True, slots=True)
class Unreadable:
    """Why an image could not be decoded: a cause to count by, and a sentence for the log."""

    cause: str
    reason: str


def read_image(path: str | os.PathLike[str], how: Decoding = DEFAULT_DECODING) -> ImageArray:
    """
    Read an image as the sensor delivered it: (h, w) grey or (h, w, 3) BGR, uint8.

    The orientation of EXIF and TIFF is ignored: it would move the principal point and swap the
    image axes.

    Raises
    ------
    ConfigError
        The file is missing, not an image, truncated or too large.

    """
    image = image_or_reason(path, how)
    if isinstance(image, str):
        raise ConfigError(f'{path}: {image}')
    return image


def image_or_reason(
    path: str | os.PathLike[str], how: Decoding = DEFAULT_DECODING
) -> ImageArray | str:
    """Read an image like `read_image`, or return why that failed."""
    try:
        data = Path(path).read_bytes()
    except OSError as error:
        return f'expected a readable image: {error.strerror}'
    # OpenCV decodes truncated files as well, and fills the rest with grey.
    if _is_truncated(data):
        return _TRUNCATED
    image = decode_image(data, how)
    return image.reason if isinstance(image, Unreadable) else image


def decode_image(data: bytes, how: Decoding = DEFAULT_DECODING) -> ImageArray | Unreadable:
    """Decode the content of an image file like `read_image`."""
    if data.startswith(_PNG_BEGINS) and _end_of_chunks(data) is None:
        return Unreadable('truncated', _TRUNCATED)
    size = size_of(data)
    if size is None:
        return Unreadable('encoding', f'expected an image ({_FORMATS}), got another format')
    too_large = size_error(*size, how)
    if too_large is not None:
        return too_large
    colour = cv2.IMREAD_GRAYSCALE if how.as_grey else cv2.IMREAD_ANYCOLOR
    flags = colour | cv2.IMREAD_ANYDEPTH | cv2.IMREAD_IGNORE_ORIENTATION
    try:
        decoded = cv2.imdecode(np.frombuffer(without_orientation(data), np.uint8), flags)
    except cv2.error:
        decoded = None
    if decoded is None:
        return Unreadable('encoding', f'expected an intact image ({_FORMATS}), got a damaged one')
    image = to_eight_bits(decoded, by_content=how.by_content)
    return Unreadable('values', 'expected finite levels, got none') if image is None else image


def size_error(width: int, height: int, how: Decoding) -> Unreadable | None:
    """Return why an image of this size is rejected, or None if it is not."""
    megapixels = 1e-6 * width * height
    if megapixels <= how.max_megapixels:
        return None
    return Unreadable(
        'too_large',
        f'expected at most {how.max_megapixels:g} megapixels (max_megapixels), got '
        f'{megapixels:.1f} ({width}x{height})',
    )


def uncalibrated_size(calibrated: tuple[int, int], image_size: tuple[int, int]) -> str:
    """Return why a calibration does not hold for an image of this size; '' if it does."""
    if calibrated == image_size:
        return ''
    (width, height), got = calibrated, image_size
    return f'expected {width}x{height} px as calibrated, got {got[0]}x{got[1]}'


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
    is_checked = data.startswith((_PNG_BEGINS, _JPEG_BEGINS))
    return is_checked and first_image_end(data) is None


def first_image_end(data: bytes) -> int | None:
    """
    Return where the image file ends that some data begin with.

    None if it goes on, or if its format (other than PNG and JPEG) does not tell.
    """
    if data.startswith(_PNG_BEGINS):
        return _end_of_chunks(data)
    if data.startswith(_JPEG_BEGINS):
        end = data.find(_JPEG_ENDS, _scan_offset(data))
        return None if end < 0 else end + len(_JPEG_ENDS)
    return None


def _end_of_chunks(data: bytes) -> int | None:
    """Return where a PNG ends; None if that is beyond the data."""
    # A chunk is its length, type, content and checksum. OpenCV 5 allocates what a length states,
    # gigabytes for a damaged one.
    at = len(_PNG_BEGINS)
    while at + 12 <= len(data):
        kind = data[at + 4 : at + 8]
        at += 12 + int.from_bytes(data[at : at + 4], 'big')
        if kind == _PNG_ENDS:
            return at if at <= len(data) else None
    return None


def _scan_offset(data: bytes) -> int:
    """Return the offset of a JPEG's image data, after headers that may embed a thumbnail."""
    # A segment is FF, its type, and its length, which includes the two bytes of the length.
    at = len(_JPEG_BEGINS)
    while at + 4 <= len(data) and data[at] == 0xFF and data[at + 1] != _JPEG_SCAN:
        is_padding = data[at + 1] == 0xFF
        at += 1 if is_padding else 2 + int.from_bytes(data[at + 2 : at + 4], 'big')
    return at
