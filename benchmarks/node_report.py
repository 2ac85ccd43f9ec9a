# SPDX-License-Identifier: Apache-2.0
"""The tables of the benchmark of pose_node, and what is to be said of them."""

from __future__ import annotations

from collections.abc import Sequence

from rich.box import SIMPLE_HEAVY
from rich.table import Table

from .node_load import DEPTH

Row = tuple[str, ...]

LATENCY_HEADER = (
    'points',
    'messages/s',
    'mode',
    'board',
    'p50 ms',
    'p99 ms',
    'bare p50',
    'bare p99',
    'beyond p50',
    'beyond p99',
    'lost',
    'CPU ms',
    'bare CPU',
)
RATE_HEADER = ('', 'highest rate without loss', 'p50 ms there', 'p99 ms there', 'CPU % there')
NOTE = (
    'Corners in to pose out (pose_with_covariance) between processes, the sender being the '
    'receiver. Bare transport: a node in Python that hears the same messages and answers at once; '
    'beyond: the difference of the two. Boards of 4 points are markers on the topic corners, the '
    f'others clouds on correspondences. Both sides reliable, depth {DEPTH}; lost: of all '
    'that were sent. self_calibrate after it has converged. The '
    'board is everywhere: each view from another place, as no board moves; moving: there and '
    'back, in real time at 200 messages a second; or still. CPU ms: processor time of an answer, '
    "the bare transport's beside it."
)


def table_of(title: str, header: Sequence[str], rows: Sequence[Row]) -> Table:
    """Lay a table out for the terminal."""
    table = Table(title=title, box=SIMPLE_HEAVY)
    for column in header:
        table.add_column(column, justify='right', no_wrap=True)
    for row in rows:
        table.add_row(*row)
    return table


def markdown(tables: list[tuple[str, Row, list[Row]]], notes: list[str]) -> str:
    """Write the tables and notes as a page."""
    lines = ['# pose_node under load, measured', '', 'Written by `python -m benchmarks.node`.']
    for title, header, rows in tables:
        lines += ['', f'## {title}', '', '| ' + ' | '.join(header) + ' |']
        lines += ['|' + '--:|' * len(header), *('| ' + ' | '.join(row) + ' |' for row in rows)]
    return '\n'.join([*lines, *(f'\n{note}' for note in notes)]) + '\n'
