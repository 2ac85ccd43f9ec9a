# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""
The memory of a block of problems: one row for each number, one lane for each problem.

The problems of a block form groups of LANES. A group is one array: lane i of row r is at
r LANES + i, so the eight numbers of a row fill a vector register, and LLVM knows the distance of
all rows. ``lanes`` computes with it.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from .cone import Cone
from .four import Four, Points
from .one import Workspace, workspace
from .pose import Frame
from .sextic import Factors, Seven
from .solution import MAX_SOLUTIONS, ROW_SIZE
from ..geometry import Array, Ints
from ..jit import inlined, jit, kernel

# Lanes of the widest registers (AVX-512). Narrower machines take several instructions.
LANES = 8

# Groups of a block: enough problems to fill the lanes in every step, few enough for the fastest
# cache.
GROUPS = 4
BLOCK = GROUPS * LANES

# Rows of a group, each of LANES numbers. First what its problems hold:
IMAGE_POINTS, BOARD_POINTS = 0, 8  # as given: x of the four points, then y
IMAGE, WEIGHTS, CONE, SCALE_PX = 16, 24, 28, 36
BOARD, FACTORS = 37, 48
# the parts of (0, 1) where k is small enough: two values of τ, and whether they are wanted;
PARTS = 68
# an interval to be split: its ends, the largest coefficient at the start of the scheme, where to
# split, the coefficients;
INTERVAL, INTERVAL_ROWS = 73, 11
# its left and right parts: the same, the root if there is one, whether S is rising there, the
# number of sign changes, and whether the problem is hard, and the accuracy lost;
LEFT, RIGHT = 84, 100
GUESS, RISING, VARIATIONS, HARD, LOST = 11, 12, 13, 14, 15
POOL_ROWS = 13
# the number of roots; one of them in the course of Newton's method: ends, τ, whether S is rising,
# the rest of ``Bracket``; those that may belong to a camera, sorted;
N_ROOTS, BRACKET, TAU, SORTED = 116, 117, 119, 124
# a solution: its row, t, g and h of the scaled problem, whether it is one, and accurate.
FOUND = 130
FOUND_SCALED = FOUND + ROW_SIZE
VALID, ACCURATE = FOUND_SCALED + 5, FOUND_SCALED + 6
ROWS = ACCURATE + 1

# More than a sextic has; the last place is for the root that makes a problem hard.
ROOT_PLACES = MAX_SOLUTIONS + 1

# Lengths of the queues and of the pool, and which entry of ``Block.counts`` is the number in each.
QUEUE = 4 * BLOCK
POOL = 4 * BLOCK
N_SPLITS, N_WHOLE, N_POOL = 0, 1, 2


class Block(NamedTuple):
    """Workspace of a block, allocated once."""

    groups: Array  # (GROUPS, ROWS * LANES): the problems
    work: Array  # (ROWS * LANES,): intervals of any problems
    problem: Ints  # (LANES,): of these intervals
    source: Ints  # (BLOCK,): the sample of each problem
    pool: Array  # (POOL, POOL_ROWS * LANES): parts of intervals
    splits: Ints  # their places in the pool, of those to be split
    split_problem: Ints
    whole: Array  # (2, QUEUE): ends of intervals whose coefficients come from the factors
    whole_problem: Ints
    roots: Array  # (GROUPS, ROOT_PLACES, 4 LANES): low, high, first τ, whether S is rising
    counts: Ints  # lengths of the queues and the pool
    n_splits: Ints  # (BLOCK,): how often each problem's intervals were split
    hard: Ints  # (BLOCK,): whether the problem is left to the kernel of one problem
    one: Workspace


@jit
def block_work() -> Block:
    """Allocate a block."""
    return Block(
        np.empty((GROUPS, ROWS * LANES)),
        np.empty(ROWS * LANES),
        np.empty(LANES, dtype=np.int64),
        np.empty(BLOCK, dtype=np.int64),
        np.empty((POOL, POOL_ROWS * LANES)),
        np.empty(QUEUE, dtype=np.int64),
        np.empty(QUEUE, dtype=np.int64),
        np.empty((2, QUEUE)),
        np.empty(QUEUE, dtype=np.int64),
        np.empty((GROUPS, ROOT_PLACES, 4 * LANES)),
        np.empty(3, dtype=np.int64),
        np.empty(BLOCK, dtype=np.int64),
        np.empty(BLOCK, dtype=np.int64),
        workspace(),
    )


@kernel
def put_sample(image: Points, board: Points, at: int, block: Block) -> None:
    """Write a sample to the block."""
    store_points(image, block.groups[at // LANES], IMAGE_POINTS * LANES + at % LANES)
    store_points(board, block.groups[at // LANES], BOARD_POINTS * LANES + at % LANES)


@inlined
def padded(n: int) -> int:
    """Return how many samples fill all lanes of n samples; copies of one may fill the rest."""
    return (n + LANES - 1) // LANES * LANES


@inlined
def load_three(group: Array, at: int) -> tuple[float, float, float]:
    """Read three rows of a lane."""
    return group[at], group[at + LANES], group[at + 2 * LANES]


@inlined
def load_four(group: Array, at: int) -> Four:
    """Read four rows of a lane."""
    return group[at], group[at + LANES], group[at + 2 * LANES], group[at + 3 * LANES]


@inlined
def load_seven(group: Array, at: int) -> Seven:
    """Read seven rows of a lane."""
    return (*load_four(group, at), *load_three(group, at + 4 * LANES))


@inlined
def load_points(group: Array, at: int) -> Points:
    """Read four points of a lane: x, then y."""
    return Points(load_four(group, at), load_four(group, at + 4 * LANES))


@inlined
def load_cone(group: Array, lane: int) -> Cone:
    """Read the cone of a lane."""
    at = CONE * LANES + lane
    return Cone(True, load_four(group, at), load_four(group, at + 4 * LANES))


@inlined
def load_board(group: Array, lane: int) -> Points:
    """Read the scaled board of a lane."""
    return load_points(group, BOARD * LANES + lane)


@inlined
def load_frame(group: Array, lane: int) -> Frame:
    """Read size and centroid of the board of a lane."""
    return load_three(group, (BOARD + 8) * LANES + lane)


@inlined
def load_factors(group: Array, lane: int) -> Factors:
    """Read the factors of a lane."""
    at = FACTORS * LANES + lane
    u0, u1, u2, u3 = load_four(group, at)
    v0, v1, v2, v3 = load_four(group, at + 4 * LANES)
    l0, l1, l2, l3 = load_four(group, at + 8 * LANES)
    p0, p1, p2, p3 = load_four(group, at + 12 * LANES)
    return Factors(
        complex(u0, u1),
        complex(u2, u3),
        complex(v0, v1),
        complex(v2, v3),
        complex(l0, l1),
        complex(l2, l3),
        complex(p0, p1),
        complex(p2, p3),
        *load_four(group, at + 16 * LANES),
    )


@inlined
def store_four(four: Four, group: Array, at: int) -> None:
    """Write four rows of a lane."""
    for i in range(4):
        group[at + i * LANES] = four[i]


@inlined
def store_points(points: Points, group: Array, at: int) -> None:
    """Write four points of a lane: x, then y."""
    store_four(points.x, group, at)
    store_four(points.y, group, at + 4 * LANES)


@inlined
def store_factors(f: Factors, group: Array, lane: int) -> None:
    """Write the factors of a lane."""
    at = FACTORS * LANES + lane
    store_four((f.u0.real, f.u0.imag, f.u1.real, f.u1.imag), group, at)
    store_four((f.v0.real, f.v0.imag, f.v1.real, f.v1.imag), group, at + 4 * LANES)
    store_four((f.l0.real, f.l0.imag, f.l1.real, f.l1.imag), group, at + 8 * LANES)
    store_four((f.p0.real, f.p0.imag, f.p1.real, f.p1.imag), group, at + 12 * LANES)
    store_four((f.n0, f.n1, f.d0, f.d1), group, at + 16 * LANES)
