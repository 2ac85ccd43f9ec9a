# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""
How true the stated covariances are, where cameras, boards and points deviate from the model.

    [P4PFR_DATA=FOLDER] python -m benchmarks.honesty [--views N] [--options NAME] [--markdown FILE]

With P4PFR_DATA, single views of real cameras too: FOLDER/corners contains their .npz files.
"""

from __future__ import annotations

import argparse
from collections.abc import Mapping
import os
from pathlib import Path

from p4pfr_ros import EstimateOptions
from p4pfr_ros.scenes.deviating_view import BOARD, MARKER
from rich.console import Console

from .honesty_changes import CHANGE_HEADER, change_rows
from .honesty_kinds import (
    BOARD_KINDS,
    CALIBRATED_KINDS,
    calibrated_scores,
    free_scores,
    MARKER_KINDS,
    VIEWS_PER_CAMERA,
)
from .honesty_real import REAL_FOCAL_PX, REAL_HEADER, real_rows, real_views
from .honesty_scores import (
    BEYOND_SIGMAS,
    FAR_FACTOR,
    GROSS_DEG,
    GROSS_SHARE,
    Score,
    SCORE_HEADER,
    summary,
)
from .tables import Measured, page_of, Row, table_of

# The options under test: without deviations, and what a user gets.
OPTIONS = {
    'ideal': EstimateOptions.ideal(),
    'default': EstimateOptions(),
}

_TITLE = 'Stated and true errors, measured'
_COMMAND = 'python -m benchmarks.honesty'
_WIDTH = 160
_HEADER = ('kind', *SCORE_HEADER)
NOTES = (
    'Each view has a camera, a board pose and noise of its own (tables 1 and 2), or follows a '
    'calibration with 40 views in the model (table 3: tilt 0 to 12°, 640x480, noise 0.2 px). With '
    'R half the diagonal of the image: f is 0.375 R to 2.5 R, and k r² at the corner -0.5 to 0; '
    'equidistant lenses see 60° to 140°, Brown-Conrady and rational ones have f from 0.8 R to '
    '2.5 R. Tilt 10 to 60°, the board fills 15 to 70 % of the width of images of 640x480 and '
    '1280x720, noise 0.3 px (table 1) and 0.2 px (table 2).',
    'Published: with an observable pose, as on `~/pose`; the columns after it are of these views. '
    f'Gross: rotation off by more than {GROSS_DEG:g}° or position by more than '
    f'{100.0 * GROSS_SHARE:g} % of the distance. Beyond {BEYOND_SIGMAS:g} sigma: any observable '
    'quantity (position, rotation, f, and k if the lens is a division lens) is off by more than '
    f'{BEYOND_SIGMAS:g} stated standard deviations. {FAR_FACTOR:g} times off: the distance, or an '
    'observable focal length. NEES: squared error of what is observable, normalised by the stated '
    'covariance. With a right covariance the median of NEES / dof is 0.9 and the mean of z(f)² is '
    '1; smaller values are of a cautious covariance.',
    'Table 4: each camera of table 3 zooms, and sees boards that are tilted by 10 to 60°, until '
    'the calibration restarts. A single view often fits the old focal length at another distance.',
)
_REAL_NOTE = (
    'Table 5: the corners of each photograph alone, from P4PFR_DATA; the reference is the '
    'calibration from all photographs of the camera, with its aspect ratio and the shape of its '
    'board.'
)


def main(arguments: list[str] | None = None) -> int:
    """Run the benchmark and print the tables."""
    parser = argparse.ArgumentParser(
        prog='python -m benchmarks.honesty', description=__doc__.split('\n\n')[0]
    )
    parser.add_argument(
        '--views', type=int, default=400, help='views per row; default: %(default)s'
    )
    parser.add_argument(
        '--options',
        choices=OPTIONS,
        default='default',
        help='of the estimate; default: %(default)s',
    )
    parser.add_argument(
        '--markdown', type=Path, metavar='FILE', help='also write the tables to FILE'
    )
    given = parser.parse_args(arguments)
    console = Console()
    console.width = max(console.width, _WIDTH)  # do not truncate cells
    notes = list(NOTES)
    with console.status(f'{given.views} views per row'):
        tables = synthetic_tables(given.views, OPTIONS[given.options])
        if 'P4PFR_DATA' in os.environ:
            corners = Path(os.environ['P4PFR_DATA']) / 'corners'
            tables.append(_real_table(corners, OPTIONS[given.options]))
            notes.append(_REAL_NOTE)
    for title, header, rows in tables:
        console.print(table_of(title, header, rows))
    console.print(*notes, sep='\n', soft_wrap=True)
    if given.markdown:
        command = f'{_COMMAND} --views {given.views} --options {given.options} --markdown'
        given.markdown.write_text(page_of(_TITLE, command, tables, notes), encoding='utf-8')
    return 0


def synthetic_tables(views: int, options: EstimateOptions) -> list[Measured]:
    """Measure the tables of drawn views."""
    return [
        _table(
            '1. Unknown camera, one view of a marker (four points)',
            free_scores(MARKER_KINDS, MARKER, views, options),
        ),
        _table(
            '2. Unknown camera, one view of a board (54 points)',
            free_scores(BOARD_KINDS, BOARD, views, options),
        ),
        _table(
            '3. Calibrated camera, then a view that deviates (54 points)',
            calibrated_scores(CALIBRATED_KINDS, views, options),
        ),
        (
            '4. Calibrated camera, then a zoom (54 points)',
            CHANGE_HEADER,
            change_rows(max(1, views // VIEWS_PER_CAMERA), options),
        ),
    ]


def _table(title: str, scores: Mapping[str, list[Score]]) -> Measured:
    rows: list[Row] = [(kind, *summary(each)) for kind, each in scores.items()]
    return title, _HEADER, rows


def _real_table(corners: Path, options: EstimateOptions) -> Measured:
    measured = {name: real_views(corners / f'{name}.npz', options) for name in REAL_FOCAL_PX}
    return '5. Real cameras, one view at a time', REAL_HEADER, real_rows(measured)


if __name__ == '__main__':
    raise SystemExit(main())
