# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""Checks output paths early, and writes files atomically."""

from __future__ import annotations

import os
from pathlib import Path

from p4pfr_ros.files.yaml_fields import ConfigError


def check_writable(path: Path) -> None:
    """
    Check that a file can be written; call it before a long computation.

    Raises
    ------
    ConfigError
        The path is not writable.

    """
    existed = path.exists()
    try:
        with path.open('ab'):
            pass
    except OSError as error:
        raise not_writable(path, error) from None
    if not existed:
        path.unlink()


def not_writable(path: str | os.PathLike[str], error: OSError) -> ConfigError:
    """Make the error for a path that cannot be written."""
    # mkdir reports that a parent of the path is a file as EEXIST.
    reason = 'Not a directory' if isinstance(error, FileExistsError) else error.strerror
    return ConfigError(f'{path}: expected a writable path: {reason}')


def write_atomically(path: str | os.PathLike[str], text: str) -> None:
    """Write a text file like `write_bytes_atomically`."""
    write_bytes_atomically(path, text.encode())


def write_bytes_atomically(path: str | os.PathLike[str], data: bytes) -> None:
    """
    Write a file such that a reader sees either the old content or the new.

    This holds if the process is killed at any time and, as far as the disk honours fsync, on
    power loss. Missing folders are created; symbolic links are followed.

    Raises
    ------
    ConfigError
        The path is not writable or the disk is full. The old file stays.

    """
    target = Path(os.path.realpath(path))
    # In the same folder, as renames are atomic within one file system only. One name per process
    # ID, so that files left by killed processes are eventually overwritten.
    beside = target.with_name(f'.{target.name}.{os.getpid()}.tmp')
    try:
        target.parent.mkdir(parents=True, exist_ok=True)
        try:
            _write_through(beside, data)
            os.replace(beside, target)
        except OSError:
            beside.unlink(missing_ok=True)
            raise
        _sync_folder(target.parent)
    except OSError as error:
        raise not_writable(path, error) from None


def _write_through(path: Path, data: bytes) -> None:
    """Write a file and sync it to disk; without that, the rename could come first."""
    with path.open('wb') as file:
        file.write(data)
        file.flush()
        os.fsync(file.fileno())


def _sync_folder(folder: Path) -> None:
    """Sync a folder's entries to disk."""
    descriptor = os.open(folder, os.O_RDONLY)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)
