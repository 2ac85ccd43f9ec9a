# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""Errors about missing packages name a command that works where this package is installed."""

import json
import os
from pathlib import Path
import subprocess
import sys

from p4pfr_ros.files.dependencies import EXTRAS, install_command
import pytest

ROOT = Path(__file__).parent.parent.parent
PRINT = """
from p4pfr_ros.files.dependencies import *
import sys
print(install_command(EXTRAS[sys.argv[1]]))
print(how_to_get_ros())
"""
PIP = f'{sys.executable} -m pip install'


def commands(tmp_path, module, *, files, prefix='p4pfr_ros-0.1.0.dist-info'):
    """Return the commands where the metadata of the package consist of these files."""
    folder = tmp_path / prefix
    folder.mkdir(parents=True)
    for name, text in {'METADATA': 'Name: p4pfr_ros\nVersion: 0.1.0\n', **files}.items():
        (folder / name).write_text(text)
    path = os.pathsep.join([str(tmp_path), str(ROOT)])
    env = {**os.environ, 'PYTHONPATH': path, 'PATH': '/usr/bin:/bin'}
    run = [sys.executable, '-c', PRINT, module]
    # Not in the sources, where builds leave metadata of their own.
    return subprocess.run(
        run, env=env, cwd=tmp_path, check=True, capture_output=True, text=True
    ).stdout.splitlines()


@pytest.mark.parametrize('options', ['-e ', ''])
def test_from_a_clone_by_pip(tmp_path, options):
    origin = {'url': f'file://{tmp_path}/a%20clone', 'dir_info': {'editable': bool(options)}}
    (tmp_path / 'a clone').mkdir()
    files = {'direct_url.json': json.dumps(origin)}
    extra, ros = commands(tmp_path, 'rich', files=files)
    assert extra == f"{PIP} {options}'{tmp_path}/a clone[cli]'"
    assert ros == f"source a ROS 2 installation, or {PIP} {options}'{tmp_path}/a clone[ros]'"


def test_from_a_clone_that_is_gone(tmp_path):
    files = {'direct_url.json': json.dumps({'url': 'file:///nowhere/at/all', 'dir_info': {}})}
    assert commands(tmp_path, 'rosbags', files=files)[0] == f"{PIP} 'rosbags>=0.11'"


def test_from_an_index(tmp_path):
    extra, _ = commands(tmp_path, 'matplotlib', files={'INSTALLER': 'pip\n'})
    assert extra == f"{PIP} 'p4pfr_ros[plot]'"


def test_from_a_repository(tmp_path):
    origin = {'url': 'https://host/p4pfr_ros.git', 'vcs_info': {'vcs': 'git', 'commit_id': '1'}}
    extra, _ = commands(tmp_path, 'rich', files={'direct_url.json': json.dumps(origin)})
    assert extra == f"{PIP} 'p4pfr_ros[cli] @ git+https://host/p4pfr_ros.git'"


def test_from_colcon_there_are_no_extras(tmp_path):
    """Colcon writes an egg-info without an installer; this environment is a virtual one."""
    files = {'PKG-INFO': 'Name: p4pfr_ros\nVersion: 0.1.0\n'}
    prefix = 'p4pfr_ros-0.1.0-py3.12.egg-info'
    extra, ros = commands(tmp_path, 'rich', files=files, prefix=prefix)
    assert extra == f'{PIP} rich'
    assert ros == 'source a ROS 2 installation'


def test_here_the_command_names_what_pip_installed():
    """An editable install by make venv, or one by colcon."""
    command = install_command(EXTRAS['rich'])
    assert command.endswith(("[cli]'", ' rich', ' python3-rich'))
