# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""``p4pfr estimate``: pose and camera from single images."""

from __future__ import annotations

import argparse
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import asdict, dataclass, replace
from functools import partial
import json
from pathlib import Path
import sys
from typing import Any

from p4pfr_ros import (
    BoardShape,
    CameraInfoModel,
    DivisionCamera,
    estimate_pose,
    EstimateOptions,
    Observability,
    PoseEstimate,
    Solution,
    Status,
)
from p4pfr_ros.boards import Board
from p4pfr_ros.boards.shape_in_use import shape_in_use
from p4pfr_ros.boards.symmetry import with_turned_poses
from p4pfr_ros.cli.arguments import (
    add_estimate_option,
    add_estimate_switch,
    description_of,
    find_images,
    finite,
    in_range,
    positive,
    require,
)
from p4pfr_ros.cli.terminal import prepare_kernels, print_table, with_progress
from p4pfr_ros.core.cameras.camera_info import MAX_NUMBER
from p4pfr_ros.core.geometry import Array
from p4pfr_ros.detection import detect
from p4pfr_ros.files.boards import load_board
from p4pfr_ros.files.calibration import Calibration, load_calibration
from p4pfr_ros.files.images import (
    Decoding,
    DEFAULT_DECODING,
    image_or_reason,
    ImageArray,
    write_image,
)
from p4pfr_ros.files.yaml_fields import ConfigError
from p4pfr_ros.report.drawing import annotate

_EPILOG = """\
Each image is processed independently. The exit status is 1 if any image has
no estimate; the reasons are printed to stderr.

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
they are on the real board.
An image without an estimate has the keys image and reason and, if the board
was detected, status.
"""
_DRAW_HELP = (
    'write images with corners and pose to DIR; rejected candidates are outlined, with the reason'
)
_HEADINGS = (
    'image',
    'x y z, m',
    'quaternion x y z w',
    'tilt, °',
    'distance, m',
    'f, px',
    'k',
    'rms, px',
    'inliers',
)
_UNKNOWN = '?'

# What causes more than this share of the variance of the focal length limits it.
_LIMITING = 0.3
_ALL = Observability(direction=True, distance=True, focal=True, distortion=True)


@dataclass(frozen=True, slots=True)
class FailedImage:
    """An image without an estimate, and why; status: of the estimation, if there was one."""

    path: Path
    reason: str
    status: Status | None = None


@dataclass(frozen=True, slots=True, eq=False)
class ImageEstimate:
    """
    An image (width and height in pixels) and its estimate; model is the estimate's.

    camera_is_given: by --camera; has_board_shape: so is the shape of the board.
    """

    path: Path
    image_size: tuple[int, int]
    model: Solution
    estimate: PoseEstimate
    camera_is_given: bool
    has_board_shape: bool


@dataclass(frozen=True, slots=True, eq=False)
class Given:
    """What is given for all images; calibration: of the camera, if it is known."""

    board: Board
    options: EstimateOptions
    center_px: tuple[float, float] | None
    calibration: Calibration | None

    def wrong_size(self, width: int, height: int) -> str:
        """Return why the calibration is not that of an image of this size; '' if it is."""
        if self.calibration is None or self.calibration.image_size == (width, height):
            return ''
        expected = '{}x{}'.format(*self.calibration.image_size)
        return f'expected {expected} px as calibrated, got {width}x{height}'

    def camera_and_shape(
        self, board_points: Array
    ) -> tuple[DivisionCamera | CameraInfoModel | None, BoardShape | None]:
        """Return the known camera, and the shape of the board from its calibration."""
        if self.calibration is None:
            return None, None
        known = self.calibration.estimate
        if known is None:
            return self.calibration.model, None
        return known.camera, shape_in_use(known, self.board.name, board_points)


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
    add('images', nargs='+', type=Path, metavar='IMAGE', help='image, or directory of images')
    add('--board', required=True, metavar='FILE', help='board file (YAML)')
    add('--draw', type=Path, metavar='DIR', help=_DRAW_HELP)
    add(
        '--max-megapixels',
        type=positive,
        default=DEFAULT_DECODING.max_megapixels,
        metavar='N',
        help='larger images are rejected before they are decoded (default: %(default)g)',
    )
    add('--json', action='store_true', help='print JSON lines instead of a table')
    _add_camera(parser)
    add_estimate_option(parser, '--threshold', 'threshold_px', 'PX')
    add_estimate_option(parser, '--seed', 'seed', 'N')
    add_estimate_switch(parser, '--two-sided', 'two_sided')
    _add_priors(parser)


def _add_camera(parser: argparse.ArgumentParser) -> None:
    add = parser.add_argument
    add(
        '--camera',
        type=Path,
        metavar='FILE',
        help='calibration file (YAML of ROS, OpenCV or Kalibr) of the camera, and of the shape '
        'of the board: only the pose is estimated (default: an unknown camera)',
    )
    add(
        '--camera-name',
        default='',
        metavar='NAME',
        help="which camera of --camera, if that is one of Kalibr's chains with several",
    )
    add(
        '--center',
        nargs=2,
        type=partial(in_range, low=-MAX_NUMBER, high=MAX_NUMBER, is_integer=False),
        metavar=('X', 'Y'),
        help='principal point, px (default: the image centre)',
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
    """Process the images; return 1 if any has no estimate."""
    if not arguments.json:
        require('rich')
    if arguments.camera and (arguments.center or arguments.prior_focal or arguments.prior_k):
        arguments.usage_error('--camera excludes --center, --prior-focal and --prior-k')
    given = Given(
        load_board(arguments.board),
        _options(arguments),
        tuple(arguments.center) if arguments.center else None,
        _calibration(arguments),
    )
    paths = find_images(arguments.images)
    if arguments.draw:
        _prepare_drawing(arguments.draw, paths)
    prepare_kernels()
    estimates: list[ImageEstimate] = []
    failures: list[FailedImage] = []
    # Only drawings need colour.
    how = Decoding(as_grey=not arguments.draw, max_megapixels=arguments.max_megapixels)
    for path in with_progress(paths, len(paths), prints=arguments.json):
        result = _estimate(path, how, given, arguments.draw)
        if arguments.json:
            _print_json(result)
        if isinstance(result, ImageEstimate):
            estimates.append(result)
        else:
            failures.append(result)
    if not arguments.json:
        _print_results(estimates)
    for failure in failures:
        print(f'p4pfr: {failure.path}: {failure.reason}', file=sys.stderr)
    return int(bool(failures))


def _calibration(arguments: argparse.Namespace) -> Calibration | None:
    if not arguments.camera:
        return None
    calibration = load_calibration(arguments.camera, arguments.camera_name)
    if calibration.assumed:
        print(f'p4pfr: {arguments.camera}: {calibration.assumed}', file=sys.stderr)
    return calibration


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
    Create the folder for drawings, and check that each image gets a file of its own.

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


def _estimate(
    path: Path, how: Decoding, given: Given, draw_folder: Path | None
) -> ImageEstimate | FailedImage:
    """
    Read an image, detect the board and estimate its pose; draw the result if requested.

    Raises
    ------
    ConfigError
        The drawing cannot be written.

    """
    image = image_or_reason(path, how)
    if isinstance(image, str):
        return FailedImage(path, image)
    height, width = image.shape[:2]
    wrong_size = given.wrong_size(width, height)
    if wrong_size:
        return FailedImage(path, wrong_size)
    board = given.board
    detection = detect(image, board)
    if detection.reason:
        _draw(draw_folder, path, image, detection)
        return FailedImage(path, detection.reason)
    camera, shape = given.camera_and_shape(detection.board_points)
    estimate = estimate_pose(
        detection.image_points,
        detection.board_points,
        image_size=(width, height),
        center_px=given.center_px,
        camera=camera,
        board_shape=shape,
        options=given.options,
    )
    estimate, _ = with_turned_poses(estimate, board.turns)
    if estimate.model is None:
        failed = replace(detection, reason=estimate.status.value)
        _draw(draw_folder, path, image, failed)
        return FailedImage(path, estimate.status.value, estimate.status)
    _draw(draw_folder, path, image, detection, estimate.model, board)
    return ImageEstimate(
        path,
        (width, height),
        estimate.model,
        estimate,
        camera_is_given=camera is not None,
        has_board_shape=shape is not None,
    )


def _draw(folder: Path | None, path: Path, image: ImageArray, *drawn: Any) -> None:
    """Write the annotated image, if a folder is given; drawn: further arguments of `annotate`."""
    if folder is not None:
        write_image(folder / f'{path.stem}_pose.png', annotate(image, *drawn))


def _print_json(result: ImageEstimate | FailedImage) -> None:
    """Print one line: a JSON object without NaN."""
    if isinstance(result, FailedImage):
        line: dict[str, Any] = {'image': str(result.path), 'reason': result.reason}
        if result.status is not None:
            line['status'] = result.status.name.lower()
    else:
        line = _as_json(result)
    print(json.dumps(line, allow_nan=False), flush=True)


def _as_json(result: ImageEstimate) -> dict[str, Any]:
    estimate = result.estimate
    observable, limits = estimate.observable, estimate.focal_limits
    is_free = not result.camera_is_given
    return {
        'image': str(result.path),
        'image_size': list(result.image_size),
        'status': estimate.status.name.lower(),
        **_solution_as_json(result.model, observable),
        'sigma': {
            'distance_m': estimate.distance_sigma if observable.distance else None,
            'focal_px': estimate.focal_sigma_px if observable.focal and is_free else None,
            'k': estimate.k_sigma if observable.distortion and is_free else None,
        },
        'focal_limits': None if limits is None else asdict(limits),
        'rms_px': estimate.rms_px,
        'points': len(estimate.inliers),
        'inliers': int(estimate.inliers.sum()),
        'uses_board_shape': result.has_board_shape,
        'not_observable': list(observable.undetermined),
        'candidates': [_solution_as_json(candidate, _ALL) for candidate in _candidates(result)],
    }


def _solution_as_json(solution: Solution, observable: Observability) -> dict[str, Any]:
    pose, camera = solution.camera_from_board, solution.camera
    return {
        'position_m': pose.translation.tolist() if observable.distance else None,
        'quaternion_xyzw': pose.quaternion_xyzw().tolist() if observable.direction else None,
        'tilt_deg': pose.tilt_deg if observable.direction else None,
        'distance_m': pose.distance if observable.distance else None,
        'focal_px': camera.focal_px if observable.focal else None,
        'k': camera.k if observable.distortion else None,
        'center_px': list(camera.center_px),
    }


def _candidates(result: ImageEstimate) -> list[Solution]:
    """Return all solutions of an ambiguous view, the best first; none if it is unambiguous."""
    alternatives = list(result.estimate.alternatives)
    return [result.model, *alternatives] if alternatives else []


def _print_results(results: Sequence[ImageEstimate]) -> None:
    """Print a row for each image, and below them notes on ambiguous or degenerate views."""
    if not results:
        return
    print_table(_HEADINGS, (_cells(result) for result in results))
    for note in _notes(results):
        print(note)


def _cells(result: ImageEstimate) -> Iterator[str]:
    estimate, pose, camera = result.estimate, result.model.camera_from_board, result.model.camera
    observable = estimate.observable
    yield str(result.path)
    yield _joined(pose.translation, 3) if observable.distance else _UNKNOWN
    yield _joined(pose.quaternion_xyzw(), 3) if observable.direction else _UNKNOWN
    yield f'{pose.tilt_deg:.1f}' if observable.direction else _UNKNOWN
    yield f'{pose.distance:.3f}' if observable.distance else _UNKNOWN
    if result.camera_is_given:
        yield f'{camera.focal_px:.1f} (given)'
        yield f'{camera.k:.3f} (given)'
    else:
        f_sigma, k_sigma = estimate.focal_sigma_px, estimate.k_sigma
        yield f'{camera.focal_px:.1f} ± {f_sigma:.1f}' if observable.focal else _UNKNOWN
        yield f'{camera.k:.3f} ± {k_sigma:.3f}' if observable.distortion else _UNKNOWN
    yield f'{estimate.rms_px:.2f}'
    yield f'{estimate.inliers.sum()}/{len(estimate.inliers)}'


def _joined(values: Iterable[float], digits: int) -> str:
    return ' '.join(f'{value:.{digits}f}' for value in values)


def _limit(estimate: PoseEstimate) -> str:
    """Return what limits the focal length more than the noise, in words; '' if nothing does."""
    limits = estimate.focal_limits
    if limits is None or not estimate.observable.focal:
        return ''
    shares = {
        'the principal point': limits.center,
        'the terms of the lens': limits.lens,
        'pixels and board, which may deviate': limits.others,
    }
    name, share = max(shares.items(), key=lambda item: item[1])
    if share < _LIMITING:
        return ''
    return f'focal length limited by {name} ({100.0 * share:.0f} % of its variance)'


def _notes(results: Iterable[ImageEstimate]) -> Iterator[str]:
    for result in results:
        undetermined = result.estimate.observable.undetermined
        if undetermined:
            yield f'{result.path}: not determined by this view: {", ".join(undetermined)}'
        limit = _limit(result.estimate)
        if limit:
            yield f'{result.path}: {limit}'
        candidates = len(_candidates(result))
        if candidates:
            yield f'{result.path}: {candidates} solutions fit this view equally well (see --json)'
