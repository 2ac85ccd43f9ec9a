# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""Shared by the commands: argument types, options, input images, optional dependencies."""

from __future__ import annotations

import argparse
from collections.abc import Iterable
from functools import partial
from importlib.util import find_spec
import math
from pathlib import Path

from p4pfr_ros import EstimateOptions
from p4pfr_ros.core.options import option_of
from p4pfr_ros.files.yaml_fields import ConfigError

_DEFAULTS = EstimateOptions()
_SUFFIXES = {'.bmp', '.jpeg', '.jpg', '.pbm', '.pgm', '.png', '.ppm', '.tif', '.tiff', '.webp'}
# By module: the features that need it, and the extra of pip that installs it.
_EXTRAS = {
    'aiohttp': ('web pages', 'live'),
    'matplotlib': ('plots and printed boards', 'plot'),
    'rich': ('tables', 'cli'),
}


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


def in_range(text: str, *, low: float, high: float, is_integer: bool) -> float:
    """Parse a number from low to high."""
    try:
        value = int(text) if is_integer else float(text)
    except ValueError:
        value = math.nan
    if not low <= value <= high:
        kind = 'an integer' if is_integer else 'a number'
        raise argparse.ArgumentTypeError(
            f'expected {kind} from {low:.10g} to {high:.10g}, got {text}'
        )
    return value


def add_estimate_option(
    parser: argparse.ArgumentParser | argparse._ArgumentGroup, flag: str, name: str, metavar: str
) -> None:
    """Add an option for a field of `EstimateOptions`, with its default, range and description."""
    default, option = getattr(_DEFAULTS, name), option_of(EstimateOptions, name)
    assert option.low is not None
    assert option.high is not None
    parser.add_argument(
        flag,
        type=partial(
            in_range, low=option.low, high=option.high, is_integer=isinstance(default, int)
        ),
        default=default,
        metavar=metavar,
        help=description_of(name) + ('' if default is None else ' (default: %(default)s)'),
    )


def add_estimate_switch(parser: argparse.ArgumentParser, flag: str, name: str) -> None:
    """Add a flag that turns on a field of `EstimateOptions`, with its description."""
    parser.add_argument(flag, action='store_true', help=description_of(name))


def description_of(name: str) -> str:
    """Return the description of a field of `EstimateOptions` in the style of argparse."""
    text = option_of(EstimateOptions, name).description.removesuffix('.').replace('%', '%%')
    return f'{text[0].lower()}{text[1:]}'


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
