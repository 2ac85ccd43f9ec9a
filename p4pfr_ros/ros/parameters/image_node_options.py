# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""The parameters of the nodes that process images: detector_node and camera_simulator."""

from __future__ import annotations

from dataclasses import dataclass, field

from p4pfr_ros.files.images import DEFAULT_DECODING

from .declare import parameter
from ..conversions import LARGEST_IMAGE_PX
from ..runtime.following import RELIABILITIES


@dataclass(frozen=True, slots=True)
class ImageTopicOptions:
    """The topic of the images, and how they are decoded."""

    transport: str = parameter(
        'raw',
        'raw: sensor_msgs/Image on the topic image; compressed: sensor_msgs/CompressedImage '
        'on the topic image/compressed.',
        choices=('raw', 'compressed'),
        read_only=True,
    )
    reliability: str = parameter(
        'auto',
        'QoS of the subscription: auto: as its publishers offer, reliable if all of them are; '
        'reliable or best_effort: always. A QoS override takes precedence.',
        choices=RELIABILITIES,
        read_only=True,
    )
    max_megapixels: float = parameter(
        DEFAULT_DECODING.max_megapixels,
        'Larger images are rejected before they are decoded, millions of pixels.',
        low=0.01,
        high=10_000.0,
    )
    deep_levels: str = parameter(
        'content',
        'Levels of 16-bit images: content: those that the image uses become 0 to 255, if they are '
        'less than half of the range; range: the whole range does.',
        choices=('content', 'range'),
    )


@dataclass(frozen=True, slots=True)
class DetectorNodeOptions:
    """Parameters of detector_node."""

    board_file: str = parameter(
        '',
        'Path of the YAML file that describes the board or boards. Required.',
        read_only=True,
    )
    opencv_threads: int = parameter(
        1,
        'Threads of OpenCV in this process. More than one takes more CPU time for each image, and '
        'gains little below 2 megapixels.',
        low=1,
        high=64,
        read_only=True,
    )
    min_marker_px: float = parameter(
        14.0,
        'Side of the smallest markers that are searched, pixels. Larger values save time; below '
        '12 px, the search takes four times as long.',
        low=4.0,
        high=10_000.0,
    )
    image: ImageTopicOptions = field(default_factory=ImageTopicOptions)


@dataclass(frozen=True, slots=True)
class SimulatedCameraOptions:
    """The simulated camera."""

    width_px: int = parameter(
        640, 'Width of the image, pixels.', low=32, high=LARGEST_IMAGE_PX, read_only=True
    )
    height_px: int = parameter(
        480, 'Height of the image, pixels.', low=32, high=LARGEST_IMAGE_PX, read_only=True
    )
    focal_px: float = parameter(
        520.0, 'Focal length at the centre of the image, pixels.', low=1.0, high=100_000.0
    )
    k: float = parameter(
        -0.25,
        'Distortion of the division model, dimensionless; negative is barrel.',
        low=-5.0,
        high=5.0,
    )
    noise_sigma: float = parameter(
        2.0, 'Standard deviation of the pixel noise, grey levels.', low=0.0, high=255.0
    )
    blur_sigma_px: float = parameter(
        0.5, 'Standard deviation of the Gaussian blur of the lens, pixels.', low=0.0, high=100.0
    )
    frame_id: str = parameter(
        'camera_optical_frame', 'Optical frame of all messages: x right, y down, z forward.'
    )


@dataclass(frozen=True, slots=True)
class PathOptions:
    """The motion of the board in front of the camera."""

    seed: int = parameter(0, 'Seed of the path.', low=0, high=2**31 - 1, read_only=True)
    speed: float = parameter(
        1.0,
        'Speed along the path; 1 is a board moved slowly by hand.',
        low=0.0,
        high=100.0,
    )


@dataclass(frozen=True, slots=True)
class CameraSimulatorOptions:
    """Parameters of camera_simulator."""

    board_file: str = parameter(
        '', 'Path of the YAML file that describes the board. Required.', read_only=True
    )
    rate_hz: float = parameter(10.0, 'Images per second.', low=0.01, high=1000.0, read_only=True)
    camera: SimulatedCameraOptions = field(default_factory=SimulatedCameraOptions)
    path: PathOptions = field(default_factory=PathOptions)
