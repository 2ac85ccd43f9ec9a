# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""
Compiles all kernels in several processes, and stores them in one folder.

Each process compiles the kernels of some modules. It interprets the others, whose results it needs
as input. A file in the folder says that all kernels are there.
"""

from __future__ import annotations

import atexit
from collections.abc import Callable, Iterator
import functools
import gc
import hashlib
import os
from pathlib import Path
import queue
import shutil
import subprocess
import sys
import threading
import time
from typing import Any

from p4pfr_ros.core import jit
from p4pfr_ros.core.kernel_cache import INSTALLED_FOLDER, kernel_folder, sources_digest

from .warm_up import PARTS

_PACKAGE = Path(__file__).parents[1]

# Number of functions that are compiled, roughly: only for the progress.
_FUNCTIONS = 260

_START = (
    'import sys; from p4pfr_ros.kernels.processes import compile_part; compile_part(sys.argv[1])'
)
_COMPILED = 'compiled\n'

_TEXT = 'p4pfr_ros: compiling the numeric kernels for this machine'


def are_compiled() -> bool:
    """Return whether all kernels are stored, beside the package or in the user's cache."""
    return not jit.COMPILED or _complete_folder() is not None


def compile_all(report: Callable[[float], object], cache: Path | None = None) -> Path | None:
    """
    Compile all kernels, in one process for each core, and return the folder that has them.

    Parameters
    ----------
    report
        Called with the share that is done, whenever it grows.
    cache
        The folder that takes the place of NUMBA_CACHE_DIR; None: the user's cache.

    Raises
    ------
    RuntimeError
        A process failed; the message has the end of its output.

    """
    cache = None if cache is None else cache.absolute()
    folder = kernel_folder() if cache is None else cache / INSTALLED_FOLDER.name
    if folder is None or not jit.COMPILED:
        return None
    if (folder / _complete_name()).is_file():
        return folder
    folder.mkdir(parents=True, exist_ok=True)
    is_stored = are_compiled()
    # The folder must have all by itself: another installation may use it without ours.
    for other in filter(None, (INSTALLED_FOLDER, kernel_folder())):
        for file in filter(_is_current, other.glob('*.nb*')):
            if not (folder / file.name).exists():
                shutil.copy(file, folder)
    if not is_stored:
        for count, _ in enumerate(_compiled_functions(cache), start=1):
            report(min(count / _FUNCTIONS, 0.99))
    if folder == INSTALLED_FOLDER:  # of these sources alone; others may share a user's cache
        for file in folder.iterdir():
            if not _is_current(file):
                file.unlink()
    (folder / _complete_name()).touch()
    report(1.0)
    return folder


def compile_with_progress(cache: Path | None = None) -> Path | None:
    """
    Compile as `compile_all` does; print the progress on a terminal, else when it begins and ends.

    Raises
    ------
    RuntimeError
        A process failed; the message has the end of its output.

    """
    began_s = time.monotonic()
    end = '\r' if sys.stderr.isatty() else '\n'
    shown: set[int] = set()

    def report(share: float) -> None:
        percent = int(100.0 * share)
        if percent not in shown and (end == '\r' or not shown):
            print(f'{_TEXT}, {percent:2d} %', end=end, file=sys.stderr, flush=True)
        shown.add(percent)

    folder = compile_all(report, cache)
    if shown:
        print(f'{_TEXT}: {time.monotonic() - began_s:.0f} s', file=sys.stderr)
    return folder


def compile_part(name: str) -> None:
    """Compile one part of the kernels in this process; print a line for each function."""
    import numba.core.event

    class Counter(numba.core.event.Listener):  # type: ignore[misc]
        """Prints a line for each function."""

        def on_start(self, _: Any) -> None:
            pass

        def on_end(self, _: Any) -> None:
            sys.stdout.write(_COMPILED)
            sys.stdout.flush()

    numba.core.event.register('numba:compile', Counter())
    # The compiler makes many objects and drops few.
    gc.disable()
    modules, warm_up = PARTS[name]
    jit.compile_only(modules)
    warm_up()


def _complete_folder() -> Path | None:
    """Return a folder with all kernels of these sources, for this processor and this Numba."""
    for folder in (INSTALLED_FOLDER, kernel_folder()):
        if folder is not None and (folder / _complete_name()).is_file():
            return folder
    return None


@functools.cache
def _complete_name() -> str:
    """Return the name of the file that says that all kernels are there."""
    import numba
    from numba.core.registry import cpu_target

    machine = cpu_target.target_context.codegen().magic_tuple()
    version = numba.__version__, sys.version_info[:2], machine, sorted(_digests())
    return f'complete-{hashlib.sha256(repr(version).encode()).hexdigest()[:16]}'


@functools.cache
def _digests() -> frozenset[str]:
    """Return the hashes in the names of all kernels."""
    folders = (_PACKAGE / room for room in ('core', 'detection', 'rendering'))
    return frozenset(sources_digest(file) for folder in folders for file in folder.rglob('*.py'))


def _is_current(file: Path) -> bool:
    """Return whether a file has a kernel of these sources."""
    return any(digest in file.name for digest in _digests())


def _compiled_functions(cache: Path | None) -> Iterator[str]:
    """Compile all parts in processes; yield for each function that is compiled."""
    waiting: queue.SimpleQueue[str] = queue.SimpleQueue()
    for name in PARTS:
        waiting.put(name)
    lines: queue.SimpleQueue[str | Exception | None] = queue.SimpleQueue()
    workers = min(len(PARTS), len(os.sched_getaffinity(0)))
    for _ in range(workers):
        threading.Thread(target=_work, args=(waiting, lines, cache), daemon=True).start()
    while workers:
        line = lines.get()
        if isinstance(line, Exception):
            raise line
        if line is None:
            workers -= 1
        else:
            yield line


def _work(
    waiting: queue.SimpleQueue[str],
    lines: queue.SimpleQueue[str | Exception | None],
    cache: Path | None,
) -> None:
    """Compile one part after the other, until none waits; then put None."""
    try:
        while True:
            try:
                name = waiting.get_nowait()
            except queue.Empty:
                break
            for line in _lines_of(name, cache):
                lines.put(line)
    except Exception as error:
        lines.put(error)
    else:
        lines.put(None)


def _lines_of(name: str, cache: Path | None) -> Iterator[str]:
    """Compile a part in a process; yield its lines of progress."""
    environment = os.environ | ({} if cache is None else {'NUMBA_CACHE_DIR': str(cache)})
    path = os.pathsep.join([str(_PACKAGE.parent), *filter(None, [os.environ.get('PYTHONPATH')])])
    others = []
    with subprocess.Popen(
        [sys.executable, '-c', _START, name],
        env=environment | {'PYTHONPATH': path},
        stdin=subprocess.DEVNULL,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        errors='replace',
    ) as process:
        # If this process ends before; after a kill, the next line finds no reader and ends it.
        atexit.register(process.kill)
        assert process.stdout is not None
        for line in process.stdout:
            if line == _COMPILED:
                yield line
            else:
                others.append(line)
    atexit.unregister(process.kill)
    if process.returncode:
        text = ''.join(others[-20:])
        raise RuntimeError(f'compiling {name}: exit status {process.returncode}: {text}')
