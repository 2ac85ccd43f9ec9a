# SPDX-License-Identifier: Apache-2.0
"""The parameters of each node: names, defaults, ranges and what they mean, once."""

from __future__ import annotations

from dataclasses import dataclass, field

from .conversions import CORNER_ORDERS
from .parameters import parameter
from .robust_options import RobustOptions

_LARGEST_IMAGE_PX = 65535


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
class ImageOptions:
    """The picture's size where nobody publishes ``camera_info``, and its optical centre."""

    width_px: int = parameter(
        0,
        'Width of the full raw picture, used until a camera_info has come. 0: not known.',
        low=0,
        high=_LARGEST_IMAGE_PX,
    )
    height_px: int = parameter(
        0,
        'Height of the full raw picture, used until a camera_info has come. 0: not known.',
        low=0,
        high=_LARGEST_IMAGE_PX,
    )
    center_x_px: float = parameter(
        -1.0,
        'Optical centre of the lens in the full raw picture, x. -1: the middle of the picture.',
        low=-1.0,
        high=float(_LARGEST_IMAGE_PX),
    )
    center_y_px: float = parameter(
        -1.0,
        'Optical centre of the lens in the full raw picture, y. -1: the middle of the picture.',
        low=-1.0,
        high=float(_LARGEST_IMAGE_PX),
    )

    def center_px(self, size: tuple[int, int]) -> tuple[float, float]:
        """Return the optical centre in a full raw picture of a size, px."""
        x, y = self.center_x_px, self.center_y_px
        return (0.5 * (size[0] - 1) if x < 0.0 else x, 0.5 * (size[1] - 1) if y < 0.0 else y)


@dataclass(frozen=True, slots=True)
class PoseNodeOptions:
    """Parameters of pose_node."""

    marker: MarkerOptions = field(default_factory=MarkerOptions)
    image: ImageOptions = field(default_factory=ImageOptions)
    robust: RobustOptions = field(default_factory=RobustOptions)


@dataclass(frozen=True, slots=True)
class TransportOptions:
    """How pictures come."""

    transport: str = parameter(
        'raw',
        'raw: sensor_msgs/Image on the topic image; compressed: sensor_msgs/CompressedImage '
        'on the topic image/compressed.',
        choices=('raw', 'compressed'),
        read_only=True,
    )


@dataclass(frozen=True, slots=True)
class DetectorNodeOptions:
    """Parameters of detector_node."""

    board_file: str = parameter(
        '', 'Path of the YAML file that describes the board. Required.', read_only=True
    )
    image: TransportOptions = field(default_factory=TransportOptions)


@dataclass(frozen=True, slots=True)
class SimulatedCameraOptions:
    """The camera that camera_simulator looks through."""

    width_px: int = parameter(
        640, 'Width of the picture, pixels.', low=32, high=_LARGEST_IMAGE_PX, read_only=True
    )
    height_px: int = parameter(
        480, 'Height of the picture, pixels.', low=32, high=_LARGEST_IMAGE_PX, read_only=True
    )
    focal_px: float = parameter(
        520.0, 'Focal length at the centre of the picture, pixels.', low=1.0, high=100_000.0
    )
    k: float = parameter(
        -0.25,
        'Distortion by the division model, dimensionless; negative is barrel.',
        low=-5.0,
        high=5.0,
    )
    noise_sigma: float = parameter(
        2.0, "Standard deviation of the pixels' noise, grey levels.", low=0.0, high=255.0
    )
    blur_sigma_px: float = parameter(
        0.5, "Standard deviation of the lens's blur, pixels.", low=0.0, high=100.0
    )
    frame_id: str = parameter(
        'camera_optical_frame', 'Optical frame of all messages: x right, y down, z forward.'
    )


@dataclass(frozen=True, slots=True)
class PathOptions:
    """How the board moves in front of the camera."""

    seed: int = parameter(0, 'Which path the board takes.', low=0, high=2**31 - 1, read_only=True)
    speed: float = parameter(
        1.0, 'How fast time passes on the path; 1 is a leisurely hand.', low=0.0, high=100.0
    )


@dataclass(frozen=True, slots=True)
class CameraSimulatorOptions:
    """Parameters of camera_simulator."""

    board_file: str = parameter(
        '', 'Path of the YAML file that describes the board. Required.', read_only=True
    )
    rate_hz: float = parameter(10.0, 'Pictures per second.', low=0.01, high=1000.0, read_only=True)
    camera: SimulatedCameraOptions = field(default_factory=SimulatedCameraOptions)
    path: PathOptions = field(default_factory=PathOptions)
