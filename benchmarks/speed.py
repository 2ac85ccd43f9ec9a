# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""Time per solve, in units of one 6x6 np.linalg.eigvals of the same run."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
import functools
import time

import numpy as np
from p4pfr_ros import solve_p4pfr, solve_p4pfr_batch
from p4pfr_ros.core.geometry import Array
from p4pfr_ros.scenes.instances import Instances

# A block takes a millisecond or two: short enough that both blocks of a pair run under the same
# conditions, long enough that the resolution of the clock does not matter.
_MATRICES = 250
_SOLVES = 500
_CALLS = 100


@dataclass(frozen=True, slots=True)
class Speed:
    """Medians over pairs of blocks."""

    ratio: float  # time of one solve / time of one eigvals
    solve_us: float
    eigvals_us: float


def batch_speed(drawn: Instances) -> Speed:
    """Time ``solve_p4pfr_batch`` on one core."""
    return _interleave(solve_p4pfr_batch, drawn, _SOLVES)


def single_speed(drawn: Instances) -> Speed:
    """Time ``solve_p4pfr``, called from Python for each problem."""

    def call_each(image: Array, board: Array) -> None:
        for points_px, points in zip(image, board, strict=True):
            solve_p4pfr(points_px, points)

    return _interleave(call_each, drawn, _CALLS)


def _interleave(solve: Callable[[Array, Array], object], drawn: Instances, block: int) -> Speed:
    """Alternate blocks of solves and eigvals; each instance once, to defeat branch prediction."""
    pairs = len(drawn) // block
    matrices = companions(pairs * _MATRICES).reshape(pairs, _MATRICES, 6, 6)
    solve(drawn.image_points[:block], drawn.board_points[:block])  # compile
    times_us = np.empty((pairs, 2))
    for i in range(pairs):
        at = slice(i * block, (i + 1) * block)
        image, board, companion = drawn.image_points[at], drawn.board_points[at], matrices[i]
        times_us[i, 0] = _cpu_us(functools.partial(solve, image, board)) / block
        times_us[i, 1] = _cpu_us(functools.partial(np.linalg.eigvals, companion)) / _MATRICES
    solve_us, eigvals_us = np.median(times_us, axis=0)
    return Speed(
        float(np.median(times_us[:, 0] / times_us[:, 1])), float(solve_us), float(eigvals_us)
    )


def _cpu_us(work: Callable[[], object]) -> float:
    start = time.process_time()
    work()
    return 1e6 * (time.process_time() - start)


def companions(n: int) -> Array:
    """Return the companion matrices (n, 6, 6) of sextics with random coefficients."""
    matrices = np.zeros((n, 6, 6))
    matrices[:, range(1, 6), range(5)] = 1.0
    matrices[:, :, 5] = np.random.default_rng(0).standard_normal((n, 6))
    return matrices
