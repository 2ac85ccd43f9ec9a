# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""
The residual figure of the paper, reproduced: 100,000 standard-normal instances.

    python -m benchmarks.residuals [--output docs/residuals.png]
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from p4pfr_ros.core.geometry import Array
from rich.box import SIMPLE_HEAVY
from rich.console import Console
from rich.table import Table

from . import all_roots, distances
from .published import QUANTILES, RESIDUALS
from .residual_figure import draw_figure, Residuals
from .standard_normal import draw, solve, Solved

_INSTANCES = 100_000
_OUTPUT = Path(__file__).parent.parent / 'docs' / 'residuals.png'

# Lower bound of residuals, as zero has no logarithm: below one rounding error.
_FLOOR = 1e-18

_WIDTH = 110

# The targets of this project at QUANTILES; None: no target.
TARGETS = {
    'paper': (-15.3, None, None, -10.5, -6.5),
    'rotation': (-14.9, None, None, -9.5, -6.0),
}


def main(arguments: list[str] | None = None) -> int:
    """Solve the instances, print the quantiles, draw the figure."""
    parser = argparse.ArgumentParser(
        prog='python -m benchmarks.residuals', description=__doc__.split('\n\n')[0]
    )
    parser.add_argument(
        '--output', type=Path, default=_OUTPUT, metavar='PNG', help='figure to write'
    )
    parser.add_argument('--seed', type=int, default=0, help='default: %(default)s')
    options = parser.parse_args(arguments)
    image, board = draw(_INSTANCES, options.seed)
    solved = solve(image, board)
    residuals = measure(solved)
    console = Console()
    console.width = max(console.width, _WIDTH)
    console.print(_table(residuals))
    for line in _notes(solved, residuals, all_roots.count(image, board)):
        console.print(line, soft_wrap=True)
    draw_figure(residuals, options.output)
    console.print(f'written: {options.output}')
    return 0


def measure(solved: Solved) -> Residuals:
    """Compute the residuals by every definition."""
    return Residuals(
        paper=_positive(distances.paper(solved, nearest_horizon=True)),
        paper_any_origin=_positive(distances.paper(solved, nearest_horizon=False)),
        rotation=_positive(distances.undistorted(solved)),
        image=_positive(distances.in_image(solved)),
        rounding=_positive(distances.rounding(solved)),
        horizon=np.abs(distances.horizon(solved)).min(axis=1),
    )


def log_quantiles(values: Array) -> list[float]:
    """Return log10 of the residuals at QUANTILES."""
    return [round(float(q), 2) for q in np.log10(np.quantile(values, QUANTILES))]


def _positive(values: Array) -> Array:
    return np.maximum(values, _FLOOR)


def _table(residuals: Residuals) -> Table:
    table = Table(title='log10 of the residual', box=SIMPLE_HEAVY)
    table.add_column('', no_wrap=True)
    for share in QUANTILES:
        table.add_column(f'{100 * share:g} %' if share < 1.0 else 'max', justify='right')
    rows: list[tuple[str, Sequence[float | None]]] = [
        ("paper's sense", log_quantiles(residuals.paper)),
        ('  target', TARGETS['paper']),
        ('  with the board origin at its first point', log_quantiles(residuals.paper_any_origin)),
        ('true rotation', log_quantiles(residuals.rotation)),
        ('  target', TARGETS['rotation']),
        ('  effect of one rounding of k', log_quantiles(residuals.rounding)),
        ('true rotation, in the image', log_quantiles(residuals.image)),
        *((f'published: {name}', values) for name, values in RESIDUALS.items()),
    ]
    for name, values in rows:
        table.add_row(name, *('' if v is None else f'{v:.2f}' for v in values))
    return table


def _notes(solved: Solved, residuals: Residuals, counts: all_roots.Counts) -> list[str]:
    unfolded = int(np.sum(distances.horizon(solved).max(axis=1) < 2.0))
    near = residuals.horizon < 1e-3
    return [
        f'{_INSTANCES:,} instances: {len(solved.rows):,} solutions with four positive depths, all '
        f'in the figure. {unfolded:,} of them have k r² < 1 at all points and are returned by '
        'solve_p4pfr.',
        f'From eigenvalues of companion matrices: {counts.real:,} real roots with f² > 0. '
        f'{counts.depths_of_one_sign:,} of them have depths λ of the same sign, '
        f'{counts.z_of_one_sign:,} have Z = λ (1 + k r²) of the same sign, which is probably what '
        "the paper's figure shows.",
        f'{np.sum(near):,} solutions have a point with |1 + k r²| < 1e-3. The quantiles of the '
        f'others, true rotation: {log_quantiles(residuals.rotation[~near])}.',
    ]


if __name__ == '__main__':
    raise SystemExit(main())
