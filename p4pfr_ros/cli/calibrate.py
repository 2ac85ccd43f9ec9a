# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""``p4pfr calibrate``: a camera from many images."""

from __future__ import annotations

import argparse
from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from contextlib import AbstractContextManager, contextmanager, nullcontext
from dataclasses import dataclass
import json
import math
from pathlib import Path
import sys
from typing import Any

from p4pfr_ros import BoardShape, CalibrationState, CameraEstimate, EstimateOptions, Verdict
from p4pfr_ros.cli.arguments import (
    add_estimate_option,
    add_estimate_switch,
    count,
    find_images,
    require,
)
from p4pfr_ros.cli.terminal import prepare_kernels, print_table, with_progress
from p4pfr_ros.files.boards import load_board
from p4pfr_ros.files.calibration import Calibration, save_calibration
from p4pfr_ros.files.images import image_or_reason, ImageArray
from p4pfr_ros.files.pixel_formats import Unreadable
from p4pfr_ros.files.writing import check_writable
from p4pfr_ros.files.yaml_fields import ConfigError
from p4pfr_ros.report.calibration_run import CalibrationRun, NamedImage, RejectedImage, ViewRecord
from p4pfr_ros.report.number_format import plus_minus, shape_text

_EPILOG = """\
Images are processed in the given order, like those of a running camera, and
must all have the same size. The verdict of a view states how the calibration
used it. Images without the board are reported on stderr and otherwise ignored.

The output is a YAML file of camera_calibration, which camera drivers load. It
is written if the camera is calibrated, that is, if all uncertainties are
within tolerance; otherwise the reason is printed to stderr and the exit status
is 1. --force writes an uncalibrated camera as well. The report of --plot is
written in either case.

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
_NS_PER_S = 1_000_000_000


@dataclass(frozen=True, slots=True, eq=False)
class ImageSource:
    """
    A sequence of images.

    Parameters
    ----------
    name
        Where the images come from.
    images
        The images, each read when it is needed.
    count
        Number of images, if known.

    """

    name: str
    images: Iterable[NamedImage]
    count: int | None


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
    add('images', nargs='*', type=Path, metavar='IMAGE', help='image, or directory of images')
    add('--bag', type=Path, metavar='BAG', help='rosbag2 to read: directory, .db3 or .mcap file')
    add('--topic', help="image topic in the bag (default: the bag's only image topic)")
    add('--every', type=count, default=1, metavar='N', help='use every N-th image only')
    add('--board', required=True, metavar='FILE', help='board file (YAML)')
    add('-o', '--output', required=True, type=Path, metavar='FILE', help='output file (YAML)')
    add('--name', default='camera', help='camera_name in the output (default: %(default)s)')
    add('--plot', type=Path, metavar='FILE', help='write a report as .png, .svg or .pdf')
    add('--json', action='store_true', help='print JSON lines instead of a table')
    add('--force', action='store_true', help='write the camera even if it is not calibrated')
    add_estimate_option(parser, '--threshold', 'threshold_px', 'PX')
    add_estimate_option(parser, '--seed', 'seed', 'N')
    add_estimate_switch(parser, '--two-sided', 'two_sided')


def run(arguments: argparse.Namespace) -> int:
    """Calibrate; return 1 if no calibration was written."""
    _check(arguments)
    options = EstimateOptions(
        threshold_px=arguments.threshold, seed=arguments.seed, two_sided=arguments.two_sided
    )
    calibration_run = CalibrationRun(load_board(arguments.board), options)
    prepare_kernels()
    with _source(arguments) as source:
        for named in with_progress(source.images, source.count, prints=arguments.json):
            result = calibration_run.add(named)
            if arguments.json:
                _print_image_json(result)
    calibration = _calibration(calibration_run, arguments.name)
    if arguments.json:
        _print_calibration_json(calibration_run, calibration)
    else:
        print_views(calibration_run.records)
        print_rejected(calibration_run.rejected, source.name if arguments.bag else None)
        _print_summary(calibration_run, calibration)
    return _write(arguments, calibration_run, calibration)


def _check(arguments: argparse.Namespace) -> None:
    """Check what can be checked before the long computation."""
    if bool(arguments.images) == bool(arguments.bag):
        arguments.usage_error('expected either images or --bag')
    if arguments.topic and not arguments.bag:
        arguments.usage_error('--topic requires --bag')
    if not arguments.json:
        require('rich')
    check_writable(arguments.output)
    if arguments.plot:
        require('matplotlib')
        from p4pfr_ros.report.plots import check_suffix  # imports matplotlib: slow

        check_suffix(arguments.plot)
        check_writable(arguments.plot)


def _source(arguments: argparse.Namespace) -> AbstractContextManager[ImageSource]:
    if arguments.bag:
        return _from_bag(arguments.bag, arguments.topic, arguments.every)
    paths = find_images(arguments.images)[:: arguments.every]
    images = (NamedImage(str(path), image_or_reason(path)) for path in paths)
    return nullcontext(ImageSource('images', images, len(paths)))


@contextmanager
def _from_bag(path: Path, topic: str | None, every: int) -> Iterator[ImageSource]:
    """
    Open a bag; its images are named by their stamps in seconds.

    Raises
    ------
    ConfigError
        See `ImageBag`; also while reading images.

    """
    from p4pfr_ros.files.bags import ImageBag

    with ImageBag(path, topic) as bag:
        total = -(-bag.count // every) if bag.count else None
        images = (
            NamedImage(_seconds(item.stamp_ns), _image_or_reason(item.image))
            for item in bag.images(every)
        )
        yield ImageSource(f'{path} {bag.topic}', images, total)


def _seconds(stamp_ns: int) -> str:
    """Format a stamp like ROS tools: seconds with nine decimals."""
    return f'{stamp_ns // _NS_PER_S}.{stamp_ns % _NS_PER_S:09d}'


def _image_or_reason(image: ImageArray | Unreadable) -> ImageArray | str:
    return image.reason if isinstance(image, Unreadable) else image


def _calibration(calibration_run: CalibrationRun, name: str) -> Calibration | None:
    if calibration_run.calibration is None or calibration_run.fused is None:
        return None
    return Calibration.from_estimate(
        calibration_run.fused, calibration_run.calibration.image_size, name
    )


def _write(
    arguments: argparse.Namespace, calibration_run: CalibrationRun, calibration: Calibration | None
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
            'camera': _camera_as_json(result.fused) if result.fused else None,
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
        model = calibration.model
        line['calibration'] = {
            'state': calibration_run.calibration.state.name.lower(),
            'image_size': list(calibration.image_size),
            **_camera_as_json(calibration_run.fused),
            'coverage': calibration_run.coverage,
            'missing': list(calibration_run.calibration.missing),
            'camera_info': {
                'distortion_model': model.distortion_model,
                'd': list(model.coefficients),
                'focal_px': list(model.focal_px),
                'center_px': list(model.center_px),
                'residual_px': model.residual_px,
                'residual_outside_px': model.residual_outside_px,
            },
        }
    print(json.dumps(line, allow_nan=False), flush=True)


def _camera_as_json(estimate: CameraEstimate) -> dict[str, Any]:
    camera, projection_px = estimate.camera, estimate.projection_sigma_px
    p1_sigma, p2_sigma = estimate.decentring_sigma
    return {
        'focal_px': camera.focal_px,
        'center_px': list(camera.center_px),
        'k': list(camera.terms[: camera.order]),
        'aspect': camera.aspect,
        'p1': camera.p1,
        'p2': camera.p2,
        'sigma': {
            'focal_px': _or_null(estimate.focal_sigma_px),
            'center_px': [_or_null(sigma) for sigma in estimate.center_sigma_px.tolist()],
            'k': [_or_null(sigma) for sigma in estimate.terms_sigma[: camera.order]],
            'aspect': _or_null(estimate.aspect_sigma),
            'p1': _or_null(p1_sigma),
            'p2': _or_null(p2_sigma),
        },
        'rms_px': estimate.rms_px,
        'views': estimate.views,
        'scatter': estimate.scatter,
        'projection_sigma_px': None if math.isnan(projection_px) else projection_px,
        'boards': {name: _shape_as_json(s) for name, s in estimate.board_shapes.items()},
    }


def _shape_as_json(shape: BoardShape) -> dict[str, float]:
    return {
        'bow_m': shape.bow,
        'bow_sigma_m': shape.bow_sigma,
        'stretch': shape.stretch,
        'stretch_sigma': shape.stretch_sigma,
        'skew_rad': shape.skew,
    }


def _or_null(sigma: float) -> float | None:
    """Replace the standard deviation 0 of a parameter that was held fixed by null."""
    return sigma or None


def print_views(records: Sequence[ViewRecord]) -> None:
    """Print a row for each view; of more than 100, only for those that changed the camera."""
    if not records:
        return
    shown = records
    if len(records) > _MAX_ROWS:
        shown = [record for record in records if record.verdict not in _NO_CHANGE]
    print_table(_HEADINGS, map(_cells, shown), left=('image', 'verdict'))
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


def print_rejected(rejected: Sequence[RejectedImage], bag: str | None) -> None:
    """Print to stderr why images were rejected; for a bag, the number of images per reason."""
    if bag is None:
        for image in rejected:
            print(f'p4pfr: {image.name}: {image.reason}', file=sys.stderr)
        return
    for reason, number in Counter(image.reason for image in rejected).most_common():
        images = '1 image' if number == 1 else f'{number} images'
        print(f'p4pfr: {bag}: {images}: {reason}', file=sys.stderr)


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
    for name, value, sigma in _terms(fused):
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


def _terms(estimate: CameraEstimate) -> Iterator[tuple[str, float, float]]:
    """List the terms of the lens with their standard deviations: k, and those that are in use."""
    camera = estimate.camera
    names = ('k', 'k2', 'k3', 'k4')
    for name, k, sigma in zip(names, camera.terms, estimate.terms_sigma, strict=True):
        if name == 'k' or k != 0.0:
            yield name, k, sigma
    if camera.aspect != 1.0:
        yield 'fy/fx', camera.aspect, estimate.aspect_sigma
    if camera.is_decentred:
        for i, name in enumerate(('p1', 'p2')):
            yield name, getattr(camera, name), estimate.decentring_sigma[i]


def _word(verdict: Verdict) -> str:
    return verdict.name.lower()
