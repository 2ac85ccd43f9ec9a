# SPDX-License-Identifier: Apache-2.0
"""The parameters of each node: names, defaults, ranges and what they mean, once."""

from __future__ import annotations

from dataclasses import asdict, dataclass, field

from p4pfr_ros import RansacOptions
from p4pfr_ros.files import ConfigError

from .conversions import CORNER_ORDERS
from .parameters import parameter

_RANSAC = RansacOptions()
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


@dataclass(frozen=True, slots=True)
class ImageSizeOptions:
    """The picture's size where nobody publishes ``camera_info``."""

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


@dataclass(frozen=True, slots=True)
class RobustOptions:
    """The search for the pose among wrong correspondences (RANSAC)."""

    threshold_px: float = parameter(
        _RANSAC.threshold_px,
        'A correspondence is an inlier when its reprojection error is below this, pixels.',
        low=0.01,
        high=1000.0,
    )
    confidence: float = parameter(
        _RANSAC.confidence,
        'Of having drawn one sample without a wrong correspondence when the search stops.',
        low=0.5,
        high=0.999999,
    )
    min_iterations: int = parameter(
        _RANSAC.min_iterations,
        'Samples of four points that are tried at least.',
        low=1,
        high=1_000_000,
    )
    max_iterations: int = parameter(
        _RANSAC.max_iterations,
        'Samples of four points that are tried at most.',
        low=1,
        high=1_000_000,
    )
    min_inliers: int = parameter(
        _RANSAC.min_inliers,
        'Of a board with more than four points: when fewer agree, there is no answer.',
        low=4,
        high=1_000_000,
    )
    min_fov_deg: float = parameter(
        _RANSAC.min_fov_deg,
        'Narrowest field of view that the camera may have, along the diagonal, degrees.',
        low=0.1,
        high=359.0,
    )
    max_fov_deg: float = parameter(
        _RANSAC.max_fov_deg,
        'Widest field of view that the camera may have, along the diagonal, degrees.',
        low=0.2,
        high=359.9,
    )
    max_distortion: float = parameter(
        _RANSAC.max_distortion,
        "Largest distortion that the lens may have: |k| |d|^2 at the picture's corner.",
        low=1e-6,
        high=100.0,
    )
    seed: int = parameter(
        _RANSAC.seed,
        'Seed of the random samples: same input and seed, same output.',
        low=0,
        high=2**31 - 1,
    )

    def __post_init__(self) -> None:
        try:
            self.ransac()
        except ValueError as error:  # two that do not go together
            raise ConfigError(f'robust.{error}') from None

    def ransac(self) -> RansacOptions:
        """Return what the solver takes: all of these by the same names."""
        return RansacOptions(**asdict(self))


@dataclass(frozen=True, slots=True)
class PoseNodeOptions:
    """Parameters of pose_node."""

    marker: MarkerOptions = field(default_factory=MarkerOptions)
    image: ImageSizeOptions = field(default_factory=ImageSizeOptions)
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
