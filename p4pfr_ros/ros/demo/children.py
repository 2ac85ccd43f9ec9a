# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""
Nodes as child processes: started, monitored and stopped.

This module stands alone: it runs any commands as processes, independent of the demo.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from contextlib import AbstractContextManager
from pathlib import Path
import signal
import subprocess
import sys
from typing import Any

# Signals that stop a process, and how long to wait after each.
_STOP_SIGNALS = ((signal.SIGINT, 5.0), (signal.SIGTERM, 5.0), (signal.SIGKILL, 5.0))


class Children(AbstractContextManager['Children']):
    """
    Starts nodes, and stops those that still run when the ``with`` block ends.

    Parameters
    ----------
    log_folder
        Folder for the output of each node, ``<node>.log``.

    """

    def __init__(self, log_folder: Path) -> None:
        self._log_folder = log_folder
        self._processes: dict[str, subprocess.Popen[bytes]] = {}

    def start(self, node: str, parameters: Mapping[str, Any] | None = None) -> None:
        """Start ``p4pfr_ros.ros.<node>`` with parameters."""
        command = [sys.executable, '-m', f'p4pfr_ros.ros.{node}', '--ros-args']
        for name, value in (parameters or {}).items():
            command += ['-p', f'{name}:={value}']
        self.launch(node, command)

    def launch(self, name: str, command: Sequence[str]) -> None:
        """Start any command, under a name."""
        with self._log(name).open('wb') as log:
            self._processes[name] = subprocess.Popen(
                command, stdin=subprocess.DEVNULL, stdout=log, stderr=subprocess.STDOUT
            )

    def dead(self) -> str | None:
        """Return a message if a node has exited on its own, or None."""
        for node, process in self._processes.items():
            if process.poll() is not None:
                return f'{node} exited with status {process.returncode}\n{self.output()}'
        return None

    def output(self) -> str:
        """Return the output of all nodes."""
        logs = ((node, self._log(node).read_text(errors='replace')) for node in self._processes)
        return '\n'.join(f'{node}: {log.strip() or "(no output)"}' for node, log in logs)

    def __exit__(self, *_: object) -> None:
        # A second Ctrl-C must not interrupt the stopping.
        before = signal.signal(signal.SIGINT, signal.SIG_IGN)
        try:
            self._stop_all()
        finally:
            signal.signal(signal.SIGINT, before)

    def _stop_all(self) -> None:
        for number, timeout_s in _STOP_SIGNALS:
            for process in self._processes.values():
                if process.poll() is None:
                    process.send_signal(number)
            if self._have_exited(timeout_s):
                return

    def _have_exited(self, timeout_s: float) -> bool:
        for process in self._processes.values():
            try:
                process.wait(timeout_s)
            except subprocess.TimeoutExpired:
                return False
        return True

    def _log(self, node: str) -> Path:
        return self._log_folder / f'{node}.log'
