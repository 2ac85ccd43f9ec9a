# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""Progress bars and tables, by rich."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
import shutil
import sys
import textwrap
from typing import Literal, TypeVar

from p4pfr_ros.files.dependencies import is_installed

Item = TypeVar('Item')

# Without a terminal, wide enough for every row.
_DEFAULT_WIDTH = 200
# Columns are left out rather than that less than this is left of a name.
_NAME_WIDTH, _SHORTEST_NAME = 16, 4
# Between two columns.
_BETWEEN = 2


def with_progress(items: Iterable[Item], total: int | None, *, prints: bool) -> Iterator[Item]:
    """
    Yield images, with a progress bar if stderr is a terminal and there are several images.

    Parameters
    ----------
    items, total
        The images and their number (None: unknown).
    prints
        Whether the caller prints lines in between. On a terminal they would break the bar, so it
        is not shown.

    """
    breaks_bar = prints and sys.stdout.isatty()
    single = total is not None and total < 2
    if single or breaks_bar or not sys.stderr.isatty() or not is_installed('rich'):
        yield from items
        return
    from rich.console import Console
    from rich.progress import MofNCompleteColumn, Progress

    # Without redirection: rich would send what the caller prints to stderr, like the bar.
    with Progress(
        *Progress.get_default_columns(),
        MofNCompleteColumn(),
        console=Console(stderr=True),
        transient=True,
        redirect_stdout=False,
        redirect_stderr=False,
    ) as progress:
        yield from progress.track(items, total=total, description='images')


def print_table(
    headings: Sequence[str],
    rows: Iterable[Iterable[str]],
    left: Sequence[str] = ('image',),
    optional: Sequence[str] = (),
) -> None:
    """
    Print a table with one line a row; on a terminal, no wider than it.

    Parameters
    ----------
    headings, rows
        Headings of the columns, and the cells of each row.
    left
        Headings of columns that are aligned to the left; the first of them is the name of the
        row, whose begin is left out where it is too long.
    optional
        Headings of columns that may be left out, the least important first.

    """
    from rich import box
    from rich.console import Console
    from rich.table import Table
    from rich.text import Text

    console = Console(width=None if sys.stdout.isatty() else _DEFAULT_WIDTH, highlight=False)
    columns = _fitted(headings, list(zip(*rows, strict=True)), console.width, left[0], optional)
    table = Table(box=box.SIMPLE_HEAD, show_edge=False, pad_edge=False, padding=(0, 1, 0, 0))
    for heading in columns:
        justify: Literal['left', 'right'] = 'left' if heading in left else 'right'
        # Names of any length go to a file.
        is_name = heading == left[0] and not sys.stdout.isatty()
        overflow: Literal['fold', 'ellipsis'] = 'fold' if is_name else 'ellipsis'
        table.add_column(heading, justify=justify, overflow=overflow, no_wrap=not is_name)
    for row in zip(*columns.values(), strict=True):
        table.add_row(*(Text(cell) for cell in row))
    console.print(table)


def _fitted(
    headings: Sequence[str],
    columns: Sequence[Sequence[str]],
    width: int,
    name: str,
    optional: Sequence[str],
) -> dict[str, Sequence[str]]:
    """Return the columns by heading that fit into a width, with shortened names of the rows."""
    cells: dict[str, Sequence[str]] = dict.fromkeys(headings, ())
    cells |= dict(zip(headings, columns, strict=bool(columns)))
    widths = {h: max(map(len, (h, *column))) for h, column in cells.items()}
    longest = widths[name]
    widths[name] = min(longest, _NAME_WIDTH)
    for heading in optional:
        if sum(widths.values()) + _BETWEEN * (len(widths) - 1) > width:
            del widths[heading]
    rest = width - sum(widths.values()) - _BETWEEN * (len(widths) - 1) + widths[name]
    if sys.stdout.isatty() and longest > rest >= _SHORTEST_NAME:
        cells[name] = [_shortened(cell, rest) for cell in cells[name]]
    return {heading: cells[heading] for heading in widths}


def _shortened(name: str, width: int) -> str:
    return name if len(name) <= width else f'…{name[1 - width :]}'


def print_note(text: str) -> None:
    """Print a line of text; on a terminal, wrapped at words."""
    width = shutil.get_terminal_size().columns if sys.stdout.isatty() else len(text)
    print(textwrap.fill(text, max(width, 40), subsequent_indent='  ', break_long_words=False))
