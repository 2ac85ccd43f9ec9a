# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""
The minimal solver in one table: recall, checks and speed, with published results of others.

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

from .accuracy import Accuracy, CLASSES, InstanceClass, measure
from .published import (
    EIGVALS_US,
    PEERS_EIGVALS_US,
    PEERS_US,
    RECALL,
    Recall,
    TIMES_US,
    UNPUBLISHED,
)
from .speed import batch_speed, single_speed, Speed

_TIMING_SEED = 12345
_WIDTH = 160

HEADER = (
    'instances',
    'recall %\nto 1e-6',
    'recall %\nto 1e-3',
    'solutions per\ninstance',
    'batch,\neigvals',
    'single call,\neigvals',
    'largest re-\nprojection\nerror, px',
    'limit °',
    'radialpose °',
    "paper's\ncode °",
)
FOOTNOTE = (
    'Columns with ° are published results from another machine, recall % at 1e-6 / 1e-3; empty: '
    'not published. limit: the recall that image points rounded to double precision allow.'
)


class Row(NamedTuple):
    """The results for one class of instances."""

    name: str
    accuracy: Accuracy
    batch: Speed
    single: Speed
    published: Recall

    def cells(self) -> tuple[str, ...]:
        """Format the row in the order of HEADER."""
        a = self.accuracy
        return (
            self.name,
            f'{100.0 * a.to_1e6 / a.instances:.3f}',
            f'{100.0 * a.to_1e3 / a.instances:.3f}',
            f'{a.solutions / a.instances:.2f}',
            f'{self.batch.ratio:.3f}',
            f'{self.single.ratio:.2f}',
            f'{a.max_reprojection_px:.0e}',
            *self.published,
        )


def main(arguments: list[str] | None = None) -> int:
    """Run the benchmark, print the table, and return 1 if any solution failed its checks."""
    parser = argparse.ArgumentParser(
        prog='python -m benchmarks.minimal', description=__doc__.split('\n\n')[0]
    )
    parser.add_argument(
        '--quick', action='store_true', help='10,000 instances per class instead of 100,000'
    )
    parser.add_argument(
        '--markdown', type=Path, metavar='FILE', help='also write the table to FILE'
    )
    options = parser.parse_args(arguments)
    n = 10_000 if options.quick else 100_000
    console = Console()
    console.width = max(console.width, _WIDTH)  # do not truncate cells
    rows = []
    with console.status('') as status:
        for name, instance_class in CLASSES.items():
            status.update(f'{name}: {n:,} instances')
            rows.append(_row(name, instance_class, n))
    title = f'{n:,} instances per class, without noise'
    notes = _notes(rows)
    console.print(_table(rows, title), *notes, sep='\n', soft_wrap=True)
    if options.markdown:
        options.markdown.write_text(_markdown(rows, title, notes), encoding='utf-8')
    return 0 if all(row.accuracy.valid for row in rows) else 1


def _row(name: str, instance_class: InstanceClass, n: int) -> Row:
    for_batch = instance_class.draw(n // 2, _TIMING_SEED)
    for_single = instance_class.draw(n // 20, _TIMING_SEED)
    return Row(
        name,
        measure(instance_class, n),
        batch_speed(for_batch),
        single_speed(for_single),
        RECALL.get(name, UNPUBLISHED),
    )


def _notes(rows: list[Row]) -> list[str]:
    return [
        FOOTNOTE,
        _checks(functools.reduce(operator.add, (r.accuracy for r in rows))),
        _times(rows),
        _peers(rows),
    ]


def _checks(a: Accuracy) -> str:
    above = (
        'none above 1e-9 of the image size'
        if a.over_limit == 0
        else (
            f'{a.over_limit} above 1e-9 of the image size, {a.over_limit - a.unexplained} of them '
            'explained by the rounding of the translation of a board far from its origin'
        )
    )
    return (
        f'Checks on all {a.solutions:,} solutions: largest |RᵀR - I| {a.max_rotation_defect:.0e}; '
        f'{a.negative_depths} with a depth λ ≤ 0; largest reprojection error '
        f'{a.max_reprojection_px:.0e} px, {above}.'
    )


def _times(rows: list[Row]) -> str:
    eigvals_us = float(np.mean([row.batch.eigvals_us for row in rows]))
    patch = rows[0]
    published = ', '.join(
        f'{name} {us:g} µs = {us / EIGVALS_US:.1f}' for name, us in TIMES_US.items()
    )
    return (
        f'Unit of time, one 6x6 np.linalg.eigvals: {eigvals_us:.2f} µs on this machine, '
        f'{EIGVALS_US} µs on the other. {patch.name}, this machine: '
        f'{patch.batch.solve_us:.2f} µs = {patch.batch.ratio:.2f} in a batch on one core, '
        f'{patch.single.solve_us:.1f} µs = {patch.single.ratio:.1f} per single call. '
        f'Published, other machine: {published}.'
    )


def _peers(rows: list[Row]) -> str:
    patch, square = (row.batch.ratio for row in rows[:2])
    peers = '; '.join(
        f'{name} {first} / {second} µs = {first / PEERS_EIGVALS_US:.2f} / '
        f'{second / PEERS_EIGVALS_US:.2f}'
        for name, (first, second) in PEERS_US.items()
    )
    return (
        'Peers in C++, patch / square, on a machine of the same kind, where one eigvals took '
        f'{PEERS_EIGVALS_US} µs: {peers}. This solver in the same unit: '
        f'{patch:.2f} / {square:.2f}.'
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
    chart = (
        '\n![Stages](minimal_stages.png)\n\nWhere the nanoseconds go, in a batch on one core '
        '(`python -m benchmarks.minimal_stages`).'
    )
    return '\n'.join([*lines, *(f'\n{note}' for note in notes), chart]) + '\n'


if __name__ == '__main__':
    raise SystemExit(main())
