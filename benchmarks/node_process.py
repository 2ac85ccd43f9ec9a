# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""Runs a node as a process, and measures its CPU time and memory."""

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

_STARTUP_TIMEOUT_S = 120.0  # the first start compiles the kernels
_SHUTDOWN_TIMEOUT_S = 10.0
_TICKS_PER_S = os.sysconf('SC_CLK_TCK')


class MeasuredProcess(AbstractContextManager['MeasuredProcess']):
    """
    Starts a module that logs "ready", and stops it at the end of the ``with`` block.

    Parameters
    ----------
    module
        The module for ``python -m``.
    namespace
        The namespace of its node.
    settings
        The parameters of its node.
    log
        The file for its output.

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
        """Wait for "ready" in the log; ``RuntimeError`` with the log on exit or timeout."""
        ends_s = time.monotonic() + _STARTUP_TIMEOUT_S
        while 'ready' not in self._log.read_text(errors='replace'):
            if self._process.poll() is not None or time.monotonic() > ends_s:
                raise RuntimeError(f'not ready: {self._log.read_text(errors="replace")}')
            time.sleep(0.05)

    @property
    def processor_s(self) -> float:
        """The CPU time of all its threads."""
        # The process name, in parentheses, may contain spaces. Fields 14 and 15 are user and
        # system time.
        fields = self._proc('stat').rpartition(')')[2].split()
        return (int(fields[11]) + int(fields[12])) / _TICKS_PER_S

    @property
    def memory_mib(self) -> float:
        """Its resident memory."""
        line = next(li for li in self._proc('status').splitlines() if li.startswith('VmRSS:'))
        return int(line.split()[1]) / 1024.0

    def __exit__(self, *_: object) -> None:
        self._process.send_signal(signal.SIGINT)
        try:
            self._process.wait(_SHUTDOWN_TIMEOUT_S)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait()

    def _proc(self, name: str) -> str:
        return Path(f'/proc/{self._process.pid}/{name}').read_text()
