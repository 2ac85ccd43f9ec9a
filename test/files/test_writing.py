# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""Files are replaced whole: mode and owner stay, leftovers of killed processes go."""

import fcntl
import os
import signal
import stat
import subprocess
import sys
import time

from p4pfr_ros.files.calibration import load_calibration, save_calibration
from p4pfr_ros.files.writing import back_up, check_writable, write_atomically
from p4pfr_ros.files.yaml_fields import ConfigError
import pytest
from test_calibration_files import CALIBRATION, ROS_FILE

is_root = os.geteuid() == 0


@pytest.fixture
def path(tmp_path):
    return tmp_path / 'camera.yaml'


@pytest.mark.parametrize('mode', [0o600, 0o640, 0o664])
def test_the_mode_of_a_file_is_kept(path, mode):
    path.write_text('old')
    path.chmod(mode)
    write_atomically(path, 'new')
    assert (path.read_text(), stat.S_IMODE(path.stat().st_mode)) == ('new', mode)


def test_a_new_file_has_the_mode_that_the_umask_allows(path):
    before = os.umask(0o027)
    try:
        write_atomically(path, 'new')
    finally:
        os.umask(before)
    assert stat.S_IMODE(path.stat().st_mode) == 0o640


@pytest.mark.skipif(not is_root, reason='only root may give a file away')
def test_the_owner_of_a_file_is_kept(path):
    path.write_text('old')
    os.chown(path, 1234, 5678)
    write_atomically(path, 'new')
    assert (path.stat().st_uid, path.stat().st_gid) == (1234, 5678)
    copy = back_up(path)
    assert (copy.stat().st_uid, copy.stat().st_gid) == (1234, 5678)


def test_a_link_in_place_of_a_temporary_file_is_not_followed(tmp_path, path):
    """Nor removed: it is not ours."""
    victim = tmp_path / 'victim'
    victim.write_text('precious')
    link = tmp_path / f'.camera.yaml.{os.getpid()}.tmp'
    link.symlink_to(victim)
    write_atomically(path, 'new')
    assert (victim.read_text(), link.is_symlink()) == ('precious', True)


def test_what_a_killed_process_left_is_swept(tmp_path, path):
    """Right away, though it may be killed between any two lines."""
    code = f"""
import os, signal
from p4pfr_ros.files import writing
writing.os.replace = lambda *_: os.kill(os.getpid(), signal.SIGKILL)
writing.write_atomically({str(path)!r}, 'new')
"""
    killed = subprocess.run([sys.executable, '-c', code])
    assert killed.returncode == -signal.SIGKILL
    [left] = tmp_path.iterdir()
    assert left.name.startswith('.camera.yaml.')
    write_atomically(path, 'newer')
    assert [entry.name for entry in tmp_path.iterdir()] == ['camera.yaml']


def test_temporary_files_in_use_are_not_swept(tmp_path, path):
    """One that a process has locked, and one that is about to be locked."""
    written, fresh, old = (tmp_path / f'.camera.yaml.{name}.tmp' for name in 'abc')
    for each in (fresh, old):
        each.touch()
    os.utime(old, (time.time() - 100.0,) * 2)
    with written.open('w') as file:
        file.write('half')
        file.flush()
        fcntl.flock(file, fcntl.LOCK_EX)
        write_atomically(path, 'new')
        assert {entry.name for entry in tmp_path.iterdir()} == {
            written.name,
            fresh.name,
            'camera.yaml',
        }


def test_the_file_of_another_program_is_kept(path):
    """Ours is not, nor an empty one."""
    path.touch()
    assert save_calibration(path, CALIBRATION) is None
    path.write_text(ROS_FILE)
    path.chmod(0o640)
    backup = save_calibration(path, CALIBRATION)
    assert backup == path.with_name('camera.yaml.bak')
    assert (backup.read_text(), stat.S_IMODE(backup.stat().st_mode)) == (ROS_FILE, 0o640)
    assert load_calibration(path).estimate is not None
    backup.unlink()
    assert save_calibration(path, CALIBRATION) is None
    assert [entry.name for entry in path.parent.iterdir()] == ['camera.yaml']


def test_a_file_that_cannot_be_kept_is_not_replaced(path):
    path.write_bytes(b'x' * 10_000_001)
    with pytest.raises(ConfigError, match='at most 10 MB'):
        save_calibration(path, CALIBRATION)
    assert path.stat().st_size == 10_000_001


def test_a_long_name_leaves_room_for_the_temporary_one(tmp_path):
    path = tmp_path / ('n' * 250)
    write_atomically(path, 'new')
    assert path.read_text() == 'new'


def test_a_check_does_not_block_or_leave_a_file(tmp_path, path):
    os.mkfifo(tmp_path / 'pipe')
    for wrong in (tmp_path / 'pipe', tmp_path, tmp_path / 'a\0b', tmp_path / 'no' / 'folder'):
        with pytest.raises(ConfigError):
            check_writable(wrong)
    check_writable(path)
    assert not path.exists()
