# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""Image and CompressedImage <-> arrays: (h, w) grey or (h, w, 3) BGR, 8 bits."""

from __future__ import annotations

from array import array

from p4pfr_ros.files.images import ImageArray
from p4pfr_ros.files.pixel_formats import (
    image_from_compressed_fields,
    image_from_fields,
    Unreadable,
)
from sensor_msgs.msg import CompressedImage, Image
from std_msgs.msg import Header

from ..runtime.rejections import Rejected


def image_from_msg(msg: Image) -> ImageArray | Rejected:
    """Take the picture out of an Image, of any encoding in `pixel_formats`."""
    return _or_rejected(image_from_fields(msg))


def image_from_compressed(msg: CompressedImage) -> ImageArray | Rejected:
    """Take the picture out of a CompressedImage: JPEG, PNG or what else OpenCV reads."""
    return _or_rejected(image_from_compressed_fields(msg))


def image_msg(header: Header, picture: ImageArray) -> Image:
    """Make an Image, mono8 or bgr8, of (h, w) grey or (h, w, 3) BGR."""
    height, width = picture.shape[:2]
    grey = picture.ndim == 2
    msg = Image(header=header, height=height, width=width, encoding='mono8' if grey else 'bgr8')
    msg.step = width if grey else 3 * width
    msg.data = array('B', picture.tobytes())
    return msg


def _or_rejected(found: ImageArray | Unreadable) -> ImageArray | Rejected:
    return Rejected(found.cause, found.reason) if isinstance(found, Unreadable) else found
