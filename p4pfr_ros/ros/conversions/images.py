# Copyright 2026 p4pfr_ros maintainers
#
# Licensed under the Apache License, Version 2.0 (the "License");
# you may not use this file except in compliance with the License.
# You may obtain a copy of the License at
#
#     http://www.apache.org/licenses/LICENSE-2.0
#
# Unless required by applicable law or agreed to in writing, software
# distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied.
# See the License for the specific language governing permissions and
# limitations under the License.

"""Image and CompressedImage <-> arrays: (h, w) grey or (h, w, 3) BGR, 8 bits."""

from __future__ import annotations

from array import array

from p4pfr_ros.image_files import Picture
from p4pfr_ros.pixel_formats import (
    picture_from_compressed_fields,
    picture_from_fields,
    Unreadable,
)
from sensor_msgs.msg import CompressedImage, Image
from std_msgs.msg import Header

from ..rejections import Rejected


def image_from_msg(msg: Image) -> Picture | Rejected:
    """Take the picture out of an Image, of any encoding in `pixel_formats`."""
    return _or_rejected(picture_from_fields(msg))


def image_from_compressed(msg: CompressedImage) -> Picture | Rejected:
    """Take the picture out of a CompressedImage: JPEG, PNG or what else OpenCV reads."""
    return _or_rejected(picture_from_compressed_fields(msg))


def image_msg(header: Header, picture: Picture) -> Image:
    """Make an Image, mono8 or bgr8, of (h, w) grey or (h, w, 3) BGR."""
    height, width = picture.shape[:2]
    grey = picture.ndim == 2
    msg = Image(header=header, height=height, width=width, encoding='mono8' if grey else 'bgr8')
    msg.step = width if grey else 3 * width
    msg.data = array('B', picture.tobytes())
    return msg


def _or_rejected(found: Picture | Unreadable) -> Picture | Rejected:
    return Rejected(found.cause, found.reason) if isinstance(found, Unreadable) else found
