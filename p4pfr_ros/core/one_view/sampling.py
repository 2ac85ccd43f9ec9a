# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""Samples of four points: drawn without repetition, none too flat to solve, and how many."""

from __future__ import annotations

import math

from ..geometry import Array, Ints
from ..jit import jit

# A sample whose largest triangle is below this share of the board's own square extent, or no
# larger in the image than the noise, is drawn again.
_SMALLEST_SHARE = 0.01
_REDRAWS = 20


@jit
def first_state(seed: int) -> int:
    """Return the state to start the generator with: 32 bits, not zero."""
    return 2463534242 ^ (seed & 0x7FFFFFFF)


@jit
def draw_sample(
    image: Array, board: Array, smallest: tuple[float, float], state: int, chosen: Ints
) -> int:
    """Write four different indices to ``chosen``; return the generator's next state."""
    for _ in range(_REDRAWS):
        for i in range(4):
            state = _next_state(state)
            while _among(state % len(image), chosen, i):
                state = _next_state(state)
            chosen[i] = state % len(image)
        if (
            _largest_triangle(image, chosen) > smallest[0]
            and _largest_triangle(board, chosen) > smallest[1]
        ):
            break
    return state


@jit
def smallest_triangles(board: Array, limit: float) -> tuple[float, float]:
    """Return twice the area that a sample's largest triangle must have: image px², board."""
    width = height = 0.0
    for i in range(len(board)):
        width = max(width, abs(board[i, 0]))
        height = max(height, abs(board[i, 1]))
    # In the image: no smaller than the square that the inliers' threshold spans.
    return 4.0 * limit, _SMALLEST_SHARE * (width * width + height * height)


@jit
def samples_needed(inliers: int, points: int, confidence: float) -> float:
    """Return how many samples hold, with that confidence, one of inliers only."""
    # Drawn without repetition: with few points that is much rarer than the share's fourth power.
    all_inside = 1.0
    for i in range(4):
        all_inside *= max(inliers - i, 0) / (points - i)
    if all_inside >= 1.0:
        return 0.0
    if all_inside <= 1e-12:
        return math.inf
    return math.log(1.0 - confidence) / math.log(1.0 - all_inside)


@jit
def _next_state(state: int) -> int:
    """Step Marsaglia's xorshift32: the same numbers compiled and interpreted."""
    state ^= (state << 13) & 0xFFFFFFFF
    state ^= state >> 17
    state ^= (state << 5) & 0xFFFFFFFF
    return state


@jit
def _among(index: int, chosen: Ints, count: int) -> bool:
    found = False
    for i in range(count):
        found = found or chosen[i] == index
    return found


@jit
def _largest_triangle(points: Array, chosen: Ints) -> float:
    """Return twice the area of the largest of the four triangles of four points."""
    largest = 0.0
    for left_out in range(4):
        a = points[chosen[(left_out + 1) % 4]]
        b = points[chosen[(left_out + 2) % 4]]
        c = points[chosen[(left_out + 3) % 4]]
        area = (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0])
        largest = max(largest, abs(area))
    return largest
