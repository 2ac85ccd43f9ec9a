# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""
Messages to numbers and back: the only room that knows the fields of a message.

What comes over the wire is not trusted. A function that reads a node's input returns
``Rejected``, with a cause and a reason, where the message has no answer, and never raises for
what is in it. Those that read our own outputs back, ``pose_from_msg`` and
``division_camera_from_msg``, raise ``ValueError``.
"""

from p4pfr_ros.boards.conventions import CORNER_ORDERS
from p4pfr_ros.files.images import ImageArray

from .alternatives import pose_array_msg
from .cameras import (
    camera_info_division_msg,
    camera_info_from_model_msg,
    camera_info_msg,
    division_camera_from_msg,
    image_frame_from_msg,
    ImageFrame,
    LARGEST_IMAGE_PX,
    model_from_msg,
)
from .correspondences import cloud_msg, correspondences_from_cloud
from .detections import correspondences_from_detections, detection_array_type
from .images import image_from_compressed, image_from_msg, image_msg
from .points import Correspondences, correspondences_from_polygon
from .poses import pose_from_msg, pose_msg, pose_with_covariance_msg

__all__ = [
    'CORNER_ORDERS',
    'LARGEST_IMAGE_PX',
    'Correspondences',
    'ImageArray',
    'ImageFrame',
    'camera_info_division_msg',
    'camera_info_from_model_msg',
    'camera_info_msg',
    'cloud_msg',
    'correspondences_from_cloud',
    'correspondences_from_detections',
    'correspondences_from_polygon',
    'detection_array_type',
    'division_camera_from_msg',
    'image_frame_from_msg',
    'image_from_compressed',
    'image_from_msg',
    'image_msg',
    'model_from_msg',
    'pose_array_msg',
    'pose_from_msg',
    'pose_msg',
    'pose_with_covariance_msg',
]
