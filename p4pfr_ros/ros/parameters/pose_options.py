# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""The parameters of pose_node and of lifecycle_pose_node, which are the same."""

from __future__ import annotations

from dataclasses import dataclass, field
import re

from p4pfr_ros.files.yaml_fields import ConfigError

from .calibration_options import SelfCalibrationOptions
from .declare import parameter
from .intrinsics_options import IntrinsicsOptions
from .robust_options import RobustOptions
from ..conversions import CORNER_ORDERS, LARGEST_IMAGE_PX


@dataclass(frozen=True, slots=True)
class MarkerOptions:
    """The marker whose corners come on the topic ``corners``."""

    size_m: float = parameter(
        0.0,
        'Side of the marker: outer edge of its black border, metres. 0: not known, and messages '
        'on the topic corners are rejected.',
        low=0.0,
        high=1000.0,
    )
    corner_order: str = parameter(
        'aruco_cw_from_top_left',
        "Order of the four corners: OpenCV's ArUco (clockwise from the top left) or AprilTag's "
        '(counter-clockwise from the bottom left), as seen on the upright printed marker.',
        choices=tuple(CORNER_ORDERS),
    )
    pixel_center_px: float = parameter(
        0.0,
        'Coordinate of the middle of the first pixel in the corners: 0 as in ROS and OpenCV, 0.5 '
        "as in AprilTag's own library. It is subtracted from them.",
        low=0.0,
        high=0.5,
    )


@dataclass(frozen=True, slots=True)
class DetectionsOptions:
    """The detector whose tags come on the topic ``detections``: apriltag_ros by default."""

    corner_order: str = parameter(
        'apriltag_ccw_from_bottom_left',
        'Order of the four corners of a detection, as seen on the upright printed tag.',
        choices=tuple(CORNER_ORDERS),
    )
    pixel_center_px: float = parameter(
        0.5,
        'Coordinate of the middle of the first pixel in the detections. It is subtracted.',
        low=0.0,
        high=0.5,
    )


@dataclass(frozen=True, slots=True)
class ImageOptions:
    """The picture's size where nobody publishes ``camera_info``, and its optical centre."""

    width_px: int = parameter(
        0,
        'Width of the full raw picture, used until a camera_info has come. 0: not known.',
        low=0,
        high=LARGEST_IMAGE_PX,
    )
    height_px: int = parameter(
        0,
        'Height of the full raw picture, used until a camera_info has come. 0: not known.',
        low=0,
        high=LARGEST_IMAGE_PX,
    )
    center_x_px: float = parameter(
        -1.0,
        'Optical centre of the lens in the full raw picture, x, in the modes per_frame and fixed. '
        '-1: the middle of the picture.',
        low=-1.0,
        high=float(LARGEST_IMAGE_PX),
    )
    center_y_px: float = parameter(
        -1.0,
        'Optical centre of the lens in the full raw picture, y, in the modes per_frame and fixed. '
        '-1: the middle of the picture.',
        low=-1.0,
        high=float(LARGEST_IMAGE_PX),
    )

    def center_px(self, size: tuple[int, int]) -> tuple[float, float]:
        """Return the optical centre in a full raw picture of a size, px."""
        x, y = self.center_x_px, self.center_y_px
        return (0.5 * (size[0] - 1) if x < 0.0 else x, 0.5 * (size[1] - 1) if y < 0.0 else y)


@dataclass(frozen=True, slots=True)
class PoseNodeOptions:
    """Parameters of pose_node."""

    enabled: bool = parameter(
        True, 'Whether messages are answered; the service ~/set_enabled changes it too.'
    )
    board_file: str = parameter(
        '',
        'Path of the YAML file of the boards on the topics correspondences and detections; their '
        'names are their frames. With several boards each has topics of its own, such as '
        '~/NAME/pose. Empty: one board, without a name.',
        read_only=True,
    )
    board_frame: str = parameter(
        '',
        "The board's frame in /tf and on ~/markers. Empty: its name, or board where it has none. "
        'Before the names of several boards it stands with a slash.',
    )
    publish_tf: bool = parameter(
        False, 'Whether poses are published on /tf too, which takes the package tf2_ros.'
    )
    invert_tf: bool = parameter(
        False,
        'On /tf, give the pose of the camera in the frame of the board. For one board alone: with '
        'several, the camera would have as many parents, and in /tf a frame has one.',
    )
    intrinsics: IntrinsicsOptions = field(default_factory=IntrinsicsOptions)
    calibration: SelfCalibrationOptions = field(default_factory=SelfCalibrationOptions)
    calibration_file: str = parameter(
        '',
        'Where the calibration is loaded from at the start, if it is there, and saved to: a path '
        'or a file:// URL. Empty: saved as camera_info_manager has it, to '
        '~/.ros/camera_info/CAMERA_NAME.yaml, and not loaded.',
        read_only=True,
    )
    camera_name: str = parameter(
        'camera', "The camera's name in the file of its calibration.", read_only=True
    )
    save_when_calibrated: bool = parameter(
        False, 'Whether the calibration is saved by itself as soon as it is good.'
    )
    set_camera_info_service: str = parameter(
        '',
        "Service (sensor_msgs/SetCameraInfo), most often the camera driver's, that is called "
        'once as soon as the calibration is good. Empty: none.',
        read_only=True,
    )
    marker: MarkerOptions = field(default_factory=MarkerOptions)
    detections: DetectionsOptions = field(default_factory=DetectionsOptions)
    image: ImageOptions = field(default_factory=ImageOptions)
    robust: RobustOptions = field(default_factory=RobustOptions)

    def __post_init__(self) -> None:
        # It becomes part of a file's name, and camera_info_manager takes no other.
        if re.fullmatch(r'\w+', self.camera_name, re.ASCII) is None:
            raise ConfigError(
                f'camera_name: expected letters, digits and _, got {self.camera_name!r}'
            )
