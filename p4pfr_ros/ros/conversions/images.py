# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""
Image and CompressedImage <-> arrays: (h, w) grey or (h, w, 3) BGR, 8 bits.

This module stands alone, as the conversions of each kind of message do.
"""

from __future__ import annotations

from array import array

from p4pfr_ros.files.images import Decoding, DEFAULT_DECODING, ImageArray, Unreadable
from p4pfr_ros.files.pixel_formats import image_from_compressed_fields, image_from_fields
from sensor_msgs.msg import CompressedImage, Image
from std_msgs.msg import Header

from ..runtime.rejections import Rejected


def image_from_msg(msg: Image, how: Decoding = DEFAULT_DECODING) -> ImageArray | Rejected:
    """Decode an Image with any encoding of ``pixel_formats``."""
    return _or_rejected(image_from_fields(msg, how))


def image_from_compressed(
    msg: CompressedImage, how: Decoding = DEFAULT_DECODING
) -> ImageArray | Rejected:
    """Decode a CompressedImage: JPEG, PNG or another format of ``files.images``."""
    return _or_rejected(image_from_compressed_fields(msg, how))


def image_msg(header: Header, image: ImageArray) -> Image:
    """Make an Image of an array: mono8 of (h, w), bgr8 of (h, w, 3) BGR."""
    height, width = image.shape[:2]
    grey = image.ndim == 2
    msg = Image(header=header, height=height, width=width, encoding='mono8' if grey else 'bgr8')
    msg.step = width if grey else 3 * width
    msg.data = array('B', image.tobytes())
    return msg


def _or_rejected(image: ImageArray | Unreadable) -> ImageArray | Rejected:
    return Rejected(image.cause, image.reason) if isinstance(image, Unreadable) else image
