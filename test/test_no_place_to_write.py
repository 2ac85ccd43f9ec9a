# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""A user without a name and a home directory: kernels, command and nodes work, with a warning."""

import os
from pathlib import Path
import shutil
import signal
import subprocess
import sys

import p4pfr_ros
import pytest
from unprivileged import AS_UNKNOWN_USER, USER, why_not

IMPOSSIBLE = why_not()
pytestmark = pytest.mark.skipif(bool(IMPOSSIBLE), reason=IMPOSSIBLE)

SCRIPT = """
import numpy as np
import p4pfr_ros
from p4pfr_ros.cli import main
from p4pfr_ros.core.linalg import solve_in_place

system = np.array([[2.0, 3.0]])
solve_in_place(system, 1)
print(p4pfr_ros.__file__, system[0, 1], flush=True)
main(['--version'])
"""


@pytest.fixture(scope='module')
def site_packages(tmp_path_factory):
    """Copy the package to a folder that nobody can write to."""
    folder = tmp_path_factory.mktemp('site-packages')
    ignored = shutil.ignore_patterns('__pycache__')
    shutil.copytree(Path(p4pfr_ros.__file__).parent, folder / 'p4pfr_ros', ignore=ignored)
    make_read_only(folder)
    yield folder
    for path in [folder, *folder.rglob('*')]:
        path.chmod(0o755)


def make_read_only(folder):
    for path in [*folder.rglob('*'), folder]:
        path.chmod(0o555 if path.is_dir() else 0o444)
    return folder


def environment(**changes):
    """Return this process's environment with changes; None removes a variable."""
    unset = ('NUMBA_CACHE_DIR', 'XDG_CACHE_HOME', 'ROS_HOME', 'ROS_LOG_DIR')
    merged = os.environ | dict.fromkeys(unset) | changes
    return {name: str(value) for name, value in merged.items() if value is not None}


def run(site_packages, **changes):
    """Run the script in an environment; return its output and its errors."""
    done = subprocess.run(
        [*AS_UNKNOWN_USER, sys.executable, '-c', SCRIPT],
        env=environment(PYTHONPATH=site_packages, **changes),
        cwd='/',
        capture_output=True,
        text=True,
    )
    return done.stdout, done.stderr


def test_kernels_are_stored_among_temporary_files(site_packages, tmp_path):
    """Without HOME, or if it is read-only: one warning; the second process need not compile."""
    home, temporary = tmp_path / 'home', tmp_path / 'tmp'
    home.mkdir()
    make_read_only(home)
    temporary.mkdir()
    result = f'{site_packages}/p4pfr_ros/__init__.py 1.5\np4pfr_ros {p4pfr_ros.__version__}\n'
    place = f'they are in {temporary}/p4pfr_ros-{USER}. Set NUMBA_CACHE_DIR to a writable folder'
    output, errors = run(site_packages, HOME=None, TMPDIR=temporary)
    assert output == result, errors
    warning, compiling = errors.splitlines()
    assert warning.startswith(f'p4pfr_ros: no home directory for compiled kernels: {place}')
    assert compiling.startswith('p4pfr_ros: compiling')
    output, errors = run(site_packages, HOME=home, TMPDIR=temporary)
    assert output == result, errors
    [warning] = errors.splitlines()
    cannot = f'cannot store compiled kernels in {home}/.cache/p4pfr_ros (Permission denied)'
    assert warning.startswith(f'p4pfr_ros: {cannot}: {place}')


@pytest.mark.dds
@pytest.mark.parametrize('home', [None, 'read-only'])
def test_a_node_starts_without_log_files(tmp_path, home):
    """One warning; ROS itself would not start."""
    if home is not None:
        (tmp_path / home).mkdir()
        home = make_read_only(tmp_path / home)
    # The kernels need not be compiled again.
    kernels = os.environ.get('NUMBA_CACHE_DIR') or Path.home() / '.cache'
    node = subprocess.Popen(
        [*AS_UNKNOWN_USER, sys.executable, '-m', 'p4pfr_ros.ros.pose_node'],
        env=environment(HOME=home, NUMBA_CACHE_DIR=kernels),
        stderr=subprocess.PIPE,
        text=True,
    )
    try:
        lines = [node.stderr.readline()]
        while 'ready' not in lines[-1]:
            lines.append(node.stderr.readline())
            assert lines[-1], lines
        node.send_signal(signal.SIGINT)
        assert node.wait(30) == 0
    finally:
        node.kill()
        node.wait()
    reason = 'no home directory' if home is None else f'{home}/.ros/log: Permission denied'
    assert lines[0] == f'no log files: {reason}. Set ROS_LOG_DIR to a writable folder.\n'
    assert not [line for line in lines[1:] if 'log files' in line or 'rror' in line]
