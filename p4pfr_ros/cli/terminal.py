# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""Progress and tables, by rich, and the progress of the compiler."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from contextlib import suppress
import sys
from typing import Literal, TypeVar

from p4pfr_ros.cli.arguments import is_installed

Item = TypeVar('Item')

# Without a terminal, wide enough for every row.
_DEFAULT_WIDTH = 200


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


def prepare_kernels() -> None:
    """Compile the kernels if they are not stored, in several processes; show the progress."""
    from p4pfr_ros.kernels.processes import are_compiled, compile_with_progress

    with suppress(OSError, RuntimeError):  # otherwise the first image compiles them
        if not are_compiled():
            compile_with_progress()


def print_table(
    headings: Sequence[str], rows: Iterable[Iterable[str]], left: Sequence[str] = ('image',)
) -> None:
    """Print a table; columns are aligned to the right, except those with the headings ``left``."""
    from rich import box
    from rich.console import Console
    from rich.table import Table
    from rich.text import Text

    console = Console(width=None if sys.stdout.isatty() else _DEFAULT_WIDTH, highlight=False)
    table = Table(box=box.SIMPLE_HEAD, pad_edge=False)
    for heading in headings:
        # Long names wrap, so that no part of a path is lost.
        overflow: Literal['fold', 'ellipsis'] = 'fold' if heading == 'image' else 'ellipsis'
        justify: Literal['left', 'right'] = 'left' if heading in left else 'right'
        table.add_column(heading, justify=justify, overflow=overflow)
    for row in rows:
        table.add_row(*(Text(cell) for cell in row))
    console.print(table)
