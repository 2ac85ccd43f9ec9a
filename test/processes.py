# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""Groups of processes that tests start, interrupt and kill."""

from contextlib import suppress
import os
from pathlib import Path
import signal
import time

TIMEOUT_S = 300.0


def wait_until(condition, timeout_s=TIMEOUT_S):
    """Wait until a condition holds, and return its value."""
    end_s = time.monotonic() + timeout_s
    while not (value := condition()):
        assert time.monotonic() < end_s, 'timeout'
        time.sleep(0.02)
    return value


def running_in(group):
    """Return the ids of the processes of a group that run; those that have ended may linger."""
    found = []
    for name in filter(str.isdigit, os.listdir('/proc')):
        with suppress(OSError):
            stat = Path(f'/proc/{name}/stat').read_text()
            state, _, of_group = stat.rpartition(')')[2].split()[:3]
            if int(of_group) == group and state != 'Z':
                found.append(int(name))
    return found


def has_ended(group):
    """Return whether no process of a group runs."""
    return not running_in(group)


def listening_addresses(group):
    """Return the IP addresses, as in /proc/net, at which processes of a group listen."""
    sockets = set()
    for process in running_in(group):
        for descriptor in Path(f'/proc/{process}/fd').iterdir():
            with suppress(OSError):
                sockets.add(os.readlink(descriptor))
    found = set()
    for table in ('/proc/net/tcp', '/proc/net/tcp6'):
        for line in Path(table).read_text().splitlines()[1:]:
            fields = line.split()
            if fields[3] == '0A' and f'socket:[{fields[9]}]' in sockets:
                found.add(fields[1].split(':')[0])
    return found


def own_lines(err):
    """Return the lines of stderr but those on the compilation of kernels."""
    return [line for line in err.splitlines() if not line.startswith('p4pfr_ros: ')]


def end(process):
    """Kill the group of a process that a test started in a session of its own."""
    with suppress(ProcessLookupError):
        os.killpg(process.pid, signal.SIGKILL)
    process.wait()
    for stream in (process.stdout, process.stderr):
        if stream is not None:
            stream.close()
