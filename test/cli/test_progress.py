# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""The bar of the commands, on a real terminal."""

import os
import pty
import sys

from p4pfr_ros.cli.progress import with_progress
import pytest


def on_terminal(items, total, monkeypatch):
    """Go through items with a terminal for stderr; give them, and what was on its screen."""
    screen, its_end = pty.openpty()
    with os.fdopen(its_end, 'w') as stderr, monkeypatch.context() as patch:
        patch.setenv('TERM', 'xterm')
        patch.setattr(sys, 'stderr', stderr)
        seen = list(with_progress(items, total, prints=False))
        stderr.write('the end')
        stderr.flush()
        shown = b''
        while not shown.endswith(b'the end'):  # it comes in parts
            shown += os.read(screen, 100_000)
    os.close(screen)
    return seen, shown.decode()


@pytest.mark.parametrize(('total', 'told'), [(3, '3/3'), (None, '3/?')])
def test_bar_counts_to_an_end_that_it_may_not_know(monkeypatch, total, told):
    seen, shown = on_terminal((n for n in 'abc'), total, monkeypatch)
    assert seen == ['a', 'b', 'c']
    assert told in shown


def test_one_picture_has_no_bar(monkeypatch):
    assert on_terminal(['a'], 1, monkeypatch) == (['a'], 'the end')
