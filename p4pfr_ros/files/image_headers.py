# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""
What the header of an image file tells without decoding the image: mostly its size.

A small file can hold a huge image: 97 kB of PNG are 10000x10000 pixels, and gigabytes of memory
when decoded. So sizes are checked before.

This module stands alone: it is the only one that knows the formats of image files.
"""

from __future__ import annotations

from collections.abc import Iterator
import re
import struct

_PNG = b'\x89PNG\r\n\x1a\n'
_JPEG = b'\xff\xd8'
# A JPEG's size is in its start-of-frame segment: SOF0 to SOF15 without DHT, JPG and DAC.
_START_OF_FRAME = frozenset(range(0xC0, 0xD0)) - {0xC4, 0xC8, 0xCC}
_START_OF_SCAN = 0xDA
_WITHOUT_LENGTH = frozenset((0x01, *range(0xD0, 0xD9)))
_TIFF = {b'II*\0': '<', b'MM\0*': '>'}
_TIFF_WIDTH, _TIFF_HEIGHT, _TIFF_SHORT, _TIFF_LONG = 256, 257, 3, 4
_TIFF_ORIENTATION = 274
# Magic number, then width and height, separated by white space and comments. One space at a time:
# spaces must not match in several ways, or the time grows exponentially with their number.
_PNM = re.compile(rb'P[1-6]' + 2 * rb'(?:\s|#[^\n]*\n)+(\d{1,9})' + rb'\s')


def is_image(data: bytes) -> bool:
    """Return whether data begin like a file of one of these formats, of whatever size."""
    return (
        data.startswith((_PNG, _JPEG, b'BM', *_TIFF))
        or (data[:4] == b'RIFF' and data[8:12] == b'WEBP')
        or _PNM.match(data[:1000]) is not None
    )


def size_of(data: bytes) -> tuple[int, int] | None:
    """
    Return width and height, pixels, of a PNG, JPEG, BMP, WebP, TIFF or PNM file.

    None if the data are of another format, or too damaged to tell.
    """
    try:
        return _size_of(data)
    except struct.error:  # the header is cut off
        return None


def _size_of(data: bytes) -> tuple[int, int] | None:
    if data.startswith(_PNG):
        return _unpacked('>II', data, 16) if data[12:16] == b'IHDR' else None
    if data.startswith(_JPEG):
        return _jpeg_size(data)
    if data.startswith(b'BM'):
        return _bmp_size(data)
    if data[:4] == b'RIFF' and data[8:12] == b'WEBP':
        return _webp_size(data)
    if data[:4] in _TIFF:
        return _tiff_size(data, _TIFF[data[:4]])
    match = _PNM.match(data[:1000])
    return (int(match[1]), int(match[2])) if match else None


def _unpacked(layout: str, data: bytes, at: int) -> tuple[int, int]:
    first, second = struct.unpack_from(layout, data, at)
    return int(first), int(second)


def _jpeg_size(data: bytes) -> tuple[int, int] | None:
    # Segments are FF, their type, and their length, which includes the two bytes of the length.
    # Decoders skip bytes between segments.
    at = len(_JPEG)
    while (at := data.find(b'\xff', at)) >= 0 and at + 4 <= len(data):
        kind = data[at + 1]
        if kind in _START_OF_FRAME:
            height, width = _unpacked('>HH', data, at + 5)
            return width, height
        if kind == _START_OF_SCAN:
            return None
        if kind == 0xFF:  # padding
            at += 1
        elif kind in _WITHOUT_LENGTH:
            at += 2
        else:
            at += 2 + int.from_bytes(data[at + 2 : at + 4], 'big')
    return None


def _bmp_size(data: bytes) -> tuple[int, int]:
    if int.from_bytes(data[14:18], 'little') == 12:  # the first version of the format
        return _unpacked('<HH', data, 18)
    width, height = _unpacked('<ii', data, 18)
    return abs(width), abs(height)  # a negative height: rows from the top


def _webp_size(data: bytes) -> tuple[int, int] | None:
    if data[12:16] == b'VP8X':
        width = int.from_bytes(data[24:27], 'little')
        return width + 1, int.from_bytes(data[27:30], 'little') + 1
    if data[12:16] == b'VP8L':
        (bits,) = struct.unpack_from('<I', data, 21)
        return (bits & 0x3FFF) + 1, (bits >> 14 & 0x3FFF) + 1
    if data[12:16] == b'VP8 ':
        width, height = _unpacked('<HH', data, 26)
        return width & 0x3FFF, height & 0x3FFF
    return None


def without_orientation(data: bytes) -> bytes:
    """
    Return the data of an image file; those of a TIFF file without the tag of its orientation.

    OpenCV ignores the orientation of other formats on request, but turns TIFF images always.
    """
    order = _TIFF.get(data[:4])
    if order is None:
        return data
    try:
        places = [at for tag, _, at in _tiff_entries(data, order) if tag == _TIFF_ORIENTATION]
    except struct.error:  # damaged: the decoder tells
        return data
    upright = bytearray(data)
    for at in places:
        struct.pack_into(f'{order}H', upright, at, 1)
    return bytes(upright)


def _tiff_size(data: bytes, order: str) -> tuple[int, int] | None:
    found = {}
    for tag, kind, at in _tiff_entries(data, order):
        if tag in (_TIFF_WIDTH, _TIFF_HEIGHT) and kind in (_TIFF_SHORT, _TIFF_LONG):
            layout = f'{order}H' if kind == _TIFF_SHORT else f'{order}I'
            (found[tag],) = struct.unpack_from(layout, data, at)
    if len(found) < 2:
        return None
    return int(found[_TIFF_WIDTH]), int(found[_TIFF_HEIGHT])


def _tiff_entries(data: bytes, order: str) -> Iterator[tuple[int, int, int]]:
    """Yield tag, type, and where the value is, for each entry of the first directory."""
    (at,) = struct.unpack_from(f'{order}I', data, 4)
    (count,) = struct.unpack_from(f'{order}H', data, at)
    for entry in range(at + 2, at + 2 + 12 * count, 12):
        tag, kind, _ = struct.unpack_from(f'{order}HHI', data, entry)
        yield tag, kind, entry + 8
