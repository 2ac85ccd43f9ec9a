# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""Two network namespaces with a cable between them, as two machines. Nothing leaves this one."""

from pathlib import Path
import re
import shutil
import subprocess

ADDRESSES = {'left': '10.77.0.1', 'right': '10.77.0.2'}


class Machines:
    """
    Two network namespaces, ``left`` and ``right``, which exist until ``close``.

    Needs no root where users may make user namespaces.
    """

    def __init__(self):
        self._holders = {}
        try:
            new = ['unshare', '--user', '--map-root-user', '--net']
            self._holders['left'] = _hold(new)
            self._holders['right'] = _hold([*self.inside('left', net=False), 'unshare', '--net'])
            right = str(self._holders['right'].pid)
            cable = ['cable', 'type', 'veth', 'peer', 'cable', 'netns', right]
            self._run('left', 'ip', 'link', 'add', *cable)
            for name, address in ADDRESSES.items():
                self._run(name, 'ip', 'address', 'add', f'{address}/24', 'dev', 'cable')
                self._run(name, 'ip', 'link', 'set', 'lo', 'up')
                self._run(name, 'ip', 'link', 'set', 'cable', 'up')
        except BaseException:
            self.close()
            raise

    def inside(self, name, net=True):
        """Return the beginning of a command that runs in a namespace."""
        namespaces = ['--user', '--net'] if net else ['--user']
        pid = str(self._holders[name].pid)
        return ['nsenter', '--target', pid, *namespaces, '--preserve-credentials']

    def received_bytes(self, name):
        """Return how many bytes have come through the cable."""
        table = Path(f'/proc/{self._holders[name].pid}/net/dev').read_text()
        return int(re.search(r'cable: *(\d+)', table).group(1))

    def close(self):
        """End both."""
        for holder in self._holders.values():
            holder.communicate()  # closes its input, which ends it

    def _run(self, name, *command):
        command = [*self.inside(name), *command]
        return subprocess.run(command, check=True, capture_output=True, text=True).stdout


def _hold(command):
    """Start a process that keeps a namespace while this one runs; return when it exists."""
    holder = subprocess.Popen(
        [*command, 'sh', '-c', 'echo; exec cat'],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )
    if not holder.stdout.readline():
        _, errors = holder.communicate()
        raise subprocess.CalledProcessError(holder.returncode, command, stderr=errors)
    return holder


def why_not():
    """Return why there can be no namespaces on this machine; an empty text if there can be."""
    missing = [tool for tool in ('ip', 'nsenter', 'unshare') if shutil.which(tool) is None]
    if missing:
        return f'not installed: {", ".join(missing)} (iproute2, util-linux)'
    try:
        Machines().close()
    except subprocess.CalledProcessError as error:
        return f'no network namespaces: {error.stderr.strip()}'
    return ''
