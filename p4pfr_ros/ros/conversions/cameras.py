# SPDX-License-Identifier: Apache-2.0
"""
CameraInfo <-> the picture's frame, and the division camera.

The picture that a driver sends may be a window (``roi``) of the sensor's full picture, with
pixels combined (``binning_x``, ``binning_y``). Lens and distortion centre belong to the full raw
picture, and CameraInfo's K speaks of it, so corners are taken there before anything else.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from p4pfr_ros.core.camera import DivisionCamera
from p4pfr_ros.core.geometry import Array
from sensor_msgs.msg import CameraInfo, RegionOfInterest
from std_msgs.msg import Header

from ..rejections import Rejected


@dataclass(frozen=True, slots=True)
class ImageFrame:
    """
    Size of the full raw picture, and where in it the pixels of the sent picture lie.

    Parameters
    ----------
    size
        Width and height of the full raw picture, pixels.
    offset_px, window
        The sent picture's top left corner in the full one, and its size there (0, 0: all of it).
    binning
        Full pixels (across, down) that were made into one of the sent picture.

    """

    size: tuple[int, int]
    offset_px: tuple[int, int] = (0, 0)
    window: tuple[int, int] = (0, 0)
    binning: tuple[int, int] = (1, 1)

    def full_from_sent(self, points_px: Array) -> Array:
        """Take (N, 2) pixels of the picture as sent to the full raw picture."""
        # Pixel i covers [i - 1/2, i + 1/2]: edges map to edges, not centres to centres.
        full: Array = (points_px + 0.5) * self.binning - 0.5 + self.offset_px
        return full


def image_frame_from_msg(msg: CameraInfo) -> ImageFrame | Rejected:
    """Take the picture's size, window and binning; the intrinsics are not looked at."""
    if msg.width == 0 or msg.height == 0:
        return Rejected('camera_info', 'camera_info: width or height is 0')
    return ImageFrame(
        size=(msg.width, msg.height),
        offset_px=(msg.roi.x_offset, msg.roi.y_offset),
        window=(msg.roi.width, msg.roi.height),
        binning=(max(1, msg.binning_x), max(1, msg.binning_y)),  # 0 means 1 there
    )


def camera_info_msg(header: Header, frame: ImageFrame) -> CameraInfo:
    """Make a CameraInfo of an uncalibrated camera: the picture's size, and K = 0."""
    msg = CameraInfo(header=header, width=frame.size[0], height=frame.size[1])
    msg.binning_x, msg.binning_y = frame.binning
    (x, y), (width, height) = frame.offset_px, frame.window
    msg.roi = RegionOfInterest(x_offset=x, y_offset=y, width=width, height=height)
    return msg


def camera_info_division_msg(
    header: Header, frame: ImageFrame, camera: DivisionCamera
) -> CameraInfo:
    """
    Make a CameraInfo with the camera in its native model: 'division', D = [k].

    K and P hold focal length and centre, R is the identity. Its ray for the pixel u is
    (d, 1 + k |d|²) with d = (u - c) / f.
    """
    msg = camera_info_msg(header, frame)
    f, (cx, cy) = camera.focal_px, camera.center_px
    msg.distortion_model = 'division'
    msg.d = [camera.k]
    msg.k = np.array([f, 0.0, cx, 0.0, f, cy, 0.0, 0.0, 1.0])
    msg.r = np.eye(3).ravel()
    msg.p = np.array([f, 0.0, cx, 0.0, 0.0, f, cy, 0.0, 0.0, 0.0, 1.0, 0.0])
    return msg


def division_camera_from_msg(msg: CameraInfo) -> DivisionCamera:
    """Take the camera out of our own ``camera_info_division``; another one is a ``ValueError``."""
    if msg.distortion_model != 'division' or len(msg.d) != 1:
        raise ValueError(f'expected the model division with D = [k], got {msg.distortion_model!r}')
    return DivisionCamera(msg.k[0], (msg.k[2], msg.k[5]), msg.d[0])
