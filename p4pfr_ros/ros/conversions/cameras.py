# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""
CameraInfo <-> image frame, division camera, and the camera models of image_proc.

The image that a driver sends may be a window (``roi``) of the full image of the sensor, with
pixels combined (``binning_x``, ``binning_y``). The camera model and CameraInfo's K refer to the
full raw image, so points are converted to its pixels first.

This module stands alone, as the conversions of each kind of message do.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from p4pfr_ros.core.cameras.camera_info import CameraInfoModel
from p4pfr_ros.core.cameras.division import DivisionCamera
from p4pfr_ros.core.geometry import Array
from p4pfr_ros.files.k_and_d import assumption, camera_from_k_and_d
from p4pfr_ros.files.printable import shown
from sensor_msgs.msg import CameraInfo, RegionOfInterest
from std_msgs.msg import Header

from ..runtime.rejections import Notice, Rejected

# Width and height; far beyond any sensor.
LARGEST_IMAGE_PX = 65535


@dataclass(frozen=True, slots=True)
class ImageFrame:
    """
    Size of the full raw image, and the window and binning of the image that was sent.

    Parameters
    ----------
    size
        Width and height of the full raw image, pixels.
    offset_px, window
        Top left corner and size of the sent image in the full one; (0, 0): the whole image.
    binning
        Full pixels (horizontally, vertically) that are combined to one pixel of the sent image.

    """

    size: tuple[int, int]
    offset_px: tuple[int, int] = (0, 0)
    window: tuple[int, int] = (0, 0)
    binning: tuple[int, int] = (1, 1)

    def full_from_sent(self, points_px: Array) -> Array:
        """Convert pixels (N, 2) of the sent image to pixels of the full raw image."""
        if self.binning == (1, 1) and self.offset_px == (0, 0):
            return points_px
        # Pixel i covers [i - 1/2, i + 1/2]: edges map to edges, not centres to centres.
        full: Array = (points_px + 0.5) * self.binning - 0.5 + self.offset_px
        return full


def image_frame_from_msg(msg: CameraInfo) -> ImageFrame | Rejected:
    """Read size, window and binning of the image; the intrinsics are ignored."""
    wrong = _wrong_size(msg)
    if wrong is not None:
        return wrong
    return ImageFrame(
        size=(msg.width, msg.height),
        offset_px=(msg.roi.x_offset, msg.roi.y_offset),
        window=(msg.roi.width, msg.roi.height),
        binning=(max(1, msg.binning_x), max(1, msg.binning_y)),  # 0 means 1 in CameraInfo
    )


def _wrong_size(msg: CameraInfo) -> Rejected | None:
    if 0 < msg.width <= LARGEST_IMAGE_PX and 0 < msg.height <= LARGEST_IMAGE_PX:
        return None
    return Rejected(
        'camera_info',
        f'camera_info: expected width and height from 1 to {LARGEST_IMAGE_PX}, '
        f'got {msg.width}x{msg.height}',
    )


def camera_info_msg(header: Header, frame: ImageFrame) -> CameraInfo:
    """Make the CameraInfo of an uncalibrated camera: the image size, and K = 0."""
    msg = CameraInfo(header=header, width=frame.size[0], height=frame.size[1])
    msg.binning_x, msg.binning_y = frame.binning
    (x, y), (width, height) = frame.offset_px, frame.window
    msg.roi = RegionOfInterest(x_offset=x, y_offset=y, width=width, height=height)
    return msg


def camera_info_from_model_msg(
    header: Header, frame: ImageFrame, model: CameraInfoModel
) -> CameraInfo:
    """
    Make the CameraInfo of a calibrated camera, for image_proc.

    K and P refer to the full raw image, whatever the window and binning of the frame; image_proc
    converts them to the sent image. P = K without skew, so the rectified image has the scale of
    the raw image at its centre. Of a barrel lens the rim is cut off: a plane would stretch it
    without limit.
    """
    msg = _with_intrinsics(header, frame, model.focal_px, model.center_px)
    msg.k[1] = model.skew_px  # not in P: the rectified image has none
    msg.distortion_model = model.distortion_model
    msg.d = list(model.coefficients)
    # A window of the raw image is a window of the rectified image too.
    msg.roi.do_rectify = frame.window not in ((0, 0), frame.size)
    return msg


def model_from_msg(msg: CameraInfo) -> CameraInfoModel | Rejected:
    """Read the calibrated camera of any driver's CameraInfo, as calibration files are read."""
    wrong = _wrong_size(msg)
    if wrong is not None:
        return wrong
    if not np.any(msg.k):
        return Rejected('uncalibrated', 'camera_info: the camera is not calibrated (K = 0)')
    try:
        return camera_from_k_and_d(msg.k, msg.d, msg.distortion_model, (msg.width, msg.height))
    except ValueError as error:
        return Rejected('camera_model', f'camera_info: {error}')


def model_assumption(msg: CameraInfo) -> Notice | None:
    """Return a notice if a CameraInfo leaves open what its coefficients mean."""
    text = assumption(msg.d, msg.distortion_model)
    return Notice('no_distortion_model', f'camera_info: {text}') if text else None


def camera_info_division_msg(
    header: Header, frame: ImageFrame, camera: DivisionCamera
) -> CameraInfo:
    """
    Make a CameraInfo with our own camera model, 'division'.

    D is the shortest of [k], [k, k2, k3] and [k, k2, k3, k4, p1, p2] that holds all numbers that
    are not zero. K and P hold fx, fy and the centre, R is the identity. With
    (x, y) = ((u - cx) / fx, (v - cy) / fy) and q = x² + y², pixel (u, v) sees the ray
    (e, 1 + k |e|² + k2 |e|⁴ + k3 |e|⁶ + k4 |e|⁸), where
    e = (x + 2 p1 x y + p2 (q + 2 x²), y + p1 (q + 2 y²) + 2 p2 x y).
    """
    msg = _with_intrinsics(header, frame, camera.focal_xy_px, camera.center_px)
    msg.distortion_model = 'division'
    k, k2, k3, k4 = camera.terms
    if camera.order == 4 or camera.is_decentred:
        msg.d = [k, k2, k3, k4, camera.p1, camera.p2]
    else:
        msg.d = [k] if camera.order == 1 else [k, k2, k3]
    return msg


def division_camera_from_msg(msg: CameraInfo) -> DivisionCamera:
    """Read the camera of our own ``camera_info_division``; other models raise ``ValueError``."""
    if msg.distortion_model != 'division' or len(msg.d) not in (1, 3, 6):
        raise ValueError(
            'expected distortion_model division with D = [k], [k, k2, k3] or '
            f'[k, k2, k3, k4, p1, p2], got {shown(msg.distortion_model)} with {len(msg.d)} '
            'coefficients'
        )
    fx, fy = float(msg.k[0]), float(msg.k[4])
    if not (fx > 0.0 and fy > 0.0):
        raise ValueError(f'expected K with fx and fy > 0, got {fx:g} and {fy:g}')
    given = list(msg.d)
    k, k2, k3, k4, p1, p2 = given + [0.0] * (6 - len(given))
    return DivisionCamera(fx, (msg.k[2], msg.k[5]), k, k2, k3, k4, fy / fx, p1, p2)


def _with_intrinsics(
    header: Header,
    frame: ImageFrame,
    focal_px: tuple[float, float],
    center_px: tuple[float, float],
) -> CameraInfo:
    """Make a CameraInfo with K, R = I and P = K."""
    msg = camera_info_msg(header, frame)
    (fx, fy), (cx, cy) = focal_px, center_px
    msg.k = np.array([fx, 0.0, cx, 0.0, fy, cy, 0.0, 0.0, 1.0])
    msg.r = np.eye(3).ravel()
    msg.p = np.array([fx, 0.0, cx, 0.0, 0.0, fy, cy, 0.0, 0.0, 0.0, 1.0, 0.0])
    return msg
