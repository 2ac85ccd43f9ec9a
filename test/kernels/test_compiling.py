# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""Kernels that an installation compiled are found, wherever the user's cache is."""

from pathlib import Path
import shutil
import subprocess
import sys

import p4pfr_ros
from p4pfr_ros.core import jit
from p4pfr_ros.kernels import processes
import pytest

pytestmark = pytest.mark.skipif(not jit.COMPILED, reason='nothing is compiled')

# Estimates a view, and prints how many functions were compiled.
SCRIPT = """
import numba.core.event
from p4pfr_ros.kernels import warm_up

with numba.core.event.install_recorder('numba:compile') as compiled:
    warm_up._estimate_realistic()
from p4pfr_ros.kernels.processes import are_compiled

print(len(compiled.buffer), are_compiled())
"""

SCRIPT_THAT_COMPILES = """
from p4pfr_ros.kernels.processes import compile_all

compile_all(lambda _: None)
"""


@pytest.fixture(scope='module', autouse=True)
def _stored_kernels():
    if not processes.are_compiled():
        processes.compile_all(lambda _: None)


@pytest.fixture
def site(tmp_path):
    """Copy the package, without kernels and with new times."""
    site = tmp_path / 'site'
    source = Path(p4pfr_ros.__file__).parent
    ignored = shutil.ignore_patterns('_kernels', '__pycache__')
    shutil.copytree(source, site / 'p4pfr_ros', ignore=ignored, copy_function=shutil.copyfile)
    return site


def run(site, monkeypatch, script=SCRIPT):
    """Run a script with a copy of the package and a cache of its own."""
    monkeypatch.setenv('PYTHONPATH', str(site))
    monkeypatch.setenv('NUMBA_CACHE_DIR', str(site.parent / 'cache'))
    done = subprocess.run(
        [sys.executable, '-c', script],
        cwd=site.parent,
        check=True,
        capture_output=True,
        text=True,
    )
    return done.stdout.split()


def test_a_copy_of_the_package_finds_its_kernels(site, monkeypatch):
    """Copied kernels are those of the copied sources: nothing is compiled."""
    reports = []
    folder = processes.compile_all(reports.append, site / 'p4pfr_ros/_kernels')
    assert reports[-1] == 1.0
    assert folder == site / 'p4pfr_ros/_kernels/p4pfr_ros'
    for path in (folder, folder.parent):
        path.chmod(0o555)
    assert run(site, monkeypatch) == ['0', 'True']
    assert not list((site.parent / 'cache').rglob('*.nbc'))


def test_kernels_of_other_sources_are_not_used(site, monkeypatch):
    """After a change of the detection, all kernels of the core are valid, but not complete."""
    processes.compile_all(lambda _: None, site / 'p4pfr_ros/_kernels')
    with (site / 'p4pfr_ros/detection/fitting.py').open('a') as source:
        source.write('# changed\n')
    assert run(site, monkeypatch) == ['0', 'False']


@pytest.mark.exhaustive
def test_the_users_cache_is_complete(site, monkeypatch):
    """Though an older installation had some of the kernels: it may be removed."""
    installed = processes.compile_all(lambda _: None, site / 'p4pfr_ros/_kernels')
    for file in (*installed.glob('complete-*'), *installed.glob('*-rendering.*')):
        file.unlink()
    run(site, monkeypatch, SCRIPT_THAT_COMPILES)
    shutil.rmtree(site / 'p4pfr_ros/_kernels')
    assert run(site, monkeypatch) == ['0', 'True']


def test_a_process_that_fails_is_reported(tmp_path):
    """The error has the end of its output."""
    with pytest.raises(RuntimeError, match=r'(?s)compiling nothing: exit status 1: .*KeyError'):
        list(processes._lines_of('nothing', tmp_path))


def test_the_command_says_where_the_kernels_are(tmp_path):
    """``p4pfr compile --cache DIR`` stores all kernels in DIR, for NUMBA_CACHE_DIR."""
    done = subprocess.run(
        [sys.executable, '-m', 'p4pfr_ros', 'compile', '--cache', tmp_path / 'new'],
        check=True,
        capture_output=True,
        text=True,
    )
    folder = tmp_path / 'new' / 'p4pfr_ros'
    assert done.stdout == f'compiled kernels: {folder}\n'
    assert list(folder.glob('*.nbc'))
