# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""The parameters of each node: names, defaults, ranges and what they mean, once."""

from __future__ import annotations

from dataclasses import dataclass, field

from .declare import parameter
from .pose_options import PoseNodeOptions
from ..conversions import LARGEST_IMAGE_PX

__all__ = ['CameraSimulatorOptions', 'DetectorNodeOptions', 'PoseNodeOptions']


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
        '',
        'Path of the YAML file that describes the board, or several boards. Required.',
        read_only=True,
    )
    image: TransportOptions = field(default_factory=TransportOptions)


@dataclass(frozen=True, slots=True)
class SimulatedCameraOptions:
    """The camera that camera_simulator looks through."""

    width_px: int = parameter(
        640, 'Width of the picture, pixels.', low=32, high=LARGEST_IMAGE_PX, read_only=True
    )
    height_px: int = parameter(
        480, 'Height of the picture, pixels.', low=32, high=LARGEST_IMAGE_PX, read_only=True
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
