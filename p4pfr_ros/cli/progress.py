# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""A bar for whoever waits."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
import sys
from typing import TypeVar

Item = TypeVar('Item')


def with_progress(items: Iterable[Item], total: int | None, *, prints: bool) -> Iterator[Item]:
    """
    Go through pictures, with a bar on stderr where a person waits for many.

    Parameters
    ----------
    items, total
        The pictures, and how many there are (None: nobody knows).
    prints
        Whether lines are printed meanwhile: on a terminal they would tear the bar.

    """
    lines_on_screen = prints and sys.stdout.isatty()
    if (total is not None and total < 2) or lines_on_screen or not sys.stderr.isatty():
        yield from items
        return
    from rich.console import Console
    from rich.progress import MofNCompleteColumn, Progress

    # Unredirected: or what is printed meanwhile would go where the bar is, to stderr.
    with Progress(
        *Progress.get_default_columns(),
        MofNCompleteColumn(),
        console=Console(stderr=True),
        transient=True,
        redirect_stdout=False,
        redirect_stderr=False,
    ) as progress:
        yield from progress.track(items, total=total, description='pictures')
