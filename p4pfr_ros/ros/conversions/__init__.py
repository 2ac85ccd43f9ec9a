# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""
Conversions between messages and numbers; only these modules access the fields of messages.

Received messages are not trusted. A function that converts an input of a node returns
``Rejected``, with a cause and a reason, if the message is invalid; it never raises because of
the content of a message. ``pose_from_msg`` and ``division_camera_from_msg`` read messages that
our own nodes have published, and raise ``ValueError``.
"""

from p4pfr_ros.files.images import ImageArray

from .cameras import (
    camera_info_division_msg,
    camera_info_from_model_msg,
    camera_info_msg,
    division_camera_from_msg,
    image_frame_from_msg,
    ImageFrame,
    LARGEST_IMAGE_PX,
    model_assumption,
    model_from_msg,
)
from .correspondences import (
    cloud_msg,
    Correspondences,
    correspondences_from_cloud,
    correspondences_from_polygon,
)
from .detections import (
    correspondences_from_detections,
    detection_array_type,
    isaac_detection_array_type,
)
from .images import image_from_compressed, image_from_msg, image_msg
from .poses import pose_array_msg, pose_from_msg, pose_msg, pose_with_covariance_msg, transform_msg

__all__ = [
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
    'isaac_detection_array_type',
    'model_assumption',
    'model_from_msg',
    'pose_array_msg',
    'pose_from_msg',
    'pose_msg',
    'pose_with_covariance_msg',
    'transform_msg',
]
