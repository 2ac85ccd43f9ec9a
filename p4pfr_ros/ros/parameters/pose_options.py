# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""
The parameters of pose_node and lifecycle_pose_node.

``robust.*`` and ``calibration.*`` are the options of the core, with its names, ranges and
descriptions, and its defaults except those of ``NODE_ESTIMATE``.
"""

from __future__ import annotations

from dataclasses import dataclass, field
import re

from p4pfr_ros import CalibrationOptions, EstimateOptions
from p4pfr_ros.boards.conventions import CORNER_ORDERS
from p4pfr_ros.files.yaml_fields import ConfigError

from .declare import parameter
from ..conversions import LARGEST_IMAGE_PX

SELF_CALIBRATE, PER_FRAME, FIXED, CAMERA_INFO = MODES = (
    'self_calibrate',
    'per_frame',
    'fixed',
    'camera_info',
)

# The defaults of ``robust.*`` that differ from the core's: a node prefers no pose to that of a
# minority of the points, and its time is limited.
NODE_ESTIMATE = EstimateOptions(min_inlier_ratio=0.5, max_iterations=5000)

_MIN_FOCAL_PX = 1e-3
_MIN_MARKER_M = 1e-6


@dataclass(frozen=True, slots=True)
class IntrinsicsOptions:
    """Source of focal length, distortion and centre."""

    mode: str = parameter(
        SELF_CALIBRATE,
        'Source of the camera intrinsics. self_calibrate: estimated from all views, refined with '
        'each new one; per_frame: estimated from each view alone; fixed: the parameters '
        'intrinsics.*, or, if focal_px is 0, the loaded or estimated calibration; camera_info: a '
        'calibrated CameraInfo on the topic camera_info.',
        choices=MODES,
    )
    focal_px: float = parameter(
        0.0,
        'Mode fixed: focal length fx at the principal point, pixels. 0: not given.',
        low=0.0,
        high=1e6,
    )
    k: float = parameter(
        0.0,
        'Mode fixed: distortion of the division model, dimensionless; negative is barrel.',
        low=-100.0,
        high=100.0,
    )
    k2: float = parameter(
        0.0,
        'Mode fixed: second distortion coefficient, for wide lenses.',
        low=-100.0,
        high=100.0,
    )
    k3: float = parameter(
        0.0, 'Mode fixed: third distortion coefficient, for wide lenses.', low=-100.0, high=100.0
    )
    k4: float = parameter(
        0.0, 'Mode fixed: fourth distortion coefficient, for wide lenses.', low=-100.0, high=100.0
    )
    aspect: float = parameter(
        1.0,
        'Mode fixed: aspect ratio fy/fx, with focal_px = fx. 1: square pixels.',
        low=0.1,
        high=10.0,
    )
    p1: float = parameter(
        0.0, 'Mode fixed: first coefficient of the decentring distortion.', low=-1.0, high=1.0
    )
    p2: float = parameter(
        0.0, 'Mode fixed: second coefficient of the decentring distortion.', low=-1.0, high=1.0
    )

    def __post_init__(self) -> None:
        if 0.0 < self.focal_px < _MIN_FOCAL_PX:
            raise ConfigError(
                f'intrinsics.focal_px: expected at least {_MIN_FOCAL_PX:g} px, or 0 for not '
                f'given, got {self.focal_px:g}'
            )


@dataclass(frozen=True, slots=True)
class MarkerOptions:
    """The marker whose corners arrive on the topic ``corners``."""

    size_m: float = parameter(
        0.0,
        'Side of the marker: outer edge of its black border, metres. 0: not given; messages on '
        'the topic corners are rejected.',
        low=0.0,
        high=1000.0,
    )
    corner_order: str = parameter(
        'aruco_cw_from_top_left',
        "Order of the four corners: OpenCV's ArUco (clockwise from the top left) or AprilTag "
        '(counter-clockwise from the bottom left), with the printed marker upright.',
        choices=tuple(CORNER_ORDERS),
    )
    pixel_center_px: float = parameter(
        0.0,
        'Coordinate of the centre of the first pixel, subtracted from the corners: 0 in ROS and '
        "OpenCV, 0.5 in AprilTag's own library.",
        low=0.0,
        high=0.5,
    )

    def __post_init__(self) -> None:
        if 0.0 < self.size_m < _MIN_MARKER_M:
            raise ConfigError(
                f'marker.size_m: expected at least {_MIN_MARKER_M:g} m, or 0 for not given, '
                f'got {self.size_m:g}'
            )


@dataclass(frozen=True, slots=True)
class DetectionsOptions:
    """Conventions of the tags on the topic of that name; the defaults are its detector's."""

    corner_order: str = parameter(
        'apriltag_ccw_from_bottom_left',
        'Order of the four corners of a detection, with the printed tag upright.',
        choices=tuple(CORNER_ORDERS),
    )
    pixel_center_px: float = parameter(
        0.5,
        'Coordinate of the centre of the first pixel, subtracted from the corners.',
        low=0.0,
        high=0.5,
    )


@dataclass(frozen=True, slots=True)
class ImageOptions:
    """Image size without ``camera_info``, and the camera's centre."""

    width_px: int = parameter(
        0,
        'Width of the full raw image, until the first camera_info arrives. 0: not given.',
        low=0,
        high=LARGEST_IMAGE_PX,
    )
    height_px: int = parameter(
        0,
        'Height of the full raw image, until the first camera_info arrives. 0: not given.',
        low=0,
        high=LARGEST_IMAGE_PX,
    )
    center_x_px: float = parameter(
        -1.0,
        'Principal point and distortion centre in the full raw image, x, in the modes per_frame '
        'and fixed. -1: the middle of the image.',
        low=-1.0,
        high=float(LARGEST_IMAGE_PX),
    )
    center_y_px: float = parameter(
        -1.0,
        'Principal point and distortion centre in the full raw image, y, in the modes per_frame '
        'and fixed. -1: the middle of the image.',
        low=-1.0,
        high=float(LARGEST_IMAGE_PX),
    )

    def center_px(self, size: tuple[int, int]) -> tuple[float, float]:
        """Return the centre in a full raw image of this size, px."""
        x, y = self.center_x_px, self.center_y_px
        return (0.5 * (size[0] - 1) if x < 0.0 else x, 0.5 * (size[1] - 1) if y < 0.0 else y)


@dataclass(frozen=True, slots=True)
class PoseNodeOptions:
    """Parameters of pose_node."""

    enabled: bool = parameter(
        True, 'Whether messages are processed; the service ~/set_enabled sets it too.'
    )
    board_file: str = parameter(
        '',
        'Path of the YAML file with the boards on the topics correspondences, detections and '
        'tag_detections; the names of the boards are their frames. With several boards, each has '
        'its own topics, such as ~/NAME/pose. Empty: one board without a name.',
        read_only=True,
    )
    board_frame: str = parameter(
        '',
        "The board's frame in /tf and ~/markers. Empty: the name of the board, or board if it has "
        'no name. With several boards it is a prefix: board_frame/NAME.',
    )
    publish_tf: bool = parameter(
        False, 'Whether poses are also published on /tf; needs the package tf2_ros.'
    )
    invert_tf: bool = parameter(
        False,
        'On /tf, publish the pose of the camera in the board frame. For one board only: with '
        'several boards the camera frame would have several parents, and /tf allows one.',
    )
    intrinsics: IntrinsicsOptions = field(default_factory=IntrinsicsOptions)
    calibration: CalibrationOptions = field(default_factory=CalibrationOptions)
    calibration_file: str = parameter(
        '',
        'File of the calibration, a path or a file:// URL: loaded at the start if it exists, and '
        'saved to. Files of camera_calibration, OpenCV and Kalibr are read, too. Empty: saved to '
        '~/.ros/camera_info/CAMERA_NAME.yaml, as camera_info_manager does, and not loaded.',
        read_only=True,
    )
    camera_name: str = parameter(
        'camera',
        'Name of the camera in the calibration file. Of a file of Kalibr with several cameras, it '
        'selects one by its key, such as cam1, or a part of its topic.',
        read_only=True,
    )
    save_when_calibrated: bool = parameter(
        False,
        'Whether the calibration is saved as soon as the camera is calibrated, again whenever a '
        'standard deviation has fallen by a third, and at shutdown.',
    )
    set_camera_info_service: str = parameter(
        '',
        'Service (sensor_msgs/SetCameraInfo), usually of the camera driver, that receives the '
        'calibration once, as soon as the camera is calibrated. Empty: none.',
        read_only=True,
    )
    marker: MarkerOptions = field(default_factory=MarkerOptions)
    detections: DetectionsOptions = field(default_factory=DetectionsOptions)
    tag_detections: DetectionsOptions = DetectionsOptions('aruco_cw_from_top_left', 0.0)
    image: ImageOptions = field(default_factory=ImageOptions)
    robust: EstimateOptions = NODE_ESTIMATE

    def __post_init__(self) -> None:
        # It is part of a file name, and camera_info_manager accepts no other characters.
        if re.fullmatch(r'\w+', self.camera_name, re.ASCII) is None:
            raise ConfigError(
                f'camera_name: expected letters, digits and _, got {self.camera_name!r}'
            )
