# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""
Processes images on several cores, in order.

Images are independent until their results are used, so the results do not depend on the number of
processes. Starting processes takes as long as some tens of images: the first images are processed
here, which also compiles the kernels once, and processes are started only if many more follow.
While they start, this process goes on.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import Future, ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from itertools import islice
import multiprocessing
from multiprocessing import forkserver, resource_tracker
from multiprocessing.connection import wait
import os
import signal
from threading import Thread
import time
from typing import TypeVar

import cv2
from p4pfr_ros.files.yaml_fields import ConfigError

Item = TypeVar('Item')
Result = TypeVar('Result')

# Images that are processed before it is decided: the first one loads or compiles the kernels, the
# others tell the time per image.
_FIRST, _TIMED = 1, 4
# Processes are started if the images that remain take longer here, s.
WORTH_S = 2.0
# With more images, processes are likely to be worth it.
_LIKELY = 100
_IMPORTED = ['p4pfr_ros.cli.estimate', 'p4pfr_ros.cli.calibrate']
# Images that are sent to a process together, and such tasks per process that wait.
_PER_TASK, _AHEAD = 8, 2


def available_cores() -> int:
    """Return the number of cores that this process may use."""
    if hasattr(os, 'sched_getaffinity'):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


def in_order(
    function: Callable[[Item], Result], items: Iterable[Item], total: int | None, jobs: int
) -> Iterator[Result]:
    """
    Yield the results of a function of the items, in their order, computed on several cores.

    Parameters
    ----------
    function
        A function that can be pickled; it changes nothing that other items depend on.
    items, total
        What to process, and their number (None: unknown).
    jobs
        The largest number of processes; with 1, all is processed here.

    Raises
    ------
    ConfigError
        A process ended before its item was done, or the function raised it.

    """
    waiting = iter(items)
    if jobs > 1:
        if total is not None and total > _LIKELY:
            _start_server()
        yield from map(function, islice(waiting, _FIRST))
        # What this process has done until here, the others have to do as well.
        start_s, began_s = time.process_time(), time.perf_counter()
        yield from map(function, islice(waiting, _TIMED))
        each_s = (time.perf_counter() - began_s) / _TIMED
        left = None if total is None else total - _FIRST - _TIMED
        if left is None:  # a stream may be live: then each image counts
            yield from _on_processes(function, waiting, 0, jobs, per_task=1)
            return
        if left * each_s > WORTH_S:
            here = min(int(start_s / each_s), left // (jobs + 1))
            per_task = max(1, min(_PER_TASK, left // (_AHEAD * jobs)))
            yield from _on_processes(function, waiting, here, jobs, per_task)
            return
    yield from map(function, waiting)


def _on_processes(
    function: Callable[[Item], Result],
    items: Iterator[Item],
    here: int,
    jobs: int,
    per_task: int,
) -> Iterator[Result]:
    """Yield the results in order: of the first ``here`` items from this process."""
    context = multiprocessing.get_context('forkserver')
    _start_server()
    executor = ProcessPoolExecutor(jobs, context, _prepare_worker)
    futures: deque[Future[list[Result]]] = deque()
    own = list(islice(items, here))
    try:
        while chunk := list(islice(items, per_task)):
            with without_interrupts():
                futures.append(executor.submit(_all, function, chunk))
            if own and len(futures) <= _AHEAD * jobs:
                continue  # the processes get their tasks before this one goes on
            yield from map(function, own)
            own.clear()
            while futures and (len(futures) > _AHEAD * jobs or futures[0].done()):
                yield from futures.popleft().result()
        yield from map(function, own)
        while futures:
            yield from futures.popleft().result()
    except BrokenProcessPool:
        raise ConfigError(
            'a worker process ended unexpectedly, maybe for lack of memory: try --jobs 1'
        ) from None
    finally:
        executor.shutdown(cancel_futures=True)


def _start_server() -> None:
    """Start the process that others are forked from; it imports what they need meanwhile."""
    # Cheaper than to import in each, and safe where this process has threads (OpenCV's, the
    # progress bar's), unlike its own forks.
    multiprocessing.get_context('forkserver').set_forkserver_preload(_IMPORTED)
    with without_interrupts():
        forkserver.ensure_running()


def _all(function: Callable[[Item], Result], items: list[Item]) -> list[Result]:
    return [function(item) for item in items]


@contextmanager
def without_interrupts() -> Iterator[None]:
    """Start processes and threads that ignore Ctrl-C, which is for this process alone."""
    # They inherit the mask. The processes end when this one shuts them down. The tracker comes
    # first: Python unblocks the signal when it starts it.
    resource_tracker.ensure_running()
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


def _prepare_worker() -> None:
    # All cores have a process.
    cv2.setNumThreads(1)
    Thread(target=_end_with_parent, daemon=True).start()


def _end_with_parent() -> None:
    """End this process when its parent ends, however it does: nobody waits for the results."""
    parent = multiprocessing.parent_process()
    if parent is not None:
        wait([parent.sentinel])
        os._exit(1)
