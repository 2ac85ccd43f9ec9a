# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""
The minimal solver in one table: recall, checks and speed, beside what others published.

    python -m benchmarks.minimal [--quick] [--markdown FILE]
"""

from __future__ import annotations

import argparse
import functools
import operator
from pathlib import Path
from typing import NamedTuple

import numpy as np
from rich.box import SIMPLE_HEAVY
from rich.console import Console
from rich.table import Table

from .accuracy import Accuracy, Class, CLASSES, measure
from .published import EIGVALS_US, RECALL, Recall, TIMES_US, UNPUBLISHED
from .speed import batch_speed, single_speed, Speed

_TIMING_SEED = 12345
_WIDTH = 140

HEADER = (
    'instances',
    'recall %\nto 1e-6',
    'recall %\nto 1e-3',
    'solu-\ntions',
    'batch,\neigvals',
    'one call,\neigvals',
    'off,\npx',
    'limit °',
    'radialpose °',
    "paper's\ncode °",
)
FOOTNOTE = '° published on another machine, recall % at 1e-6 / 1e-3; empty: not published.'


class Row(NamedTuple):
    """One class of instances."""

    name: str
    accuracy: Accuracy
    batch: Speed
    single: Speed
    published: Recall

    def cells(self) -> tuple[str, ...]:
        """Format as HEADER has it."""
        a = self.accuracy
        return (
            self.name,
            f'{100.0 * a.to_1e6 / a.instances:.3f}',
            f'{100.0 * a.to_1e3 / a.instances:.3f}',
            f'{a.solutions / a.instances:.2f}',
            f'{self.batch.ratio:.3f}',
            f'{self.single.ratio:.2f}',
            f'{a.off_px:.0e}',
            *self.published,
        )


def main(arguments: list[str] | None = None) -> int:
    """Measure, print, and return 1 if any solution failed its checks."""
    parser = argparse.ArgumentParser(prog='python -m benchmarks.minimal', description=__doc__)
    parser.add_argument('--quick', action='store_true', help='10,000 instances a class')
    parser.add_argument('--markdown', type=Path, metavar='FILE', help='write the table there too')
    options = parser.parse_args(arguments)
    n = 10_000 if options.quick else 100_000
    console = Console()
    console.width = max(console.width, _WIDTH)  # what is cut off helps nobody
    rows = []
    with console.status('') as status:
        for name, chosen in CLASSES.items():
            status.update(f'{name}: {n:,} instances')
            rows.append(_row(name, chosen, n))
    title = f'{n:,} instances a class, without noise'
    notes = _notes(rows)
    console.print(_table(rows, title), *notes, sep='\n', soft_wrap=True)
    if options.markdown:
        options.markdown.write_text(_markdown(rows, title, notes), encoding='utf-8')
    return 0 if all(row.accuracy.sound for row in rows) else 1


def _row(name: str, chosen: Class, n: int) -> Row:
    drawn = chosen.draw(n // 2, _TIMING_SEED)
    some = chosen.draw(n // 20, _TIMING_SEED)
    return Row(
        name,
        measure(chosen, n),
        batch_speed(drawn),
        single_speed(some),
        RECALL.get(name, UNPUBLISHED),
    )


def _notes(rows: list[Row]) -> list[str]:
    return [
        FOOTNOTE,
        _checks(functools.reduce(operator.add, (r.accuracy for r in rows))),
        _times(rows),
    ]


def _checks(a: Accuracy) -> str:
    beyond = (
        'none beyond 1e-9 of the image size'
        if a.over == 0
        else (
            f'{a.over} beyond 1e-9 of the image size, {a.over - a.unexplained} of them because '
            'the translation of a board far from its origin, rounded, moves the point as much'
        )
    )
    return (
        f'Checks on all {a.solutions:,} solutions: largest |RᵀR - I| {a.off_rotation:.0e}; '
        f'{a.behind} with a depth λ ≤ 0; largest error of reprojection {a.off_px:.0e} px, '
        f'{beyond}.'
    )


def _times(rows: list[Row]) -> str:
    eigvals_us = float(np.mean([row.batch.eigvals_us for row in rows]))
    patch = rows[0]
    theirs = ', '.join(
        f'{name} {us:g} µs = {us / EIGVALS_US:.1f}' for name, us in TIMES_US.items()
    )
    return (
        f'One 6x6 np.linalg.eigvals, the unit: {eigvals_us:.2f} µs here, {EIGVALS_US} µs on the '
        f'other machine. {patch.name}, here: {patch.batch.solve_us:.2f} µs = '
        f'{patch.batch.ratio:.2f} in a batch on one core, {patch.single.solve_us:.1f} µs = '
        f'{patch.single.ratio:.1f} called one by one. Published on the other machine: {theirs}.'
    )


def _table(rows: list[Row], title: str) -> Table:
    table = Table(title=title, box=SIMPLE_HEAVY)
    for column in HEADER:
        table.add_column(column, justify='left' if column == HEADER[0] else 'right', no_wrap=True)
    for row in rows:
        table.add_row(*row.cells())
    return table


def _markdown(rows: list[Row], title: str, notes: list[str]) -> str:
    lines = [
        '# The minimal solver, measured',
        '',
        f'Written by `python -m benchmarks.minimal --markdown`: {title}.',
        '',
        '| ' + ' | '.join(HEADER).replace('-\n', '').replace('\n', ' ') + ' |',
        '|---' + '|--:' * (len(HEADER) - 1) + '|',
        *('| ' + ' | '.join(row.cells()) + ' |' for row in rows),
    ]
    return '\n'.join([*lines, *(f'\n{note}' for note in notes)]) + '\n'


if __name__ == '__main__':
    raise SystemExit(main())
