# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""Tables of results, for the terminal and for Markdown pages."""

from __future__ import annotations

from collections.abc import Sequence

from rich.box import SIMPLE_HEAVY
from rich.table import Table

Row = tuple[str, ...]

# Title, header and rows; line breaks in a heading apply to the terminal only.
Measured = tuple[str, Row, Sequence[Row]]


def table_of(title: str, header: Row, rows: Sequence[Row]) -> Table:
    """Format a table for the terminal."""
    table = Table(title=title, box=SIMPLE_HEAVY)
    for column in header:
        table.add_column(column, justify='right', no_wrap=True)
    for row in rows:
        table.add_row(*row)
    return table


def page_of(
    title: str, command: str, tables: Sequence[Measured], notes: Sequence[str] = ()
) -> str:
    """Format tables and notes as a Markdown page that names the command that wrote it."""
    lines = [f'# {title}', '', f'Written by `{command}`.']
    for heading, header, rows in tables:
        columns = (text.replace('-\n', '').replace('\n', ' ') for text in header)
        lines += ['', f'## {heading}', '', '| ' + ' | '.join(columns) + ' |']
        lines += ['|' + '--:|' * len(header), *('| ' + ' | '.join(row) + ' |' for row in rows)]
    return '\n'.join([*lines, *(f'\n{note}' for note in notes)]) + '\n'
