# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""``p4pfr estimate``: pose and camera from single images."""

from __future__ import annotations

import argparse
from collections.abc import Iterable, Iterator, Sequence
import csv
from functools import partial
import json
from pathlib import Path
import sys

from p4pfr_ros import EstimateOptions, PoseEstimate
from p4pfr_ros.cli.arguments import (
    add_estimate_option,
    add_estimate_switch,
    add_jobs,
    add_source_arguments,
    checked_sources,
    description_of,
    finite,
    in_range,
    load_board_with_notes,
    print_reasons,
)
from p4pfr_ros.cli.terminal import print_note, print_table, with_progress
from p4pfr_ros.cli.workers import in_order
from p4pfr_ros.core.cameras.camera_info import MAX_NUMBER
from p4pfr_ros.files.calibration import load_calibration
from p4pfr_ros.files.dependencies import require
from p4pfr_ros.files.image_sources import find_images, Frame, open_source
from p4pfr_ros.files.images import Decoding
from p4pfr_ros.files.yaml_fields import ConfigError
from p4pfr_ros.report.image_pose import (
    as_json,
    CSV_COLUMNS,
    csv_row,
    estimate_image,
    FailedImage,
    Given,
    ImageEstimate,
    TUM_HEADINGS,
    tum_line,
)
from p4pfr_ros.report.number_format import plus_minus

_EPILOG = """\
Each image is processed independently. The reasons why images have no estimate
are printed to stderr. The exit status is 1 if any image file has none, or all
frames of a video or bag.

With --json, each line is a JSON object for one image. Lengths are in metres,
angles in degrees; the pose is camera_from_board; sigma holds standard
deviations. Quantities that the view does not determine are null and listed in
not_observable; focal_limits has the shares of the variance of the focal
length that are from the unknown principal point (center), the unknown terms
of the lens (lens), and pixels and board that may deviate (others). If several
solutions fit the view equally well, candidates lists them all, the most
likely first; so too for a board that looks the same after a turn. status
names how the estimation ended. uses_board_shape is true if the calibration of
--camera has the shape of the board, by its name: the points are then where
they are on the real board. stamp_s is the stamp of a message in a bag, the
time of a frame in its video, or the number that an image file is named by.
An image without an estimate has the keys image and reason and, if the board
was detected, status.

With --csv, each image is a row with the same numbers, in the same units.
With --tum, each image with a pose is a line of a trajectory that evo reads:
stamp, position (m), quaternion x y z w. The camera moves in the frame of the
board; with --moving board, the board in the frame of the camera. Images
without a stamp are numbered from 0.
"""
_DRAW_HELP = (
    'write images with corners and pose to DIR; rejected candidates are outlined, with the reason'
)
_QUATERNION, _DISTANCE, _FOCAL, _K = 'quaternion x y z w', 'distance, m', 'f, px', 'k'
_HEADINGS = (
    'image',
    'x y z, m',
    _QUATERNION,
    'tilt, °',
    _DISTANCE,
    _FOCAL,
    _K,
    'rms, px',
    'inliers',
)
# Left out where the terminal is too narrow, in this order.
_OPTIONAL = (_QUATERNION, _DISTANCE, _K, _FOCAL)
_UNKNOWN = '?'

# What causes more than this share of the variance of the focal length limits it.
_LIMITING = 0.3


def add_parser(commands: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    """Add the command to the parser."""
    parser = commands.add_parser(
        'estimate',
        help='estimate pose, focal length and distortion from single images of a board',
        description='Estimate pose, focal length and distortion from single images of a board.',
        epilog=_EPILOG,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.set_defaults(run=run, usage_error=parser.error)
    add = parser.add_argument
    add_source_arguments(parser)
    add_jobs(parser)
    add('--board', required=True, metavar='FILE', help='board file (YAML)')
    _add_outputs(parser)
    add(
        '--camera',
        type=Path,
        metavar='FILE',
        help='calibration file (YAML) of the camera, and of the shape of the board: only the '
        'pose is estimated (default: an unknown camera)',
    )
    add(
        '--center',
        nargs=2,
        type=partial(in_range, low=-MAX_NUMBER, high=MAX_NUMBER, is_integer=False),
        metavar=('X', 'Y'),
        help='principal point, px (default: the image centre)',
    )
    add_estimate_option(parser, '--threshold', 'threshold_px', 'PX')
    add_estimate_option(parser, '--seed', 'seed', 'N')
    add_estimate_switch(parser, '--two-sided', 'two_sided')
    _add_priors(parser)


def _add_outputs(parser: argparse.ArgumentParser) -> None:
    parser.add_argument('--draw', type=Path, metavar='DIR', help=_DRAW_HELP)
    formats = parser.add_mutually_exclusive_group()
    formats.add_argument('--json', action='store_true', help='print JSON lines')
    formats.add_argument('--csv', action='store_true', help='print comma-separated values')
    formats.add_argument('--tum', action='store_true', help='print a trajectory for evo')
    parser.add_argument(
        '--moving',
        choices=tuple(TUM_HEADINGS),
        default='camera',
        help='whose trajectory --tum prints (default: %(default)s)',
    )


def _add_priors(parser: argparse.ArgumentParser) -> None:
    group = parser.add_argument_group('priors')
    add_estimate_option(group, '--sigma', 'sigma_px', 'PX')
    for flag, mean, sigma in (
        ('focal', 'prior_focal_px', 'prior_focal_sigma_px'),
        ('k', 'prior_k', 'prior_k_sigma'),
    ):
        group.add_argument(
            f'--prior-{flag}',
            nargs=2,
            type=finite,
            metavar=(flag.upper(), 'SIGMA'),
            help=f'{description_of(mean)}; {description_of(sigma)}',
        )


def run(arguments: argparse.Namespace) -> int:
    """Process the images; return 1 if an image has no estimate, or no frame of a recording."""
    paths = checked_sources(arguments)
    is_table = not (arguments.json or arguments.csv or arguments.tum)
    if is_table:
        require('rich')
    if arguments.camera and (arguments.center or arguments.prior_focal or arguments.prior_k):
        arguments.usage_error('--camera excludes --center, --prior-focal and --prior-k')
    given = Given(
        load_board_with_notes(arguments.board),
        _options(arguments),
        tuple(arguments.center) if arguments.center else None,
        load_calibration(arguments.camera) if arguments.camera else None,
    )
    if arguments.draw:
        _prepare_drawing(arguments.draw, find_images(paths))
    # Only drawings need colour.
    how = Decoding(as_grey=not arguments.draw, max_megapixels=arguments.max_megapixels)
    process = partial(_process, how=how, given=given, draw_folder=arguments.draw)
    results: list[ImageEstimate | FailedImage] = []
    with open_source(paths, arguments.topic, arguments.every, arguments.max_megapixels) as source:
        _print_heading(arguments)
        processed = in_order(process, source.frames, source.count, arguments.jobs)
        for result in with_progress(processed, source.count, prints=not is_table):
            _print_line(arguments, result, len(results))
            results.append(result)
    if is_table:
        _print_results([result for result in results if isinstance(result, ImageEstimate)])
    failures = [result for result in results if isinstance(result, FailedImage)]
    print_reasons((failure.name, failure.recording, failure.reason) for failure in failures)
    return _status(results)


def _process(
    frame: Frame, how: Decoding, given: Given, draw_folder: Path | None
) -> ImageEstimate | FailedImage:
    return estimate_image(frame.load(how), given, draw_folder)


def _status(results: Sequence[ImageEstimate | FailedImage]) -> int:
    """Return 1 if an image file has no estimate, or no frame of a recording has one."""
    estimated = {each.recording for each in results if isinstance(each, ImageEstimate)} - {''}
    failed = {each.recording for each in results if isinstance(each, FailedImage)}
    return int(bool(failed - estimated) or not results)


def _options(arguments: argparse.Namespace) -> EstimateOptions:
    focal_px, focal_sigma_px = arguments.prior_focal or (None, None)
    k, k_sigma = arguments.prior_k or (0.0, None)
    try:
        return EstimateOptions(
            threshold_px=arguments.threshold,
            seed=arguments.seed,
            sigma_px=arguments.sigma,
            prior_focal_px=focal_px,
            prior_focal_sigma_px=focal_sigma_px,
            prior_k=k,
            prior_k_sigma=k_sigma,
            two_sided=arguments.two_sided,
        )
    except ValueError as error:  # a standard deviation out of range, for example
        raise ConfigError(str(error)) from None


def _prepare_drawing(folder: Path, images: Iterable[Path]) -> None:
    """
    Create the folder for drawings, and check that each source gets files of its own.

    Raises
    ------
    ConfigError
        The folder cannot be created, or two images have the same name.

    """
    by_name: dict[str, Path] = {}
    for path in images:
        if path.stem in by_name:
            first = by_name[path.stem]
            raise ConfigError(f'--draw: {first} and {path} would be written to the same file')
        by_name[path.stem] = path
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise ConfigError(f'--draw {folder}: {error.strerror}') from None


def _print_heading(arguments: argparse.Namespace) -> None:
    if arguments.csv:
        csv.writer(sys.stdout, lineterminator='\n').writerow(CSV_COLUMNS)
    if arguments.tum:
        print(TUM_HEADINGS[arguments.moving])


def _print_line(
    arguments: argparse.Namespace, result: ImageEstimate | FailedImage, index: int
) -> None:
    """Print the line of an image, unless a table will be printed."""
    if arguments.json:
        print(json.dumps(as_json(result), allow_nan=False), flush=True)
    elif arguments.csv:
        csv.writer(sys.stdout, lineterminator='\n').writerow(csv_row(result))
        sys.stdout.flush()
    elif arguments.tum:
        line = tum_line(result, index, arguments.moving)
        if line is not None:
            print(line, flush=True)


def _print_results(results: Sequence[ImageEstimate]) -> None:
    """Print a row for each image, and below them notes on ambiguous or degenerate views."""
    if not results:
        return
    print_table(_HEADINGS, (_cells(result) for result in results), optional=_OPTIONAL)
    for note in _notes(results):
        print_note(note)


def _cells(result: ImageEstimate) -> Iterator[str]:
    estimate, pose, camera = result.estimate, result.model.camera_from_board, result.model.camera
    observable = estimate.observable
    yield result.name
    yield _joined(pose.translation, 3) if observable.distance else _UNKNOWN
    yield _joined(pose.quaternion_xyzw(), 3) if observable.direction else _UNKNOWN
    yield f'{pose.tilt_deg:.1f}' if observable.direction else _UNKNOWN
    yield f'{pose.distance:.3f}' if observable.distance else _UNKNOWN
    if result.camera_is_given:
        yield f'{camera.focal_px:.1f} (given)'
        yield f'{camera.k:.3f} (given)'
    else:
        f_sigma, k_sigma = estimate.focal_sigma_px, estimate.k_sigma
        yield plus_minus(camera.focal_px, f_sigma) if observable.focal else _UNKNOWN
        yield plus_minus(camera.k, k_sigma) if observable.distortion else _UNKNOWN
    yield f'{estimate.rms_px:.2f}'
    yield f'{estimate.inliers.sum()}/{len(estimate.inliers)}'


def _joined(values: Iterable[float], digits: int) -> str:
    return ' '.join(f'{value:.{digits}f}' for value in values)


def _limit(estimate: PoseEstimate) -> tuple[str, str] | None:
    """Return what limits the focal length more than the noise, in words, and its share."""
    limits = estimate.focal_limits
    if limits is None or not estimate.observable.focal:
        return None
    shares = {
        'the principal point': limits.center,
        'the terms of the lens': limits.lens,
        'pixels and board, which may deviate': limits.others,
    }
    name, share = max(shares.items(), key=lambda item: item[1])
    if share < _LIMITING:
        return None
    return f'focal length limited by {name}', f' ({100.0 * share:.0f} % of its variance)'


def _notes(results: Iterable[ImageEstimate]) -> Iterator[str]:
    """Yield a line for each note on an image, or on several images alike."""
    noted: dict[str, list[tuple[str, str]]] = {}
    for result in results:
        for note, detail in _notes_on(result):
            noted.setdefault(note, []).append((result.name, detail))
    for note, images in noted.items():
        name, detail = images[0]
        yield f'{name}: {note}{detail}' if len(images) == 1 else f'{len(images)} images: {note}'


def _notes_on(result: ImageEstimate) -> Iterator[tuple[str, str]]:
    """Yield notes on an image, and details that other images with the note do not share."""
    undetermined = result.estimate.observable.undetermined
    if undetermined:
        yield f'not determined by the view: {", ".join(undetermined)}', ''
    limit = _limit(result.estimate)
    if limit:
        yield limit
    candidates = len(result.candidates)
    if candidates:
        yield f'{candidates} solutions fit the view equally well (see --json)', ''
