# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""
Where compiled kernels are stored, and what happens if they cannot be.

Kernels are looked up beside the installed package first, where an installation may have left
them, then in the user's cache. They are valid for the sources that they were compiled from, which
is told by a hash in their names: copied files have other times. Numba compiles again for another
processor, and for another version of itself.

This module stands alone: ``jit`` compiles; this module looks after folders and files.
"""

from __future__ import annotations

import ast
from collections.abc import Callable, Iterator
from contextlib import suppress
import functools
import hashlib
import os
from pathlib import Path
import pickle
import stat
import sys
import tempfile
from typing import Any, TYPE_CHECKING

if TYPE_CHECKING:
    _CacheLocator = Any
    CompileResultCacheImpl = Any
    FunctionCache = Any
    IndexDataCacheFile: Any
else:
    try:
        from numba.core.caching import (
            _CacheLocator,
            CompileResultCacheImpl,
            FunctionCache,
            IndexDataCacheFile,
        )
    except ImportError:
        _CacheLocator = CompileResultCacheImpl = FunctionCache = object

_PACKAGE = Path(__file__).parents[1]
_NAME = 'p4pfr_ros'
# Left by an installation; it may be read-only.
INSTALLED_FOLDER = _PACKAGE / '_kernels' / _NAME

# Lines that begin a definition: the imports of a module are above the first.
_DEFINITIONS = ('@', 'def ', 'class ')

_ADVICE = 'Set NUMBA_CACHE_DIR to a writable folder that lasts.'


class _Locator(_CacheLocator):  # type: ignore[misc]
    """Tells Numba the names of a kernel's files, which contain the hash of its sources."""

    def __init__(self, source: Path) -> None:
        is_ours = _PACKAGE in source.parents
        module = source.relative_to(_PACKAGE) if is_ours else Path(source.name)
        self._name = f'{".".join(module.with_suffix("").parts)}-{sources_digest(source)}'

    def get_cache_path(self) -> str:
        return ''  # see KernelCache

    def get_source_stamp(self) -> str:
        return self._name

    def get_disambiguator(self) -> str:
        return self._name

    @classmethod
    def from_function(cls, _: Any, file: str) -> _Locator:
        return cls(Path(file))


class _Files(CompileResultCacheImpl):  # type: ignore[misc]
    _locator_classes = (_Locator,)


class KernelCache(FunctionCache):  # type: ignore[misc]
    """
    Numba's cache of one function, in two folders, for disks that are full and damaged files.

    Numba raises an error in both cases, out of the first call of the kernel. Here a kernel that
    cannot be stored is used without, and one that cannot be read is compiled again.
    """

    _impl_class = _Files

    def __init__(self, function: Callable[..., Any]) -> None:
        super().__init__(function)
        self._installed = self._file_in(INSTALLED_FOLDER)
        folder = kernel_folder()
        self._users = None if folder is None else self._file_in(folder)

    def _file_in(self, folder: Path) -> Any:
        stamp = self._impl.locator.get_source_stamp()
        return IndexDataCacheFile(str(folder), self._impl.filename_base, stamp)

    def load_overload(self, sig: Any, target_context: Any) -> Any:
        """Return the stored kernel, or None."""
        target_context.refresh()
        key = self._index_key(sig, target_context.codegen())
        for file in filter(None, (self._installed, self._users)):
            try:
                stored = file.load(key)
                if stored is not None:
                    return self._impl.rebuild(target_context, stored)
            except (OSError, EOFError, pickle.UnpicklingError):
                with suppress(OSError):
                    file.flush()
        return None

    def save_overload(self, sig: Any, data: Any) -> None:
        """Store a kernel, or warn once."""
        if self._users is None or not self._impl.check_cachable(data):
            return
        try:
            self._users.save(self._index_key(sig, data.codegen), self._impl.reduce(data))
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
        return Path(base) / _NAME
    try:
        return Path.home() / '.cache' / _NAME
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


@functools.cache
def sources_digest(source: Path, package: Path = _PACKAGE) -> str:
    """Return a short hash of a source and of all sources of the package that it may call."""
    is_ours = package in source.parents
    # A source elsewhere, such as a test's, may call everything.
    found = {source} if is_ours else {source, *package.rglob('*.py')}
    open_ends = [source] if is_ours else []
    while open_ends:
        imported = _imports_of(open_ends.pop(), package) - found
        found |= imported
        open_ends += imported
    digest = hashlib.sha256()
    for each in sorted(found):
        name = each.relative_to(package) if package in each.parents else each.name
        digest.update(f'{name}\n{_file_digest(each)}\n'.encode())
    return digest.hexdigest()[:16]


@functools.cache
def _file_digest(source: Path) -> str:
    return hashlib.sha256(source.read_bytes()).hexdigest()


@functools.cache
def _imports_of(source: Path, package: Path) -> frozenset[Path]:
    """Return the files of the package that a source imports at its top."""
    lines = source.read_text(encoding='utf-8').splitlines()
    first = next((i for i, line in enumerate(lines) if line.startswith(_DEFINITIONS)), len(lines))
    found = {
        file
        for node in ast.parse('\n'.join(lines[:first])).body
        if isinstance(node, ast.ImportFrom)
        for module in _modules_of(node, source, package)
        for file in (module.with_suffix('.py'), module / '__init__.py')
        if file.is_file()
    }
    return frozenset(file for file in found if package in file.parents)


def _modules_of(node: ast.ImportFrom, source: Path, package: Path) -> Iterator[Path]:
    """Yield the places, without suffix, of what may be a module in an import."""
    folder = source.parents[node.level - 1] if node.level else package.parent
    module = folder.joinpath(*(node.module or '').split('.'))
    if node.module:
        yield module
    for alias in node.names:
        yield module / alias.name
