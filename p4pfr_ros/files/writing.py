# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""Checks output paths early, and writes text files atomically."""

from __future__ import annotations

from contextlib import suppress
import fcntl
import os
from pathlib import Path
import stat
import tempfile
import time

from p4pfr_ros.files.printable import printable_path
from p4pfr_ros.files.yaml_fields import ConfigError
from p4pfr_ros.files.yaml_reading import kind_of_file, read_bytes, reason_of

# Age of an empty temporary file that no other process is about to lock.
_ABANDONED_S = 5.0
# A temporary file has more characters in its name than its target, and the limit is 255.
_MAX_NAME = 100


def check_writable(path: Path) -> None:
    """
    Check that a file can be written; call it before a long computation.

    Raises
    ------
    ConfigError
        The path is not writable, or not that of a regular file.

    """
    try:
        existed = _mode_of(path) is not None
        with path.open('ab'):
            pass
        if not existed:
            path.unlink()
    except (OSError, ValueError) as error:
        raise not_writable(path, error) from None


def not_writable(path: str | os.PathLike[str], error: OSError | ValueError) -> ConfigError:
    """Make the error for a path that cannot be written."""
    # mkdir reports that a parent of the path is a file as EEXIST.
    reason = 'Not a directory' if isinstance(error, FileExistsError) else reason_of(error)
    return ConfigError(f'{printable_path(path)}: expected a writable path: {reason}')


def write_atomically(path: str | os.PathLike[str], text: str) -> None:
    """
    Write a text file such that a reader sees either the old content or the new.

    This holds if the process is killed at any time and, as far as the disk honours fsync, on
    power loss. Missing folders are created; symbolic links are followed. Mode and owner of an
    existing file are kept, as far as the process may set them. What killed processes left beside
    the file is removed.

    Raises
    ------
    ConfigError
        The path is not writable or the disk is full, or it is that of a directory, a pipe or a
        device. The old file stays.

    """
    _write(path, text.encode())


def back_up(path: str | os.PathLike[str]) -> Path:
    """
    Copy a file to the same name with .bak appended, atomically; return the path of the copy.

    Raises
    ------
    ConfigError
        The file is not readable, not a regular file or too large, or the copy not writable.

    """
    original = Path(os.path.realpath(path))
    copy = original.with_name(f'{original.name}.bak')
    _write(copy, read_bytes(original), like=original)
    return copy


def _write(path: str | os.PathLike[str], data: bytes, like: Path | None = None) -> None:
    """Write a file atomically, with mode and owner of a file; None: of the one it replaces."""
    try:
        target = Path(os.path.realpath(path))
        target.parent.mkdir(parents=True, exist_ok=True)
        replaced = _mode_of(target)
        _sweep(target)
        # In the same folder, as renames are atomic within one file system only.
        prefix, suffix = _beside(target)
        descriptor, beside = tempfile.mkstemp(suffix, prefix, target.parent)
        try:
            with open(descriptor, 'wb') as file:
                with suppress(OSError):  # a file system without locks
                    fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
                _copy_access(descriptor, like or (target if replaced is not None else None))
                file.write(data)
                file.flush()
                # Without this, the rename could reach the disk first.
                os.fsync(descriptor)
                os.replace(beside, target)
        except BaseException:
            Path(beside).unlink(missing_ok=True)
            raise
        _sync_folder(target.parent)
    except (OSError, ValueError) as error:
        raise not_writable(path, error) from None


def _mode_of(path: Path) -> int | None:
    """Return the mode of a regular file, None if there is none; reject anything else."""
    try:
        mode = os.lstat(os.path.realpath(path)).st_mode
    except FileNotFoundError:
        return None
    if not stat.S_ISREG(mode):
        raise ConfigError(
            f'{printable_path(path)}: expected the path of a regular file, '
            f'got {kind_of_file(mode)}'
        )
    return mode


def _beside(target: Path) -> tuple[str, str]:
    """Return beginning and end of the names of a file's temporary files."""
    return f'.{target.name[:_MAX_NAME]}.', '.tmp'


def _sweep(target: Path) -> None:
    """Remove temporary files of the target that no process is writing."""
    prefix, suffix = _beside(target)
    with suppress(OSError), os.scandir(target.parent) as entries:
        for entry in entries:
            if entry.name.startswith(prefix) and entry.name.endswith(suffix):
                with suppress(OSError):
                    if entry.is_file(follow_symlinks=False) and _is_abandoned(entry.path):
                        os.unlink(entry.path)


def _is_abandoned(path: str) -> bool:
    """Return whether the process that wrote a temporary file has ended: it held a lock."""
    descriptor = os.open(path, os.O_RDONLY | os.O_NOFOLLOW | os.O_NONBLOCK | os.O_CLOEXEC)
    try:
        fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
        status = os.fstat(descriptor)
        # It is locked before anything is written.
        return status.st_size > 0 or time.time() - status.st_mtime > _ABANDONED_S
    finally:
        os.close(descriptor)


def _copy_access(descriptor: int, like: Path | None) -> None:
    """Give a file the mode and the owner of another, or those of a new file."""
    if like is None:
        umask = os.umask(0o077)
        os.umask(umask)
        os.fchmod(descriptor, 0o666 & ~umask)
        return
    status = os.stat(like)
    # Only root may give a file away, but a member of a group may give it to the group.
    for owner, group in ((-1, status.st_gid), (status.st_uid, -1)):
        with suppress(OSError):
            os.fchown(descriptor, owner, group)
    os.fchmod(descriptor, stat.S_IMODE(status.st_mode))


def _sync_folder(folder: Path) -> None:
    """Sync a folder's entries to disk."""
    descriptor = os.open(folder, os.O_RDONLY)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)
