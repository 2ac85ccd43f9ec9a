# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""
``jit``, ``kernel``, ``reducing_kernel``: compile with Numba if it is installed, else interpret.

A kernel is plain Python over scalars and preallocated arrays, so both ways give the same numbers;
interpreted, it is some hundred times slower. ``NUMBA_DISABLE_JIT=1`` selects the interpreter.
"""

from __future__ import annotations

from collections.abc import Callable
import functools
import hashlib
import os
from pathlib import Path
import sys
from typing import Any, cast, TypeVar
import warnings

import numpy as np

try:
    import numba
    import numba.core.event
except ImportError:
    numba = None

Function = TypeVar('Function', bound=Callable[..., Any])

COMPILED = numba is not None and not numba.config.DISABLE_JIT

# Division by zero gives inf or NaN, as in C, and the kernels check their results: raising would
# cost a branch per division. No fast maths: interpreted and compiled code give the same bits.
_OPTIONS = {'error_model': 'numpy', 'nogil': True}


def jit(function: Function) -> Function:
    """Compile a function on its first call, and cache the result on disk."""
    return _compiled(function, **_OPTIONS)


def kernel(function: Function) -> Function:
    """
    Compile as ``jit`` does a function that allocates nothing; an allocation is an error.

    Compiled without Numba's reference counting, which costs a fifth of the minimal solver's time.
    """
    return _compiled(function, **_OPTIONS, _nrt=False)


def reducing_kernel(function: Function) -> Function:
    """
    Compile as ``kernel`` does a function whose sums may be reordered, so that they vectorise.

    The exception to equal bits: the order of a sum, and so its rounding, depends on the machine.
    """
    return _compiled(function, **_OPTIONS, _nrt=False, fastmath={'reassoc', 'contract', 'nsz'})


def inlined(function: Function) -> Function:
    """
    Compile as ``kernel`` does a function that LLVM always inlines.

    LLVM vectorises a loop only if nothing is called in it. Other than a ``part_of_kernel``, the
    function is typed once, whatever the number of calls.
    """
    return _compiled(function, **_OPTIONS, _nrt=False, forceinline=True)


def part_of_kernel(function: Function) -> Function:
    """
    Mark a function that one kernel calls, in one place: it is compiled there alone.

    A function of its own is compiled once more with each of its callers, and their callers.
    """
    return _compiled(function, **_OPTIONS, _nrt=False, inline='always')


def _compiled(function: Function, **options: Any) -> Function:
    if not COMPILED:
        return _interpreted(function)
    # Numba checks only the file that a kernel is defined in, and would use a stale copy after a
    # change of a kernel that it calls in another file. So the name of the cache folder contains a
    # hash of all sources that a kernel may call. Numba reads it at decoration only.
    previous = numba.config.CACHE_DIR
    numba.config.CACHE_DIR = str(_cache_folder(_room(Path(function.__code__.co_filename))))
    try:
        compiled: Function = numba.njit(cache=True, **options)(function)
    finally:
        numba.config.CACHE_DIR = previous
    return compiled


def _interpreted(function: Function) -> Function:
    @functools.wraps(function)
    def quiet(*arguments: Any) -> Any:
        # Compiled code makes NaN and infinity without a warning, and the kernels check for them.
        with np.errstate(all='ignore'):
            return function(*arguments)

    return cast(Function, quiet)


def sources_digest(folder: Path) -> str:
    """Return a short hash of all Python sources below a folder, their places included."""
    digest = hashlib.sha256()
    for source in sorted(folder.rglob('*.py')):
        digest.update(str(source.relative_to(folder)).encode())
        digest.update(source.read_bytes())
    return digest.hexdigest()[:16]


def _room(source: Path) -> Path:
    """Return the folder of the package that a source belongs to, such as ``detection``."""
    core = Path(__file__).parent
    for folder in source.parents:
        if folder.parent == core.parent:
            return folder
    return core


@functools.cache
def _cache_folder(room: Path) -> Path:
    """Return the folder for the kernels of a room, which may call those of core and their own."""
    base = os.environ.get('NUMBA_CACHE_DIR') or os.environ.get('XDG_CACHE_HOME')
    root = Path(base) if base else Path.home() / '.cache'
    core = Path(__file__).parent
    digests = [sources_digest(folder) for folder in dict.fromkeys((core, room))]
    return root / 'p4pfr_ros' / '-'.join(digests)


if numba is None:
    warnings.warn(
        'numba is not installed: p4pfr_ros runs interpreted, some hundred times slower',
        RuntimeWarning,
        stacklevel=2,
    )
elif COMPILED:

    class _FirstCompilation(numba.core.event.Listener):  # type: ignore[misc]
        """Prints once why the first call takes seconds."""

        printed = False

        def on_start(self, event: Any) -> None:
            name = event.data['dispatcher'].py_func.__module__
            if not self.printed and name.startswith('p4pfr_ros.'):
                self.printed = True
                print(
                    'p4pfr_ros: compiling the numeric kernels for this machine, once; '
                    'some tens of seconds',
                    file=sys.stderr,
                    flush=True,
                )

        def on_end(self, event: Any) -> None:
            pass

    numba.core.event.register('numba:compile', _FirstCompilation())
