# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""What the commands share: argument types, options, input images, optional dependencies."""

from __future__ import annotations

import argparse
from collections.abc import Iterable
from importlib.util import find_spec
import math
from pathlib import Path

from p4pfr_ros import EstimateOptions
from p4pfr_ros.files.yaml_fields import ConfigError

_DEFAULTS = EstimateOptions()
_MAX_SEED = 2**31 - 1
_SUFFIXES = {'.bmp', '.jpeg', '.jpg', '.pbm', '.pgm', '.png', '.ppm', '.tif', '.tiff', '.webp'}
# By module: the features that need it, and the extra of pip that installs it.
_EXTRAS = {'matplotlib': ('plots and printed boards', 'plot'), 'rich': ('tables', 'cli')}


def finite(text: str) -> float:
    """Parse a number that is neither NaN nor infinite."""
    value = float(text)
    if not math.isfinite(value):
        raise ValueError
    return value


def positive(text: str) -> float:
    """Parse a finite number > 0."""
    value = finite(text)
    if not value > 0.0:
        raise ValueError
    return value


def count(text: str) -> int:
    """Parse an integer ≥ 1."""
    value = int(text)
    if value < 1:
        raise ValueError
    return value


def seed(text: str) -> int:
    """Parse the seed of a random generator, in the range of the nodes' parameter."""
    value = int(text)
    if not 0 <= value <= _MAX_SEED:
        raise argparse.ArgumentTypeError(f'expected 0 to {_MAX_SEED}, got {text}')
    return value


def add_threshold(parser: argparse.ArgumentParser) -> None:
    """Add the option for the inlier threshold."""
    parser.add_argument(
        '--threshold',
        type=positive,
        default=_DEFAULTS.threshold_px,
        metavar='PX',
        help='reprojection error above which a point is an outlier (default: %(default)s)',
    )


def add_seed(parser: argparse.ArgumentParser) -> None:
    """Add the option for the seed of the random sampling."""
    parser.add_argument(
        '--seed',
        type=seed,
        default=_DEFAULTS.seed,
        metavar='N',
        help='seed of the random sampling (default: %(default)s)',
    )


def find_images(paths: Iterable[Path]) -> list[Path]:
    """
    Replace directories by the images in them, sorted by name.

    Raises
    ------
    ConfigError
        A directory contains no image.

    """
    images: list[Path] = []
    for path in paths:
        if not path.is_dir():
            images.append(path)
            continue
        inside = sorted(p for p in path.iterdir() if p.suffix.lower() in _SUFFIXES)
        if not inside:
            raise ConfigError(f'{path}: expected a directory with images, got none')
        images += inside
    return images


def is_installed(module: str) -> bool:
    """Return whether an optional dependency is installed, without importing it."""
    return find_spec(module) is not None


def require(module: str) -> None:
    """
    Check that an optional dependency is installed.

    Raises
    ------
    ConfigError
        It is not; names the extra that installs it.

    """
    if not is_installed(module):
        features, extra = _EXTRAS[module]
        raise ConfigError(f"{features} need {module}: pip install 'p4pfr_ros[{extra}]'")
