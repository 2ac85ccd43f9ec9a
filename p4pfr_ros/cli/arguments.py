# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""Numbers of the command line, which argparse names where one raises, and shared options."""

from __future__ import annotations

import argparse
import math

from p4pfr_ros import EstimateOptions

_DEFAULTS = EstimateOptions()
_LARGEST_SEED = 2**31 - 1


def finite(text: str) -> float:
    """Read a number that is neither NaN nor infinite."""
    value = float(text)
    if not math.isfinite(value):
        raise ValueError
    return value


def positive(text: str) -> float:
    """Read a finite number above 0."""
    value = finite(text)
    if not value > 0.0:
        raise ValueError
    return value


def count(text: str) -> int:
    """Read a whole number from 1."""
    value = int(text)
    if value < 1:
        raise ValueError
    return value


def seed(text: str) -> int:
    """Read the seed of a random generator, as large as the nodes' parameters may be."""
    value = int(text)
    if not 0 <= value <= _LARGEST_SEED:
        raise argparse.ArgumentTypeError(f'expected 0 to {_LARGEST_SEED}, got {text}')
    return value


def add_threshold(parser: argparse.ArgumentParser) -> None:
    """Add the option that says what an outlier is."""
    parser.add_argument(
        '--threshold',
        type=positive,
        default=_DEFAULTS.threshold_px,
        metavar='PX',
        help='a point farther from its reprojection is an outlier (default: %(default)s)',
    )


def add_seed(parser: argparse.ArgumentParser) -> None:
    """Add the option that says which random samples are drawn."""
    parser.add_argument(
        '--seed',
        type=seed,
        default=_DEFAULTS.seed,
        help='of the random samples (default: %(default)s)',
    )
