# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""Shared by the commands: argument types, options, sources of images, messages."""

from __future__ import annotations

import argparse
from collections import Counter
from collections.abc import Iterable
from functools import partial
import math
from pathlib import Path
import sys

from p4pfr_ros import EstimateOptions
from p4pfr_ros.boards import Board
from p4pfr_ros.boards.units import unit_note
from p4pfr_ros.cli.workers import available_cores
from p4pfr_ros.core.options import option_of
from p4pfr_ros.files.boards import load_board
from p4pfr_ros.files.image_sources import is_bag
from p4pfr_ros.files.images import DEFAULT_DECODING

_DEFAULTS = EstimateOptions()


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


def add_source_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments that say where the images come from."""
    add = parser.add_argument
    add(
        'images',
        nargs='*',
        type=Path,
        metavar='IMAGE',
        help='image, directory of images, video, or bag; - reads images or a video from stdin',
    )
    add('--bag', type=Path, metavar='BAG', help='rosbag2 to read: directory, .db3 or .mcap file')
    add('--topic', help="image topic in the bag (default: the bag's only image topic)")
    add('--every', type=count, default=1, metavar='N', help='use every N-th image only')
    add(
        '--max-megapixels',
        type=positive,
        default=DEFAULT_DECODING.max_megapixels,
        metavar='N',
        help='larger images are rejected before they are decoded (default: %(default)g)',
    )


def add_jobs(parser: argparse.ArgumentParser) -> None:
    """Add the number of processes."""
    parser.add_argument(
        '--jobs',
        type=count,
        default=available_cores(),
        metavar='N',
        help='largest number of processes; the results are the same (default: %(default)s, all '
        'cores)',
    )


def checked_sources(arguments: argparse.Namespace) -> list[Path]:
    """Return the paths of the sources; exit with a usage error if they contradict each other."""
    if bool(arguments.images) == bool(arguments.bag):
        arguments.usage_error('expected either images or --bag')
    paths = [arguments.bag] if arguments.bag else arguments.images
    if arguments.topic and not (arguments.bag or any(map(is_bag, paths))):
        arguments.usage_error('--topic requires --bag')
    return list(paths)


def load_board_with_notes(path: str) -> Board:
    """Load the only board of a file; print to stderr what may be wrong about its lengths."""
    board = load_board(path)
    note = unit_note(board)
    if note:
        print(f'p4pfr: {path}: warning: {note}', file=sys.stderr)
    return board


def print_reasons(rejected: Iterable[tuple[str, str, str]]) -> None:
    """
    Print to stderr why images were rejected: (name, recording, reason) of each.

    For the frames of a recording, the number of images per reason.
    """
    frames: Counter[tuple[str, str]] = Counter()
    for name, recording, reason in rejected:
        if recording:
            frames[recording, reason] += 1
        else:
            print(f'p4pfr: {name}: {reason}', file=sys.stderr)
    for (recording, reason), number in frames.most_common():
        images = '1 image' if number == 1 else f'{number} images'
        print(f'p4pfr: {recording}: {images}: {reason}', file=sys.stderr)
