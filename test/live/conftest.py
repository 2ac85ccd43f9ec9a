# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""The command ``p4pfr live`` as a process, and a real browser."""

import re
import subprocess
import sys

from browser import browser, open_page  # noqa: F401  (fixtures)
import pytest
from rendered import CHESSBOARD, write_empty, write_views

TIMEOUT_S = 200.0


@pytest.fixture(scope='session')
def images(tmp_path_factory):
    """Return a folder of rendered views of the chessboard, and one image without it."""
    folder = tmp_path_factory.mktemp('views')
    write_views(folder, 12)
    write_empty(folder / 'view03a.png')
    return folder


class LiveProcess:
    """The command as a user starts it; a free port is taken."""

    def __init__(self, *arguments):
        command = [sys.executable, '-m', 'p4pfr_ros', 'live', *map(str, arguments)]
        self.process = subprocess.Popen(
            [*command, '--board', CHESSBOARD, '--port', '0'],
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
        )
        line = self.process.stdout.readline()
        address = re.search(r'http\S+', line)
        assert address, line + self.process.communicate()[1]
        self.url = address.group()

    def stop(self):
        """End it by SIGTERM; return exit status and stderr."""
        self.process.terminate()
        _, errors = self.process.communicate(timeout=TIMEOUT_S)
        return self.process.returncode, errors


@pytest.fixture
def start_live():
    """Give a function that starts the command."""
    started = []

    def start(*arguments):
        started.append(LiveProcess(*arguments))
        return started[-1]

    yield start
    for live in started:
        if live.process.poll() is None:
            live.process.kill()
        live.process.communicate()
