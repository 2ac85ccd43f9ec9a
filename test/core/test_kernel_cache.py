# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""Compiled kernels on disk: which folder, and disks that are full or damaged."""

import os
from pathlib import Path
import stat
import subprocess
import sys
import tempfile

from p4pfr_ros.core import kernel_cache
from p4pfr_ros.core.jit import COMPILED
import pytest

VARIABLES = ('NUMBA_CACHE_DIR', 'XDG_CACHE_HOME', 'HOME')
ADVICE = 'Set NUMBA_CACHE_DIR to a writable folder that lasts.\n'


@pytest.fixture
def places(monkeypatch, tmp_path):
    """Set all variables that determine the folder to folders in this one; return it."""
    for name in VARIABLES:
        monkeypatch.setenv(name, str(tmp_path / name))
    (tmp_path / 'tmp').mkdir()
    monkeypatch.setattr(tempfile, 'tempdir', str(tmp_path / 'tmp'))
    kernel_cache._warn.cache_clear()
    return tmp_path


def folder():
    return kernel_cache.kernel_folder.__wrapped__()


def test_the_first_variable_that_is_set_determines_the_folder(places, monkeypatch, capsys):
    for name, below in zip(VARIABLES, ('', '', '.cache'), strict=True):
        assert folder() == places / name / below / 'p4pfr_ros'
        assert folder().is_dir()
        monkeypatch.setenv(name, '')
    assert capsys.readouterr().err == ''


@pytest.fixture
def taken(places):
    """Return the place for kernels, which is a file."""
    (places / 'NUMBA_CACHE_DIR').touch()
    return places / 'NUMBA_CACHE_DIR/p4pfr_ros'


def test_a_temporary_folder_is_private(taken, places, capsys):
    """It is used with one warning, however often it is asked for."""
    temporary = places / f'tmp/p4pfr_ros-{os.getuid()}'
    assert folder() == folder() == temporary
    assert stat.S_IMODE(temporary.stat().st_mode) == 0o700
    problem = f'cannot store compiled kernels in {taken} (Not a directory)'
    assert capsys.readouterr().err == f'p4pfr_ros: {problem}: they are in {temporary}. {ADVICE}'


@pytest.mark.parametrize('kind', ['open', 'link', 'file'])
def test_a_temporary_folder_that_another_may_have_made_is_not_used(taken, places, capsys, kind):
    """Kernels are code: others must not be able to write to it."""
    temporary = places / f'tmp/p4pfr_ros-{os.getuid()}'
    if kind == 'open':
        temporary.mkdir()
        temporary.chmod(0o770)
    elif kind == 'link':
        (places / 'private').mkdir(mode=0o700)
        temporary.symlink_to(places / 'private')
    else:
        temporary.touch()
    assert folder() is None
    assert 'they are compiled at each start' in capsys.readouterr().err


# Loads the stored kernel of a function, or compiles and stores it, in a process of its own.
SCRIPT = """
import resource, sys
import numpy as np
from p4pfr_ros.core.linalg import solve_in_place
system = np.array([[2.0, 3.0]])
resource.setrlimit(resource.RLIMIT_FSIZE, (int(sys.argv[1]), -1))
solve_in_place(system, 1)
print(system[0, 1], sum(solve_in_place.stats.cache_hits.values()))
"""


def solved(folder, max_bytes=10**9):
    """Return the result of a kernel, whether it was stored before, and the errors."""
    done = subprocess.run(
        [sys.executable, '-c', SCRIPT, str(max_bytes)],
        env=os.environ | {'NUMBA_CACHE_DIR': str(folder)},
        capture_output=True,
        text=True,
    )
    return done.stdout.split(), done.stderr


@pytest.mark.skipif(not COMPILED, reason='interpreted kernels are not stored')
def test_a_damaged_or_full_disk_costs_a_compilation(tmp_path):
    """An index cut by a power failure; then no byte can be written."""
    assert solved(tmp_path)[0] == ['1.5', '0']
    assert solved(tmp_path) == (['1.5', '1'], '')
    [index] = tmp_path.rglob('*.nbi')
    index.write_bytes(b'')
    assert solved(tmp_path)[0] == ['1.5', '0']
    assert solved(tmp_path) == (['1.5', '1'], '')
    index.unlink()
    result, errors = solved(tmp_path, max_bytes=0)
    assert result == ['1.5', '0']
    problem = f'cannot store compiled kernels in {tmp_path / "p4pfr_ros"} (File too large)'
    assert errors.splitlines()[-1] == f'p4pfr_ros: {problem}. {ADVICE}'.strip()
    assert not list(Path(tmp_path).rglob('*.tmp.*'))
