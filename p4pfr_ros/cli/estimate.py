# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""``p4pfr estimate``: pictures of a board to poses, each picture by itself."""

from __future__ import annotations

import argparse
from pathlib import Path
import sys

from p4pfr_ros import EstimateOptions
from p4pfr_ros.cli.answers import Answer, NoAnswer
from p4pfr_ros.cli.arguments import add_seed, add_threshold, finite, positive
from p4pfr_ros.cli.pictures import answer_from, check_names, find_pictures, Question
from p4pfr_ros.cli.progress import with_progress
from p4pfr_ros.cli.report import print_json_line, print_table
from p4pfr_ros.files.boards import load_board
from p4pfr_ros.files.yaml_fields import ConfigError

_EPILOG = """\
Every picture is solved by itself: nothing is carried over from one to the next.
The exit status is 1 if one of them has no answer; the reasons are on stderr.

--json prints one JSON object per picture and line. Lengths are metres, angles
degrees; the pose is camera_from_board; sigma holds standard deviations. What
the view cannot tell is null and named in not_observable; where it is because
several solutions explain the view, candidates has them all, the likeliest
first. A picture without an answer has the key reason, and no other but image.
"""


def add_parser(commands: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    """Describe the command to argparse."""
    parser = commands.add_parser(
        'estimate',
        help='pose, focal length and distortion from pictures of a board',
        epilog=_EPILOG,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.set_defaults(run=run)
    add = parser.add_argument
    add('images', nargs='+', type=Path, metavar='IMAGE', help='picture, or directory of them')
    add('--board', required=True, metavar='FILE', help='the board, in YAML')
    add('--draw', type=Path, metavar='DIR', help='write there what was found in each picture')
    add('--json', action='store_true', help='print JSON lines instead of a table')
    add(
        '--center',
        nargs=2,
        type=finite,
        metavar=('X', 'Y'),
        help="the lens's centre in the picture, px (default: the middle)",
    )
    add_threshold(parser)
    _add_knowledge(parser)
    add_seed(parser)


def _add_knowledge(parser: argparse.ArgumentParser) -> None:
    known = parser.add_argument_group('what is known beforehand')
    known.add_argument('--sigma', type=positive, metavar='PX', help='noise of a corner, px')
    for name, what in (('focal', 'focal length, px,'), ('k', 'distortion')):
        known.add_argument(
            f'--prior-{name}',
            nargs=2,
            type=finite,
            metavar=(name.upper(), 'SIGMA'),
            help=f'{what} and its standard deviation',
        )


def run(arguments: argparse.Namespace) -> int:
    """Answer for each picture; return 1 if one of them has no answer."""
    question = _question(arguments)
    paths = find_pictures(arguments.images)
    if question.draw_folder:
        check_names(paths)
    answers: list[Answer] = []
    failures: list[NoAnswer] = []
    for path in with_progress(paths, len(paths), prints=arguments.json):
        answer = answer_from(path, question)
        if arguments.json:
            print_json_line(answer)
        if isinstance(answer, Answer):
            answers.append(answer)
        else:
            failures.append(answer)
    if not arguments.json:
        print_table(answers)
    for failure in failures:
        print(f'p4pfr: {failure.path}: {failure.reason}', file=sys.stderr)
    return int(bool(failures))


def _question(arguments: argparse.Namespace) -> Question:
    options = _options(arguments)
    folder: Path | None = arguments.draw
    if folder:
        try:
            folder.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise ConfigError(f'--draw {folder}: {error.strerror}') from None
    center = (arguments.center[0], arguments.center[1]) if arguments.center else None
    return Question(load_board(arguments.board), options, center, folder)


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
        )
    except ValueError as error:  # a prior's sigma, say, that is no sigma
        raise ConfigError(str(error)) from None
