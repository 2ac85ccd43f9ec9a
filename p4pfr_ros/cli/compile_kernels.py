# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""``p4pfr compile``: compile all kernels now, for image builds and installations."""

from __future__ import annotations

import argparse
import os
from pathlib import Path

from p4pfr_ros.files.yaml_fields import ConfigError


def add_parser(commands: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    """Add the command to the parser."""
    text = 'compile the numeric kernels now, so that no program waits for it later'
    parser = commands.add_parser(
        'compile',
        help=text,
        description=f'{text[0].upper()}{text[1:]}. The kernels are stored beside the installed '
        'package if its folder is writable, where all users find them; otherwise in the cache of '
        'this user. Another processor, another version of Numba or changed sources need other '
        'kernels, which are compiled when they are needed.',
    )
    parser.add_argument(
        '--cache',
        metavar='DIR',
        type=Path,
        help='store the kernels here; programs find them if NUMBA_CACHE_DIR is DIR',
    )
    parser.set_defaults(run=run)


def run(options: argparse.Namespace) -> int:
    """Compile, and print where the kernels are."""
    from p4pfr_ros.core.kernel_cache import INSTALLED_FOLDER
    from p4pfr_ros.kernels.processes import compile_with_progress

    beside = INSTALLED_FOLDER.parent
    cache = options.cache
    if cache is None and os.access(beside if beside.exists() else beside.parent, os.W_OK):
        cache = beside
    try:
        folder = compile_with_progress(cache)
    except (OSError, RuntimeError) as error:
        raise ConfigError(f'the kernels are not compiled: {error}') from None
    if folder is None:
        raise ConfigError('no place for compiled kernels: name one with --cache')
    print(f'compiled kernels: {folder}')
    return 0
