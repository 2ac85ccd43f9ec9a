# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""What ``camera_info`` has told of the pictures: their size, and the calibration that it holds."""

from __future__ import annotations

import numpy as np
from p4pfr_ros.core.cameras.camera_info import CameraInfoModel
from p4pfr_ros.core.geometry import Array
from sensor_msgs.msg import CameraInfo
from std_msgs.msg import Header

from ..conversions import image_frame_from_msg, ImageFrame, model_from_msg
from ..parameters.pose_options import ImageOptions
from ..runtime.rejections import Rejected

_NO_SIZE = Rejected(
    'no_image_size',
    'the size of the picture is not known: publish camera_info (its K may be 0) or set the '
    'parameters image.width_px and image.height_px',
)
_NO_CAMERA_INFO = Rejected(
    'no_camera_info', 'intrinsics.mode camera_info: no camera_info has come yet'
)

# A corner that was fitted may lie this far outside the picture; nothing else can be seen there.
_MARGIN_PX = 2.0


class Pictures:
    """The latest ``camera_info``, and what follows from it."""

    def __init__(self) -> None:
        self._msg: CameraInfo | None = None
        self._frame: ImageFrame | None = None
        self._model: CameraInfoModel | Rejected = _NO_CAMERA_INFO
        self._model_is_of: CameraInfo | None = None

    def hear(self, msg: CameraInfo) -> Rejected | None:
        """Take a new one, or say why it cannot be one."""
        frame = image_frame_from_msg(msg)
        if isinstance(frame, Rejected):
            return frame
        self._msg, self._frame = msg, frame
        return None

    def frame(self, options: ImageOptions) -> ImageFrame | Rejected:
        """Return the latest one's frame; before the first, that of the parameters."""
        if self._frame is not None:
            return self._frame
        known = options.width_px > 0 and options.height_px > 0
        return ImageFrame((options.width_px, options.height_px)) if known else _NO_SIZE

    def model(self) -> CameraInfoModel | Rejected:
        """Return the calibration that the latest one holds."""
        # Most modes do not ask for it, and then nothing is to be computed.
        if self._msg is not self._model_is_of:
            self._model, self._model_is_of = model_from_msg(self._msg), self._msg
        return self._model

    def remark_on(self, header: Header) -> Rejected | None:
        """Say whether corners with this header are of another camera than ``camera_info``."""
        frame_id = '' if self._msg is None else self._msg.header.frame_id
        if frame_id in ('', header.frame_id):
            return None
        return Rejected(
            'frame_id',
            f'camera_info is of the frame {frame_id!r}, the corners of {header.frame_id!r}: is it '
            'the same camera?',
        )


def outside(points_px: Array, frame: ImageFrame) -> Rejected | None:
    """Say which of the points (N, 2) of the full raw picture cannot have been seen in it."""
    width, height = frame.size
    low, high = -0.5 - _MARGIN_PX, np.array([width, height]) - 0.5 + _MARGIN_PX
    is_beyond = (points_px < low) | (points_px > high)
    if not is_beyond.any():
        return None
    x, y = points_px[is_beyond.any(axis=1)][0]
    return Rejected(
        'outside_picture',
        f'a point at ({x:.0f}, {y:.0f}) px cannot be in a picture of {width}x{height} px: is the '
        'camera_info that of this camera?',
    )
