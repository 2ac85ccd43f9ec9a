# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""Files that are there whole, or not at all."""

from __future__ import annotations

import os
from pathlib import Path

from p4pfr_ros.files.boards import ConfigError


def write_atomically(path: str | os.PathLike[str], text: str) -> None:
    """
    Write a text file so that whoever looks finds the old one or the new one, whole.

    That holds when the process is killed at any moment, and, as far as the disk keeps its word,
    when the power fails. Folders that are missing are made; a link is followed.

    Raises
    ------
    ConfigError
        There is no such place to write to, or no room there. What stood there stays.

    """
    target = Path(os.path.realpath(path))
    # In the same folder, as a rename is atomic within a file system only. One name per process:
    # what a killed one has left is overwritten some day instead of piling up.
    beside = target.with_name(f'.{target.name}.{os.getpid()}.tmp')
    try:
        target.parent.mkdir(parents=True, exist_ok=True)
        try:
            _write_through(beside, text.encode())
            os.replace(beside, target)
        except OSError:
            beside.unlink(missing_ok=True)
            raise
        _sync_folder(target.parent)
    except FileExistsError:  # of a folder to make
        raise ConfigError(f'{path}: expected a place to write to: Not a directory') from None
    except OSError as error:
        raise ConfigError(f'{path}: expected a place to write to: {error.strerror}') from None


def _write_through(path: Path, data: bytes) -> None:
    """Write a file and wait until the disk has it: before that, a rename would be a promise."""
    with path.open('wb') as file:
        file.write(data)
        file.flush()
        os.fsync(file.fileno())


def _sync_folder(folder: Path) -> None:
    """Wait until the disk has the folder's new entry."""
    descriptor = os.open(folder, os.O_RDONLY)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)
