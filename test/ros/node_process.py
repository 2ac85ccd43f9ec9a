# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""One of our nodes as a process."""

from pathlib import Path
import signal
import subprocess
import sys
import time

TIMEOUT_S = 200.0


class NodeProcess:
    """One of our nodes as a process, with its output."""

    def __init__(
        self, name, namespace, log, parameters=(), params_file=None, remaps=(), inside=(), env=()
    ):
        self.name = name
        self._log = Path(log)
        command = [*inside, sys.executable, '-m', f'p4pfr_ros.ros.{name}', '--ros-args']
        command += ['-r', f'__ns:={namespace}']
        for remap in remaps:
            command += ['-r', remap]
        if params_file is not None:
            command += ['--params-file', str(params_file)]
        for key, value in dict(parameters).items():
            command += ['-p', f'{key}:={value}']
        with self._log.open('wb') as stream:
            self.process = subprocess.Popen(
                command,
                env=dict(env) or None,
                stdin=subprocess.DEVNULL,
                stdout=stream,
                stderr=subprocess.STDOUT,
            )

    @property
    def output(self):
        """The output of the process."""
        return self._log.read_text(errors='replace')

    def send(self, number=signal.SIGINT):
        """Send a signal, if it runs."""
        if self.process.poll() is None:
            self.process.send_signal(number)

    def stop(self, number=signal.SIGINT):
        """Send a signal; return the exit status."""
        self.send(number)
        return self.wait()

    def wait(self):
        """Wait until it exits; return the exit status."""
        try:
            return self.process.wait(TIMEOUT_S)
        except subprocess.TimeoutExpired:
            self.process.kill()
            self.process.wait()
            raise


def stop_all(nodes):
    """Stop nodes at the same time."""
    for node in nodes:
        node.send()
    for node in nodes:
        node.wait()


def until(condition, *nodes):
    """Wait until a condition holds; on a timeout, show the output of nodes."""
    ends_s = time.monotonic() + TIMEOUT_S
    while not condition():
        assert time.monotonic() < ends_s, '\n'.join(f'--- {n.name}\n{n.output}' for n in nodes)
        time.sleep(0.05)
