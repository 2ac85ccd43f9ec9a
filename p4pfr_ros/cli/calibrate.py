# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""``p4pfr calibrate``: a camera from many images."""

from __future__ import annotations

import argparse
from collections import Counter
from collections.abc import Iterator, Sequence
from functools import partial
import json
import math
from pathlib import Path
import sys
from typing import Any

from p4pfr_ros import CalibrationState, EstimateOptions, Verdict
from p4pfr_ros.boards import Board
from p4pfr_ros.cli.arguments import (
    add_estimate_option,
    add_estimate_switch,
    add_jobs,
    add_source_arguments,
    checked_sources,
    load_board_with_notes,
    print_reasons,
)
from p4pfr_ros.cli.terminal import prepare_kernels, print_table, with_progress
from p4pfr_ros.cli.workers import in_order
from p4pfr_ros.files.calibration import Calibration, load_calibration, save_calibration
from p4pfr_ros.files.dependencies import require
from p4pfr_ros.files.image_sources import Frame, open_source
from p4pfr_ros.files.images import Decoding
from p4pfr_ros.files.writing import check_writable
from p4pfr_ros.files.yaml_fields import ConfigError
from p4pfr_ros.report.calibration_run import (
    CalibrationRun,
    detect_in,
    DetectedImage,
    RejectedImage,
    ViewRecord,
)
from p4pfr_ros.report.camera_json import camera_info_as_json, estimate_as_json
from p4pfr_ros.report.number_format import lens_terms, plus_minus, shape_text

_EPILOG = """\
Images are processed in the given order, like those of a running camera, and
must all have the same size. The verdict of a view states how the calibration
used it. Images without the board are reported on stderr and otherwise ignored.

The output is a YAML file of camera_calibration, which camera drivers load. It
is written if the camera is calibrated, that is, if all uncertainties are
within tolerance; otherwise the reason is printed to stderr and the exit status
is 1. --force writes an uncalibrated camera as well. The reports of --plot and
--report are written in either case.

With --json, each line is a JSON object for one image, and the last line holds
the camera, or null if there is none. Lengths are in pixels unless they have
another unit; sigma holds standard deviations, null for parameters that were
held fixed. projection_sigma_px is the largest standard deviation of a
projection where points were seen; scatter is 1 where lens and boards explain
all; boards holds the shape of each board; missing lists what would calibrate
the camera.
"""
_HEADINGS = ('', 'image', 'points', 'inliers', 'rms, px', 'f, px', 'verdict')
_UNKNOWN = '?'
# With more views than this, those that did not change the camera get no row.
_MAX_ROWS = 100
_NO_CHANGE = (Verdict.REDUNDANT, Verdict.NO_POSE)


def add_parser(commands: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    """Add the command to the parser."""
    parser = commands.add_parser(
        'calibrate',
        help='calibrate a camera from images or a bag of a board',
        description='Calibrate a camera from images or a bag of a board.',
        epilog=_EPILOG,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.set_defaults(run=run, usage_error=parser.error)
    add = parser.add_argument
    add_source_arguments(parser)
    add_jobs(parser)
    add('--board', required=True, metavar='FILE', help='board file (YAML)')
    add('-o', '--output', required=True, type=Path, metavar='FILE', help='output file (YAML)')
    add('--name', default='camera', help='camera_name in the output (default: %(default)s)')
    add('--plot', type=Path, metavar='FILE', help='write a report as .png, .svg or .pdf')
    add('--report', type=Path, metavar='FILE', help='write a report as one .html file')
    add(
        '--compare',
        type=Path,
        metavar='FILE',
        help='calibration file (YAML) to compare the camera with, in the report',
    )
    add('--json', action='store_true', help='print JSON lines instead of a table')
    add('--force', action='store_true', help='write the camera even if it is not calibrated')
    add_estimate_option(parser, '--threshold', 'threshold_px', 'PX')
    add_estimate_option(parser, '--seed', 'seed', 'N')
    add_estimate_switch(parser, '--two-sided', 'two_sided')


def run(arguments: argparse.Namespace) -> int:
    """Calibrate; return 1 if no calibration was written."""
    paths = checked_sources(arguments)
    _check(arguments)
    options = EstimateOptions(
        threshold_px=arguments.threshold, seed=arguments.seed, two_sided=arguments.two_sided
    )
    board = load_board_with_notes(arguments.board)
    calibration_run = CalibrationRun(board, options)
    other = load_calibration(arguments.compare) if arguments.compare else None
    prepare_kernels()
    how = Decoding(as_grey=True, max_megapixels=arguments.max_megapixels)
    with open_source(paths, arguments.topic, arguments.every, arguments.max_megapixels) as source:
        with_thumbnail = arguments.report is not None
        find = partial(_detect, how=how, board=board, with_thumbnail=with_thumbnail)
        detected = in_order(find, source.frames, source.count, arguments.jobs)
        for image in with_progress(detected, source.count, prints=arguments.json):
            result = calibration_run.add_detected(image)
            if arguments.json:
                _print_image_json(result)
    calibration = _calibration(calibration_run, arguments.name)
    if arguments.json:
        _print_calibration_json(calibration_run, calibration)
    else:
        print_views(calibration_run.records)
        print_reasons((r.name, r.recording, r.reason) for r in calibration_run.rejected)
        _print_summary(calibration_run, calibration)
    return _write(arguments, calibration_run, calibration, other)


def _detect(frame: Frame, how: Decoding, board: Board, *, with_thumbnail: bool) -> DetectedImage:
    return detect_in(frame.load(how), board, with_thumbnail=with_thumbnail)


def _check(arguments: argparse.Namespace) -> None:
    """Check what can be checked before the long computation."""
    if not arguments.json:
        require('rich')
    check_writable(arguments.output)
    if arguments.plot:
        require('matplotlib')
        from p4pfr_ros.report.plots import check_suffix  # imports matplotlib: slow

        check_suffix(arguments.plot)
        check_writable(arguments.plot)
    if arguments.compare and not arguments.report:
        arguments.usage_error('--compare requires --report')
    if arguments.report:
        if arguments.report.suffix.lower() not in ('.html', '.htm'):
            raise ConfigError(f'{arguments.report}: expected a file name ending in .html')
        check_writable(arguments.report)


def _calibration(calibration_run: CalibrationRun, name: str) -> Calibration | None:
    if calibration_run.calibration is None or calibration_run.fused is None:
        return None
    return Calibration.from_estimate(
        calibration_run.fused, calibration_run.calibration.image_size, name
    )


def _write(
    arguments: argparse.Namespace,
    calibration_run: CalibrationRun,
    calibration: Calibration | None,
    other: Calibration | None,
) -> int:
    if calibration is None or calibration_run.calibration is None:
        reason = (
            'the views do not determine the camera'
            if calibration_run.records
            else 'the board was not detected in any image'
        )
        raise ConfigError(f'{arguments.output}: not written: {reason}')
    if arguments.plot:
        from p4pfr_ros.report.plots import write_report

        write_report(arguments.plot, calibration_run.calibration, calibration_run.records)
    if arguments.report:
        from p4pfr_ros.report.html_report import OtherCamera, write_html_report

        compared = OtherCamera(str(arguments.compare), other) if other else None
        write_html_report(arguments.report, calibration_run, calibration, compared)
    state = calibration_run.calibration.state
    if state is not CalibrationState.CALIBRATED and not arguments.force:
        missing = '; '.join(calibration_run.calibration.missing)
        print(
            f'p4pfr: {arguments.output}: not written: {state.value}. Missing: {missing} '
            '(--force writes it nevertheless)',
            file=sys.stderr,
        )
        return 1
    backup = save_calibration(arguments.output, calibration)
    if backup is not None:
        print(f'p4pfr: {backup}: the old file, by another program', file=sys.stderr)
    if not arguments.json:
        print(f'{arguments.output}: written')
    return 0


def _print_image_json(result: ViewRecord | RejectedImage) -> None:
    """Print one line about an image: a JSON object without NaN."""
    line: dict[str, Any] = {'image': result.number, 'name': result.name}
    if isinstance(result, RejectedImage):
        line |= {'reason': result.reason}
    else:
        line |= {
            'points': result.points,
            'inliers': result.inliers,
            'rms_px': result.rms_px,
            'verdict': _word(result.verdict),
            'camera': estimate_as_json(result.fused) if result.fused else None,
        }
    print(json.dumps(line, allow_nan=False), flush=True)


def _print_calibration_json(
    calibration_run: CalibrationRun, calibration: Calibration | None
) -> None:
    """Print the last line: the calibration."""
    line: dict[str, Any] = {'calibration': None}
    if (
        calibration is not None
        and calibration_run.calibration is not None
        and calibration_run.fused is not None
    ):
        line['calibration'] = {
            'state': calibration_run.calibration.state.name.lower(),
            'image_size': list(calibration.image_size),
            **estimate_as_json(calibration_run.fused),
            'coverage': calibration_run.coverage,
            'missing': list(calibration_run.calibration.missing),
            'camera_info': camera_info_as_json(calibration.model),
        }
    print(json.dumps(line, allow_nan=False), flush=True)


def print_views(records: Sequence[ViewRecord]) -> None:
    """Print a row for each view; of more than 100, only for those that changed the camera."""
    if not records:
        return
    shown = records
    if len(records) > _MAX_ROWS:
        shown = [record for record in records if record.verdict not in _NO_CHANGE]
    print_table(_HEADINGS, map(_cells, shown), left=('image', 'verdict'), optional=('points',))
    for verdict, views in Counter(record.verdict for record in records).most_common():
        print(f'{views} {_word(verdict)}: {verdict.value}')
    print()


def _cells(record: ViewRecord) -> Iterator[str]:
    yield str(record.number)
    yield record.name
    yield str(record.points)
    yield str(record.inliers)
    yield f'{record.rms_px:.3f}'
    fused = record.fused
    yield plus_minus(fused.camera.focal_px, fused.focal_sigma_px) if fused else _UNKNOWN
    yield _word(record.verdict)


def _print_summary(calibration_run: CalibrationRun, calibration: Calibration | None) -> None:
    """Print the camera with its standard deviations, the fitted CameraInfo, and the boards."""
    if calibration is None or calibration_run.calibration is None or calibration_run.fused is None:
        return
    fused, model = calibration_run.fused, calibration.model
    x, y = map(plus_minus, fused.camera.center_px, fused.center_sigma_px)
    width, height = calibration.image_size
    print(calibration_run.calibration.state.value)
    print(
        f'  views        {fused.views} of {width}x{height} px, rms {fused.rms_px:.3f} px, '
        f'scatter {fused.scatter:.2f}'
    )
    print(f'  focal length {plus_minus(fused.camera.focal_px, fused.focal_sigma_px)} px')
    print(f'  centre       {x}, {y} px')
    for name, value, sigma in lens_terms(fused):
        print(f'  {name:<12} {plus_minus(value, sigma)}')
    print(f'  coverage     {100.0 * calibration_run.coverage:.0f} % of the image')
    if not math.isnan(fused.projection_sigma_px):
        print(f'  projection   {fused.projection_sigma_px:.2g} px at most where seen')
    print(
        f'  CameraInfo   {model.distortion_model}, within {model.residual_px:.2g} px of the above '
        f'where seen, {model.residual_outside_px:.2g} px outside'
    )
    for name, shape in fused.board_shapes.items():
        print(f'  board        {name}: {shape_text(shape)}')
    for advice in calibration_run.calibration.missing:
        print(f'  missing      {advice}')


def _word(verdict: Verdict) -> str:
    return verdict.name.lower()
