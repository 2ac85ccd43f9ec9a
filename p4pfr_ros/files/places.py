# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""Where files will be written: wrong places show before anybody waits for what goes there."""

from __future__ import annotations

from pathlib import Path

from p4pfr_ros.files.boards import ConfigError


def check_place(path: Path) -> None:
    """
    See that a file can be written there, before anybody waits for it.

    Raises
    ------
    ConfigError
        It cannot.

    """
    was_there = path.exists()
    try:
        with path.open('ab'):
            pass
    except OSError as error:
        raise ConfigError(f'{path}: expected a place to write to: {error.strerror}') from None
    if not was_there:
        path.unlink()
