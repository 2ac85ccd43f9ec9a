# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""
The parameters of dashboard_node.

This module stands alone, as the parameters of each kind of node do.
"""

from __future__ import annotations

from dataclasses import dataclass, field

from p4pfr_ros import CalibrationOptions, EstimateOptions

from .declare import parameter
from .image_node_options import ImageTopicOptions
from .pose_options import check_camera_name, NODE_ESTIMATE


@dataclass(frozen=True, slots=True)
class DashboardNodeOptions:
    """Parameters of dashboard_node."""

    board_file: str = parameter(
        '',
        'Path of the YAML file that describes the board or boards; the page guides the first one. '
        'Required.',
        read_only=True,
    )
    calibration_file: str = parameter(
        '',
        'File that the calibration is saved to, a path or a file:// URL. Empty: '
        '~/.ros/camera_info/CAMERA_NAME.yaml, as camera_info_manager does.',
        read_only=True,
    )
    camera_name: str = parameter(
        'camera', 'Name of the camera in the calibration file.', read_only=True
    )
    set_camera_info_service: str = parameter(
        '',
        'Service (sensor_msgs/SetCameraInfo), usually of the camera driver, that receives each '
        'calibration that is saved. Empty: none.',
        read_only=True,
    )
    host: str = parameter(
        '127.0.0.1',
        'Address to serve the page on. 127.0.0.1: for this machine only; 0.0.0.0: for all that '
        'can reach it and know the token.',
        read_only=True,
    )
    port: int = parameter(
        8484, 'Port to serve the page on. 0: a free one.', low=0, high=65535, read_only=True
    )
    token: str = parameter(
        '',
        'Token in the address of the page. Empty: drawn at random if others can reach the page, '
        'and logged.',
        read_only=True,
    )
    opencv_threads: int = parameter(
        1, 'Threads of OpenCV in this process.', low=1, high=64, read_only=True
    )
    image: ImageTopicOptions = field(default_factory=ImageTopicOptions)
    calibration: CalibrationOptions = field(default_factory=CalibrationOptions)
    robust: EstimateOptions = NODE_ESTIMATE

    def __post_init__(self) -> None:
        check_camera_name(self.camera_name)
