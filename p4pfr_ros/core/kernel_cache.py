# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""
Where compiled kernels are stored, and what happens if they cannot be.

This module stands alone: ``jit`` compiles; this module looks after folders and files.
"""

from __future__ import annotations

from contextlib import suppress
import functools
import os
from pathlib import Path
import pickle
import stat
import sys
import tempfile
from typing import Any, TYPE_CHECKING

if TYPE_CHECKING:
    FunctionCache = Any
else:
    try:
        from numba.core.caching import FunctionCache
    except ImportError:
        FunctionCache = object

_ADVICE = 'Set NUMBA_CACHE_DIR to a writable folder that lasts.'


class KernelCache(FunctionCache):  # type: ignore[misc]
    """
    Numba's cache of one function, for disks that are full and files that are damaged.

    Numba raises an error in both cases, out of the first call of the kernel. Here a kernel that
    cannot be stored is used without, and one that cannot be read is compiled again.
    """

    def load_overload(self, sig: Any, target_context: Any) -> Any:
        """Return the stored kernel, or None."""
        try:
            return super().load_overload(sig, target_context)
        except (OSError, EOFError, pickle.UnpicklingError):
            with suppress(OSError):
                self.flush()
            return None

    def save_overload(self, sig: Any, data: Any) -> None:
        """Store a kernel, or warn once."""
        try:
            super().save_overload(sig, data)
        except OSError as error:
            _warn(f'cannot store compiled kernels in {kernel_folder()} ({error.strerror})')


@functools.cache
def kernel_folder() -> Path | None:
    """
    Create and return a writable folder for kernels; None if there is no place for one.

    It is ``p4pfr_ros`` in NUMBA_CACHE_DIR, in XDG_CACHE_HOME or in ``~/.cache``. If that is not
    writable, it is in the folder for temporary files, and a warning says so.
    """
    root = _root()
    problem = 'no home directory for compiled kernels'
    if root is not None:
        error = _create(root)
        if error is None:
            return root
        problem = f'cannot store compiled kernels in {root} ({error.strerror})'
    temporary = _temporary_root()
    if temporary is not None and _create(temporary) is None:
        _warn(f'{problem}: they are in {temporary}')
        return temporary
    _warn(f'{problem}: they are compiled at each start')
    return None


def _root() -> Path | None:
    """Return the folder for kernels that the user's environment determines."""
    base = os.environ.get('NUMBA_CACHE_DIR') or os.environ.get('XDG_CACHE_HOME')
    if base:
        return Path(base) / 'p4pfr_ros'
    try:
        return Path.home() / '.cache/p4pfr_ros'
    except RuntimeError:  # HOME is not set, and the user ID is in no database
        return None


def _temporary_root() -> Path | None:
    """
    Return a temporary folder that belongs to this user and that no other can write to.

    Kernels are code, and anyone may have made a folder with this name.
    """
    user = os.getuid() if hasattr(os, 'getuid') else 0
    try:
        folder = Path(tempfile.gettempdir(), f'p4pfr_ros-{user}')
        folder.mkdir(mode=0o700, exist_ok=True)
        found = folder.lstat()
    except OSError:
        return None
    is_ours = stat.S_ISDIR(found.st_mode) and found.st_uid == user
    return folder if is_ours and not found.st_mode & 0o077 else None


def _create(folder: Path) -> OSError | None:
    """Create a folder; return why it is not writable, or None."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=folder):
            return None
    except OSError as error:
        return error


@functools.cache
def _warn(problem: str) -> None:
    """Print a warning, each once."""
    print(f'p4pfr_ros: {problem}. {_ADVICE}', file=sys.stderr, flush=True)
