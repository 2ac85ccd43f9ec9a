# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""A node as a process that is measured from outside: its processor time and its memory."""

from __future__ import annotations

from collections.abc import Mapping
from contextlib import AbstractContextManager
import os
from pathlib import Path
import signal
import subprocess
import sys
import time
from typing import Any

_PATIENCE_S = 120.0  # the first time, kernels are compiled
_LAST_WORDS_S = 10.0
_TICKS_PER_S = os.sysconf('SC_CLK_TCK')


class MeasuredProcess(AbstractContextManager['MeasuredProcess']):
    """
    Starts a module that says that it is ready, and ends it when the ``with`` block is left.

    Parameters
    ----------
    module
        What ``python -m`` runs.
    namespace
        Of its node.
    settings
        Of its node.
    log
        File that its output goes to.

    """

    def __init__(
        self, module: str, namespace: str, settings: Mapping[str, Any], log: Path
    ) -> None:
        command = [sys.executable, '-m', module, '--ros-args', '-r', f'__ns:={namespace}']
        for name, value in settings.items():
            command += ['-p', f'{name}:={value}']
        self._log = log
        with log.open('wb') as stream:
            self._process = subprocess.Popen(
                command, stdin=subprocess.DEVNULL, stdout=stream, stderr=subprocess.STDOUT
            )

    def wait_until_ready(self) -> None:
        """Wait for its word; ``RuntimeError`` with its output if it ends or is silent instead."""
        ends_s = time.monotonic() + _PATIENCE_S
        while 'ready' not in self._log.read_text(errors='replace'):
            if self._process.poll() is not None or time.monotonic() > ends_s:
                raise RuntimeError(f'not ready: {self._log.read_text(errors="replace")}')
            time.sleep(0.05)

    @property
    def processor_s(self) -> float:
        """Time that its threads have kept processors busy."""
        # The name, in parentheses, may hold spaces; user and system time are fields 14 and 15.
        fields = self._proc('stat').rpartition(')')[2].split()
        return (int(fields[11]) + int(fields[12])) / _TICKS_PER_S

    @property
    def memory_mib(self) -> float:
        """Memory that it holds."""
        line = next(li for li in self._proc('status').splitlines() if li.startswith('VmRSS:'))
        return int(line.split()[1]) / 1024.0

    def __exit__(self, *_: object) -> None:
        self._process.send_signal(signal.SIGINT)
        try:
            self._process.wait(_LAST_WORDS_S)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait()

    def _proc(self, name: str) -> str:
        return Path(f'/proc/{self._process.pid}/{name}').read_text()
