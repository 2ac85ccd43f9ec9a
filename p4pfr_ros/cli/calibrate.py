# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""``p4pfr calibrate``: pictures or a recording of a board to a camera's calibration."""

from __future__ import annotations

import argparse
from contextlib import AbstractContextManager, nullcontext
from pathlib import Path
import sys

from p4pfr_ros import CalibrationState, EstimateOptions
from p4pfr_ros.cli.arguments import add_seed, add_threshold, count
from p4pfr_ros.cli.calibration_report import (
    print_calibration_json,
    print_misses,
    print_summary,
    print_view_json,
    print_views,
)
from p4pfr_ros.cli.picture_sources import from_bag, from_files, PictureSource
from p4pfr_ros.cli.progress import with_progress
from p4pfr_ros.files.boards import load_board
from p4pfr_ros.files.calibration import Calibration, save_calibration
from p4pfr_ros.files.writing import check_writable
from p4pfr_ros.files.yaml_fields import ConfigError
from p4pfr_ros.report.calibration_run import PictureCalibration

_EPILOG = """\
The pictures are taken in their order, as a robot's camera would see them, and
each gets a verdict: what it did for the calibration. Those without the board
are named on stderr, and cost nothing else. All must be of one size.

The file is camera_calibration's YAML, which camera drivers load. It is written
when the camera is calibrated, that is, known well enough; else nothing is, the
reason is on stderr, and the exit status is 1. --force writes what there is.
The report of --plot is written in either case: it shows what is missing.

--json prints one JSON object per picture and line, and then one with the
camera, or with null if there is none. Lengths are pixels; sigma holds standard
deviations, null where a number was held and not estimated.
"""


def add_parser(commands: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    """Describe the command to argparse."""
    parser = commands.add_parser(
        'calibrate',
        help='calibrate a camera from pictures or a bag of a board',
        epilog=_EPILOG,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.set_defaults(run=run, usage_error=parser.error)
    add = parser.add_argument
    add('images', nargs='*', type=Path, metavar='IMAGE', help='picture, or directory of them')
    add('--bag', type=Path, metavar='BAG', help='rosbag2 instead: directory, .db3 or .mcap file')
    add('--topic', help="the bag's topic (default: the only one that has pictures)")
    add('--every', type=count, default=1, metavar='N', help='take every N-th picture only')
    add('--board', required=True, metavar='FILE', help='the board, in YAML')
    add('-o', '--output', required=True, type=Path, metavar='FILE', help='where to, in YAML')
    add('--name', default='camera', help='camera_name in there (default: %(default)s)')
    add('--plot', type=Path, metavar='FILE', help='write a report there: a .png, .svg or .pdf')
    add('--json', action='store_true', help='print JSON lines instead of a table')
    add('--force', action='store_true', help='write a camera that is not yet known well too')
    add_threshold(parser)
    add_seed(parser)


def run(arguments: argparse.Namespace) -> int:
    """Calibrate; return 1 if nothing was written."""
    if bool(arguments.images) == bool(arguments.bag):
        arguments.usage_error('expected pictures or --bag, one of the two')
    if arguments.topic and not arguments.bag:
        arguments.usage_error('--topic is of a --bag')
    _check_places(arguments)
    robust = EstimateOptions(threshold_px=arguments.threshold, seed=arguments.seed)
    pictures = PictureCalibration(load_board(arguments.board), robust)
    with _source(arguments) as source:
        for named in with_progress(source.pictures, source.count, prints=arguments.json):
            seen = pictures.look_at(named)
            if arguments.json:
                print_view_json(seen)
    calibration = _calibration(pictures, arguments.name)
    if arguments.json:
        print_calibration_json(pictures, calibration)
    else:
        print_views(pictures)
        print_misses(pictures.misses, source.name if arguments.bag else None)
        print_summary(pictures, calibration)
    return _write(arguments, pictures, calibration)


def _check_places(arguments: argparse.Namespace) -> None:
    """See that the results can be written, before anybody waits for them."""
    check_writable(arguments.output)
    if arguments.plot:
        # matplotlib is behind it, which takes a while.
        from p4pfr_ros.report.plots import check_ending

        check_ending(arguments.plot)
        check_writable(arguments.plot)


def _source(arguments: argparse.Namespace) -> AbstractContextManager[PictureSource]:
    if arguments.bag:
        return from_bag(arguments.bag, arguments.topic, arguments.every)
    return nullcontext(from_files(arguments.images, arguments.every))


def _calibration(pictures: PictureCalibration, name: str) -> Calibration | None:
    if pictures.calibration is None or pictures.fused is None:
        return None
    size = pictures.calibration.image_size
    model = pictures.fused.camera.to_camera_info_model(size)
    return Calibration(image_size=size, camera_name=name, model=model, estimate=pictures.fused)


def _write(
    arguments: argparse.Namespace, pictures: PictureCalibration, calibration: Calibration | None
) -> int:
    if calibration is None or pictures.calibration is None:
        reason = 'no picture shows the board' if not pictures.sightings else 'no view tells enough'
        raise ConfigError(f'{arguments.output}: not written: {reason}')
    if arguments.plot:
        from p4pfr_ros.report.plots import write_report

        write_report(arguments.plot, pictures.calibration, pictures.sightings)
    state = pictures.calibration.state
    if state is not CalibrationState.CALIBRATED and not arguments.force:
        print(
            f'p4pfr: {arguments.output}: not written: {state.value} '
            '(more views, tilted and up to the corners, or --force)',
            file=sys.stderr,
        )
        return 1
    save_calibration(arguments.output, calibration)
    if not arguments.json:
        print(f'{arguments.output}: written')
    return 0
