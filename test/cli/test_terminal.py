# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""The progress bar, on a real terminal."""

import os
import pty
import re
import sys

from p4pfr_ros.cli.terminal import print_table, with_progress
import pytest


def on_terminal(items, total, monkeypatch):
    """Iterate with a terminal as stderr; return the items and the output on the terminal."""
    screen, device = pty.openpty()
    with os.fdopen(device, 'w') as stderr, monkeypatch.context() as patch:
        patch.setenv('TERM', 'xterm')
        patch.setattr(sys, 'stderr', stderr)
        yielded = list(with_progress(items, total, prints=False))
        stderr.write('the end')
        stderr.flush()
        shown = b''
        while not shown.endswith(b'the end'):  # read() returns parts of it
            shown += os.read(screen, 100_000)
    os.close(screen)
    return yielded, shown.decode()


@pytest.mark.parametrize(('total', 'count'), [(3, '3/3'), (None, '3/?')])
def test_bar_counts_up_to_the_total_if_known(monkeypatch, total, count):
    yielded, shown = on_terminal((n for n in 'abc'), total, monkeypatch)
    assert yielded == ['a', 'b', 'c']
    assert count in shown


def test_one_image_has_no_bar(monkeypatch):
    assert on_terminal(['a'], 1, monkeypatch) == (['a'], 'the end')


def test_without_rich_there_is_no_bar(monkeypatch):
    monkeypatch.setitem(sys.modules, 'rich', None)
    assert on_terminal('abc', 3, monkeypatch) == (['a', 'b', 'c'], 'the end')


@pytest.mark.parametrize('width', [60, 80, 130])
def test_a_table_has_a_line_a_row_however_narrow_the_terminal(monkeypatch, width):
    headings = ('image', 'x y z, m', 'quaternion', 'k')
    row = (
        '/a/long/path/to/an/image_of_the_board_0001.png',
        '0.123 -0.456 0.789',
        35 * 'q',
        '-0.25',
    )
    screen, device = pty.openpty()
    with os.fdopen(device, 'w') as stdout, monkeypatch.context() as patch:
        patch.setenv('COLUMNS', str(width))
        patch.setenv('TERM', 'xterm')
        patch.setenv('NO_COLOR', '1')
        patch.setattr(sys, 'stdout', stdout)
        print_table(headings, [row] * 3, optional=('quaternion', 'k'))
        stdout.write('the end')
        stdout.flush()
        shown = b''
        while not shown.endswith(b'the end'):
            shown += os.read(screen, 100_000)
    os.close(screen)
    text = re.sub(r'\x1b\[[0-9;]*m', '', shown.decode())
    lines = [line.rstrip() for line in text.splitlines()[:-1]]
    assert len(lines) == 5
    assert max(map(len, lines)) <= width
    assert all('board_0001.png  ' in line for line in lines[2:])
    assert ('q' * 35 in lines[2]) == (width >= 80)
    assert '0.123 -0.456 0.789' in lines[2]
