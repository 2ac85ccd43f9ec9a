# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""``p4pfr undistort``: images as a pinhole camera sees them."""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from functools import partial
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from p4pfr_ros import CameraInfoModel, DivisionCamera
from p4pfr_ros.cli.arguments import (
    add_source_arguments,
    checked_sources,
    in_range,
    print_reasons,
)
from p4pfr_ros.cli.terminal import with_progress
from p4pfr_ros.core.cameras.camera_info import COEFFICIENTS
from p4pfr_ros.files.calibration import Calibration, load_calibration, save_calibration
from p4pfr_ros.files.image_sources import find_images, NamedImage, open_source
from p4pfr_ros.files.images import Decoding, uncalibrated_size, write_image
from p4pfr_ros.files.yaml_fields import ConfigError
from p4pfr_ros.report.drawing import remap, straightened_camera, straightening_map

CAMERA_FILE = 'camera.yaml'
_EPILOG = """\
Each image file is written to DIR under its own name, each frame of a video or
bag as a PNG. The size stays; pixels outside the original image are black.

The undistorted images are those of a pinhole camera without distortion, which
is written to DIR/camera.yaml: p4pfr estimate --camera DIR/camera.yaml reads
it. It covers the field of view of the lens up to --max-fov.
"""


def add_parser(commands: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    """Add the command to the parser."""
    text = 'undistort images by a calibration file'
    parser = commands.add_parser(
        'undistort',
        help=text,
        description=f'{text[0].upper()}{text[1:]}.',
        epilog=_EPILOG,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.set_defaults(run=run, usage_error=parser.error)
    add = parser.add_argument
    add_source_arguments(parser)
    add('--camera', required=True, type=Path, metavar='FILE', help='calibration file (YAML)')
    add('-o', '--output', required=True, type=Path, metavar='DIR', help='folder to write to')
    add(
        '--max-fov',
        type=partial(in_range, low=1.0, high=170.0, is_integer=False),
        default=120.0,
        metavar='DEG',
        help='largest diagonal field of view, degrees (default: %(default)g)',
    )


def run(arguments: argparse.Namespace) -> int:
    """Undistort the images; return 1 if any was rejected."""
    paths = checked_sources(arguments)
    calibration = load_calibration(arguments.camera)
    camera = calibration.estimate.camera if calibration.estimate else calibration.model
    _prepare(arguments.output, find_images(paths))
    size, max_fov_deg = calibration.image_size, arguments.max_fov
    source_px = straightening_map(camera, size, max_fov_deg=max_fov_deg)
    rejected: list[tuple[str, str, str]] = []
    how = Decoding(max_megapixels=arguments.max_megapixels)
    written = 0
    with open_source(paths, arguments.topic, arguments.every, arguments.max_megapixels) as source:
        for frame in with_progress(source.frames, source.count, prints=False):
            named = frame.load(how)
            reason = _write(arguments.output, named, source_px)
            if reason:
                rejected.append((named.name, named.recording, reason))
            written += not reason
    print_reasons(rejected)
    if not written:
        raise ConfigError(f'{arguments.output}: not written: no image was undistorted')
    pinhole = straightened_camera(camera, size, max_fov_deg=max_fov_deg)
    output = arguments.output / CAMERA_FILE
    save_calibration(output, _pinhole(pinhole, size, calibration.camera_name))
    print(f'{arguments.output}: {written} image{"s" * (written > 1)} and {CAMERA_FILE} written')
    return int(bool(rejected))


def _write(folder: Path, named: NamedImage, source_px: NDArray[np.float32]) -> str:
    """Write the undistorted image; return why it is rejected, or ''."""
    if isinstance(named.image, str):
        return named.image
    (height, width), got = source_px.shape[:2], named.image.shape[:2]
    reason = uncalibrated_size((width, height), (got[1], got[0]))
    if not reason:
        name = f'{named.file_stem}.png' if named.recording else Path(named.name).name
        write_image(folder / name, remap(named.image, source_px))
    return reason


def _prepare(folder: Path, paths: Sequence[Path]) -> None:
    """
    Create the folder, and check that no image is overwritten.

    Raises
    ------
    ConfigError
        The folder cannot be created, two images have one name, or it holds the images themselves.

    """
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise ConfigError(f'{folder}: {error.strerror}') from None
    by_name: dict[str, Path] = {}
    for path in paths:
        first = by_name.setdefault(path.name, path)
        if first is not path:
            raise ConfigError(f'{first} and {path} would be written to the same file')
        if path.resolve().parent == folder.resolve():
            raise ConfigError(
                f'{path}: expected another folder than {folder}, which is written to'
            )


def _pinhole(camera: DivisionCamera, image_size: tuple[int, int], name: str) -> Calibration:
    focal_px = (camera.focal_px, camera.focal_px)
    no_distortion = (0.0,) * COEFFICIENTS['plumb_bob']
    model = CameraInfoModel(
        'plumb_bob', no_distortion, focal_px, camera.center_px, 0.0, image_size
    )
    return Calibration(image_size=image_size, camera_name=name, model=model)
