# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""
Robust estimation in two tables: success rate, errors and time, unknown and known camera.

    python -m benchmarks.robust [--scenes N] [--markdown FILE]
"""

from __future__ import annotations

import argparse
import functools
from pathlib import Path

import cv2
from rich.console import Console

from .known_camera import KNOWN_HEADER, known_rows
from .opencv import (
    calibrate,
    Calls,
    estimate,
    median_ms,
    options_for,
    USUAL_OUTLIERS_PERCENT,
    views_of,
)
from .published_robust import Figures, IDEAL, POSELIB, POSELIB_MORE, RADIALPOSE, ROBUST
from .robust_scenes import Cell, Errors, measure_cell
from .tables import page_of, table_of

_CELLS = [
    (n, percent)
    for n, percents in ((100, (0, 30, 50, 70, 80, 90)), (24, (0, 30, 50, 70)))
    for percent in percents
]
_TIMED_VIEWS = 50
_TIMED_ROUNDS = 5
_WIDTH = 260
_TITLE = 'Robust estimation, measured'
_COMMAND = 'python -m benchmarks.robust --markdown'

HEADER = (
    'points',
    'outliers',
    'least squares\nfrom ground truth',
    'estimate_pose,\nno deviations',
    'estimate_pose',
    'samples',
    'ms, no\ndeviations',
    'ms',
    'ratio',
    'ms / cv2.cali-\nbrateCamera',
    'least squares °',
    'radialpose °',
    'PoseLib 3.0.0 °,\ndefault',
    'PoseLib 3.0.0 °,\n100 to 10,000 iterations',
)
NOTE = (
    'Success % (rotation within 1°, focal length within 5 %) / median errors: rotation °, focal '
    'length %, position %. 0.5 px noise, tilt 15 to 65°, outliers uniform in the image. The '
    'scenes are ideal: the principal point is in the middle of the image, lens and board are '
    'exactly those of the model. No deviations: EstimateOptions.ideal(), which takes that for '
    'granted as the other programs do; default options do not, and their errors are larger, as '
    'their covariances say. min_inlier_ratio is 0.05 with 80 and 90 % outliers, more than the '
    'default allows. Columns with ° are published results (another machine, other scenes drawn by '
    'the same rules): success / rotation / focal length / ms.'
)


def main(arguments: list[str] | None = None) -> int:
    """Run the benchmark and print the tables."""
    parser = argparse.ArgumentParser(
        prog='python -m benchmarks.robust', description=__doc__.split('\n\n')[0]
    )
    parser.add_argument(
        '--scenes', type=int, default=200, help='scenes per row; default: %(default)s'
    )
    parser.add_argument(
        '--markdown', type=Path, metavar='FILE', help='also write the tables to FILE'
    )
    options = parser.parse_args(arguments)
    cv2.setNumThreads(1)
    console = Console()
    console.width = max(console.width, _WIDTH)  # do not truncate cells
    rows = []
    with console.status('') as status:
        times = _times()
        for n, percent in _CELLS:
            status.update(f'{n} points, {percent} % outliers: {options.scenes} scenes')
            cell = measure_cell(n, percent, options.scenes)
            rows.append(_row(cell, times))
        known = known_rows(options.scenes)
    title = f'{options.scenes} scenes per row, unknown camera'
    unit = (
        f'cv2.calibrateCamera, one view of 24 points, k1 free: {times["opencv"]:.3f} ms on this '
        'machine; medians, calls alternated with estimate_pose.'
    )
    tables = [(title, HEADER, rows), ('Known camera: pose only', KNOWN_HEADER, known)]
    for name, header, body in tables:
        console.print(table_of(name, header, body))
    console.print(NOTE, unit, sep='\n', soft_wrap=True)
    if options.markdown:
        options.markdown.write_text(
            page_of(_TITLE, _COMMAND, tables, [NOTE, unit]), encoding='utf-8'
        )
    return 0


def _times() -> dict[str, float]:
    """Return the median time, ms, of each cell, and of OpenCV under the key ``opencv``."""
    usual: Calls = {}
    long: Calls = {}
    for n, percent in _CELLS:
        calls = usual if percent <= USUAL_OUTLIERS_PERCENT else long
        for name, ideal in (('ideal', True), ('default', False)):
            calls[f'{n} {percent} {name}'] = [
                functools.partial(estimate, v, options_for(percent, ideal=ideal))
                for v in views_of(n, percent, _TIMED_VIEWS)
            ]
    usual['opencv'] = [functools.partial(calibrate, v) for v in views_of(24, 0, _TIMED_VIEWS)]
    times: dict[str, float] = {}
    for calls in (usual, long):  # a long call would empty the caches for the next one
        median_ms(calls, 1)  # compile and warm up
        times |= median_ms(calls, _TIMED_ROUNDS)
    return times


def _row(cell: Cell, times: dict[str, float]) -> tuple[str, ...]:
    ideal_ms, default_ms = (
        times[f'{cell.n_points} {cell.outlier_percent} {name}'] for name in ('ideal', 'default')
    )
    published = ROBUST.get((cell.n_points, cell.outlier_percent), {})
    return (
        str(cell.n_points),
        f'{cell.outlier_percent} %',
        _errors(cell.truth),
        _errors(cell.ideal),
        _errors(cell.default),
        f'{cell.iterations:.0f}',
        f'{ideal_ms:.3f}',
        f'{default_ms:.3f}',
        f'{default_ms / ideal_ms:.2f}',
        f'{default_ms / times["opencv"]:.2f}',
        *(_figures(published.get(name)) for name in (IDEAL, RADIALPOSE, POSELIB, POSELIB_MORE)),
    )


def _errors(errors: Errors) -> str:
    rotation_deg, focal, position = errors.medians
    return f'{errors.success:.1f} / {rotation_deg:.3f} / {focal:.2f} / {position:.2f}'


def _figures(figures: Figures | None) -> str:
    if figures is None:
        return ''
    text = f'{figures.success:.1f} / {figures.rotation_deg:.3f} / {figures.focal:.2f}'
    return text if figures.milliseconds is None else f'{text} / {figures.milliseconds:g}'


if __name__ == '__main__':
    raise SystemExit(main())
