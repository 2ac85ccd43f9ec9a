# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""The command of docs/release.md makes a release, tried on a copy of the files that it changes."""

from datetime import date
from pathlib import Path
import re
import shutil
import subprocess
import sys

from catkin_pkg.changelog import get_changelog_from_path
from catkin_pkg.package import parse_package
import pytest

ROOT = Path(__file__).parent.parent
CHANGED = ('CHANGELOG.rst', 'package.xml', 'setup.py')
VERSION = '77.0.0'


def git(folder, *arguments):
    identity = ['-c', 'user.name=test', '-c', 'user.email=test@example.org']
    command = ['git', '-C', folder, *identity, *arguments]
    return subprocess.run(command, check=True, capture_output=True, text=True).stdout


@pytest.fixture(scope='module')
def released(tmp_path_factory):
    """Return a repository after the release."""
    folder = tmp_path_factory.mktemp('release')
    for name in (*CHANGED, 'LICENSE'):
        shutil.copy(ROOT / name, folder)
    git(folder, 'init', '--quiet')
    for key, value in {'name': 'test', 'email': 'test@example.org'}.items():
        git(folder, 'config', f'user.{key}', value)
    git(folder, 'add', '.')
    git(folder, 'commit', '--quiet', '--message', 'before')
    text = (ROOT / 'docs/release.md').read_text()
    [command] = re.findall(r'\.venv/bin/(catkin_prepare_release .*?) +#', text)
    command = command.replace('--bump minor', f'--version {VERSION}').split()
    executable = Path(sys.executable).with_name(command[0])
    subprocess.run([executable, *command[1:]], cwd=folder, check=True, capture_output=True)
    return folder


def test_the_version_is_new_everywhere(released):
    assert parse_package(str(released)).version == VERSION
    assert f"version='{VERSION}'," in (released / 'setup.py').read_text()


def test_no_other_file_of_the_package_contains_the_version():
    """Otherwise the release would leave an old one."""
    version = parse_package(str(ROOT)).version
    sources = [p for p in ROOT.glob('*.*') if p.is_file() and p.name not in CHANGED]
    sources += [*(ROOT / 'p4pfr_ros').rglob('*.py'), *(ROOT / 'config').rglob('*.yaml')]
    assert not [path for path in sources if f"'{version}'" in path.read_text(errors='replace')]


@pytest.mark.filterwarnings('ignore::DeprecationWarning')  # from docutils, which catkin_pkg uses
def test_the_forthcoming_changes_become_those_of_the_version(released):
    """All of them, with the date."""
    before, after = (
        get_changelog_from_path(str(folder / 'CHANGELOG.rst'), 'p4pfr_ros')
        for folder in (ROOT, released)
    )
    [forthcoming] = re.findall(r'^Forthcoming\n-+\n(.*?)^\S+ \(', before.rst, re.M | re.S)
    [bullets] = after.get_content_of_version(VERSION)
    assert len(bullets.bullets) == len(re.findall(r'^\* ', forthcoming, re.M)) > 0
    assert after.get_date_of_version(VERSION).date() == date.today()


def test_the_release_is_committed_and_tagged(released):
    assert git(released, 'describe', '--tags', '--exact-match').strip() == VERSION
    assert git(released, 'status', '--porcelain') == ''
    assert set(git(released, 'show', '--name-only', '--format=').split()) == set(CHANGED)
