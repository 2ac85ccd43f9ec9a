# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""
Processes images on several cores, in order.

Images are independent until their results are used, so the results do not depend on the number of
processes. Starting processes takes as long as some tens of images: the first images are processed
here, which also compiles the kernels once, and processes are started only if many more follow.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import Future, ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from itertools import islice
import multiprocessing
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
# Images per process that are read in advance.
_AHEAD = 3


def available_cores() -> int:
    """Return the number of cores that this process may use."""
    return len(os.sched_getaffinity(0))


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
        yield from map(function, islice(waiting, _FIRST))
        began_s = time.perf_counter()
        yield from map(function, islice(waiting, _TIMED))
        each_s = (time.perf_counter() - began_s) / _TIMED
        left = None if total is None else total - _FIRST - _TIMED
        if left is None or left * each_s > WORTH_S:
            yield from _on_processes(function, waiting, jobs if left is None else min(jobs, left))
            return
    yield from map(function, waiting)


def _on_processes(
    function: Callable[[Item], Result], items: Iterator[Item], jobs: int
) -> Iterator[Result]:
    # Forked from a server that has imported everything: cheaper than to import in each, and safe
    # where this process has threads (OpenCV's, the progress bar's), unlike its own forks.
    context = multiprocessing.get_context('forkserver')
    context.set_forkserver_preload(['p4pfr_ros.cli.estimate', 'p4pfr_ros.cli.calibrate'])
    executor = ProcessPoolExecutor(jobs, context, _prepare_worker)
    futures: deque[Future[Result]] = deque()
    try:
        for item in items:
            with _without_interrupts():
                futures.append(executor.submit(function, item))
            if len(futures) > _AHEAD * jobs:
                yield futures.popleft().result()
        while futures:
            yield futures.popleft().result()
    except BrokenProcessPool:
        raise ConfigError(
            'a worker process ended unexpectedly, maybe for lack of memory: try --jobs 1'
        ) from None
    finally:
        executor.shutdown(cancel_futures=True)


@contextmanager
def _without_interrupts() -> Iterator[None]:
    """Start processes and threads that ignore Ctrl-C, which is for this process alone."""
    # They inherit the mask. The processes end when this one shuts them down.
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
