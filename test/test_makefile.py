# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""The Makefile in a path with spaces and letters beyond ASCII, and without a home directory."""

import os
from pathlib import Path
import shutil
import subprocess

import pytest

ROOT = Path(__file__).parent.parent
LINKED = ('config', 'launch', 'package.xml', 'resource', 'scripts')

pytestmark = pytest.mark.skipif(shutil.which('make') is None, reason='make is not installed')


@pytest.fixture
def checkout(tmp_path):
    """Copy what `make links` links to a folder with such a name."""
    folder = tmp_path / 'Söme folder'
    folder.mkdir()
    shutil.copy(ROOT / 'Makefile', folder)
    for name in LINKED:
        copy = shutil.copytree if (ROOT / name).is_dir() else shutil.copy
        copy(ROOT / name, folder / name)
    return folder


def make(folder, *arguments, **environment):
    command = ['make', '--no-print-directory', '-C', folder, *arguments]
    environment = os.environ | {'MAKEFLAGS': ''} | environment
    return subprocess.run(
        command, env=environment, check=True, capture_output=True, text=True
    ).stdout


def test_the_environment_is_an_ament_prefix(checkout):
    """All links lead to the files of this checkout, and a second time changes nothing."""
    for _ in range(2):
        make(checkout, 'links')
        links = [path for path in (checkout / '.venv').rglob('*') if path.is_symlink()]
        assert {path.resolve() for path in links} == {
            *(checkout / name for name in ('config', 'launch', 'package.xml')),
            checkout / 'resource/p4pfr_ros',
            *(checkout / 'scripts').iterdir(),
        }
        assert all(path.exists() for path in links)


@pytest.mark.parametrize('home', ['', '/none/such'])
def test_without_a_home_directory_the_environment_has_one(checkout, home):
    """ROS, Numba, matplotlib and pip write to it."""
    show = ['--eval', 'show:; @echo "$$HOME"', 'show']
    assert make(checkout, *show, HOME=home).strip() == str(checkout / '.venv/home')
    assert make(checkout, *show, HOME=str(checkout)).strip() == str(checkout)
