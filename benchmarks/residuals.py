# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""
The residual figure of the paper, drawn anew: 100,000 standard-normal instances.

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

# Zero has no logarithm: below what one rounding leaves.
_FLOOR = 1e-18

_WIDTH = 110

# What was asked of this project, as QUANTILES has it; None: nothing.
TARGETS = {
    'paper': (-15.3, None, None, -10.5, -6.5),
    'rotation': (-14.9, None, None, -9.5, -6.0),
}


def main(arguments: list[str] | None = None) -> int:
    """Solve, print the quantiles, draw."""
    parser = argparse.ArgumentParser(prog='python -m benchmarks.residuals', description=__doc__)
    parser.add_argument('--output', type=Path, default=_OUTPUT, metavar='PNG')
    parser.add_argument('--seed', type=int, default=0)
    options = parser.parse_args(arguments)
    image, board = draw(_INSTANCES, options.seed)
    solved = solve(image, board)
    found = measure(solved)
    console = Console()
    console.width = max(console.width, _WIDTH)
    console.print(_table(found))
    for line in _notes(solved, found, all_roots.count(image, board)):
        console.print(line, soft_wrap=True)
    draw_figure(found, options.output)
    console.print(f'written: {options.output}')
    return 0


def measure(solved: Solved) -> Residuals:
    """Take the residual in every sense."""
    return Residuals(
        paper=_positive(distances.paper(solved, nearest_horizon=True)),
        paper_any_origin=_positive(distances.paper(solved, nearest_horizon=False)),
        rotation=_positive(distances.undistorted(solved)),
        image=_positive(distances.in_image(solved)),
        rounding=_positive(distances.rounding(solved)),
        horizon=np.abs(distances.horizon(solved)).min(axis=1),
    )


def log_quantiles(residuals: Array) -> list[float]:
    """Return log10 at QUANTILES."""
    return [round(float(q), 2) for q in np.log10(np.quantile(residuals, QUANTILES))]


def _positive(residuals: Array) -> Array:
    return np.maximum(residuals, _FLOOR)


def _table(found: Residuals) -> Table:
    table = Table(title='log10 of the residual', box=SIMPLE_HEAVY)
    table.add_column('', no_wrap=True)
    for share in QUANTILES:
        table.add_column(f'{100 * share:g} %' if share < 1.0 else 'max', justify='right')
    rows: list[tuple[str, Sequence[float | None]]] = [
        ("paper's sense", log_quantiles(found.paper)),
        ('  target', TARGETS['paper']),
        ("  the board's origin at its first point", log_quantiles(found.paper_any_origin)),
        ('true rotation', log_quantiles(found.rotation)),
        ('  target', TARGETS['rotation']),
        ('  what one rounding of k alone moves', log_quantiles(found.rounding)),
        ('true rotation, in the image', log_quantiles(found.image)),
        *((f'published: {name}', values) for name, values in RESIDUALS.items()),
    ]
    for name, values in rows:
        table.add_row(name, *('' if v is None else f'{v:.2f}' for v in values))
    return table


def _notes(solved: Solved, found: Residuals, counts: all_roots.Counts) -> list[str]:
    unfolded = int(np.sum(distances.horizon(solved).max(axis=1) < 2.0))
    near = found.horizon < 1e-3
    return [
        f'{_INSTANCES:,} instances: {len(solved.rows):,} solutions with four positive depths, all '
        f'drawn here ({unfolded:,} of them with k r² < 1 throughout, which solve_p4pfr returns).',
        f'By eigenvalues of companion matrices: {counts.real:,} real roots with f² > 0; '
        f'{counts.depths_of_one_sign:,} have depths λ of one sign, {counts.z_of_one_sign:,} have '
        "Z = λ (1 + k r²) of one sign, which is what the paper's figure seems to have counted.",
        f'A point with |1 + k r²| < 1e-3 is in {np.sum(near):,} solutions; without them the true '
        f"rotation's quantiles are {log_quantiles(found.rotation[~near])}.",
    ]


if __name__ == '__main__':
    raise SystemExit(main())
