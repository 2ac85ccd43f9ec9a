# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""Nodes as processes of their own: started, watched, and ended one by one."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from contextlib import AbstractContextManager
from pathlib import Path
import signal
import subprocess
import sys
from typing import Any

# A process has so long to go away after each of these.
_LAST_WORDS = ((signal.SIGINT, 5.0), (signal.SIGTERM, 5.0), (signal.SIGKILL, 5.0))


class Children(AbstractContextManager['Children']):
    """
    Starts nodes, and ends whatever still runs when the ``with`` block is left.

    Parameters
    ----------
    log_folder
        Where each node's output is kept, ``<node>.log``.

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
        """Return what is to be said of a node that has ended by itself, or None."""
        for node, process in self._processes.items():
            if process.poll() is not None:
                return f'{node} ended with status {process.returncode}\n{self.words()}'
        return None

    def words(self) -> str:
        """Return what all nodes have printed."""
        logs = ((node, self._log(node).read_text(errors='replace')) for node in self._processes)
        return '\n'.join(f'{node}: {log.strip() or "(nothing said)"}' for node, log in logs)

    def __exit__(self, *_: object) -> None:
        # A second Ctrl-C must not leave half of them running.
        before = signal.signal(signal.SIGINT, signal.SIG_IGN)
        try:
            self._end_all()
        finally:
            signal.signal(signal.SIGINT, before)

    def _end_all(self) -> None:
        for number, patience_s in _LAST_WORDS:
            for process in self._processes.values():
                if process.poll() is None:
                    process.send_signal(number)
            if self._all_gone(patience_s):
                return

    def _all_gone(self, patience_s: float) -> bool:
        for process in self._processes.values():
            try:
                process.wait(patience_s)
            except subprocess.TimeoutExpired:
                return False
        return True

    def _log(self, node: str) -> Path:
        return self._log_folder / f'{node}.log'
