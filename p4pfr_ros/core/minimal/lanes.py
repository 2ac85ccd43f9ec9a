# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""
The solver for a block of problems, in vector registers.

It calls the formulas of ``solver.solve_minimal`` in loops over lanes: eight problems, intervals or
roots side by side. All numbers of one kind, say the first coefficients, are adjacent in memory, so
that LLVM compiles such a loop to instructions that take eight lanes at once, or as many as the
machine's registers hold. No step has a branch; where problems need different work, what is left to
do is collected and packed densely into lanes again:

1. ``_open_cones``: scale, weights, cone. Only the problems with a cone go on.
2. ``_form_sextics``: board, factors, and the parts of (0, 1) where k is small enough.
3. ``_isolate_roots``: intervals of all problems wait in two queues, one for those to be split by
   de Casteljau's scheme, one for those whose coefficients come from the factors.
4. ``_solve_roots``: all roots of all problems: Newton's method, pose, residual.

Rare problems are left to ``solve_minimal``: those with a multiple root or a root at a split point,
and those that need too many intervals. The solutions are the same, to the last bit.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from .cone import board_weights, Cone, depth_cone
from .four import Four, Points
from .pose import is_accurate, pose_from_root, scale_board, scale_image, unscale
from .roots import (
    bounded_parts,
    Bracket,
    de_casteljau,
    largest_of,
    MAX_NEWTON_STEPS,
    newton_step,
    share_to_split,
    SHORTEST,
    sign_lost,
    signs_of,
)
from .sextic import coefficients, Factors, factors, Seven
from .solution import G, MAX_SOLUTIONS, ROW_SIZE
from .one import refine, solve_minimal, workspace, Workspace
from ..geometry import Array, Ints, TRANSLATION
from ..jit import inlined, jit, kernel, part_of_kernel
from ..linalg import copy_row

# Lanes of the widest registers (AVX-512). Narrower machines take several instructions.
LANES = 8

# Groups of a block: enough problems to fill the lanes in every step, few enough for the fastest
# cache.
_GROUPS = 4
BLOCK = _GROUPS * LANES

# Rows of a group, each of LANES numbers. First what its problems hold:
IMAGE_POINTS, BOARD_POINTS = 0, 8  # as given: x of the four points, then y
_IMAGE, _WEIGHTS, _CONE, _SCALE_PX = 16, 24, 28, 36
_BOARD, _FACTORS = 37, 48
# the parts of (0, 1) where k is small enough: two values of τ, and whether they are wanted;
_PARTS = 68
# an interval to be split: its ends, the largest coefficient at the start of the scheme, where to
# split, the coefficients;
_INTERVAL, _INTERVAL_ROWS = 73, 11
# its left and right parts: the same, the root if there is one, whether S is rising there, the
# number of sign changes, and whether the problem is hard, and the accuracy lost;
_LEFT, _RIGHT = 84, 100
_GUESS, _RISING, _VARIATIONS, _HARD, _LOST = 11, 12, 13, 14, 15
_POOL_ROWS = 13
# the number of roots; one of them in the course of Newton's method: ends, τ, whether S is rising,
# the rest of ``Bracket``; those that may belong to a camera, sorted;
_N_ROOTS, _BRACKET, _TAU, _SORTED = 116, 117, 119, 124
# a solution: its row, t, g and h of the scaled problem, whether it is one, and accurate.
_FOUND = 130
_FOUND_SCALED = _FOUND + ROW_SIZE
_VALID, _ACCURATE = _FOUND_SCALED + 5, _FOUND_SCALED + 6
_ROWS = _ACCURATE + 1

# More than a sextic has; the last place is for the root that makes a problem hard.
_ROOT_PLACES = MAX_SOLUTIONS + 1

# A problem with more splits is left to the kernel of one problem.
_MAX_SPLITS = 40
_QUEUE = 4 * BLOCK
_POOL = 4 * BLOCK
_N_SPLITS, _N_WHOLE, _N_POOL = 0, 1, 2


class Block(NamedTuple):
    """Workspace of a block, allocated once."""

    groups: Array  # (_GROUPS, _ROWS * LANES): the problems
    work: Array  # (_ROWS * LANES,): intervals of any problems
    problem: Ints  # (LANES,): of these intervals
    source: Ints  # (BLOCK,): the sample of each problem
    pool: Array  # (_POOL, _POOL_ROWS * LANES): parts of intervals
    splits: Ints  # their places in the pool, of those to be split
    split_problem: Ints
    whole: Array  # (2, _QUEUE): ends of intervals whose coefficients come from the factors
    whole_problem: Ints
    roots: Array  # (_GROUPS, _ROOT_PLACES, 4 LANES): low, high, first τ, whether S is rising
    counts: Ints  # lengths of the queues and the pool
    n_splits: Ints  # (BLOCK,): how often each problem's intervals were split
    hard: Ints  # (BLOCK,): whether the problem is left to the kernel of one problem
    one: Workspace


@jit
def block_work() -> Block:
    """Allocate a block."""
    return Block(
        np.empty((_GROUPS, _ROWS * LANES)),
        np.empty(_ROWS * LANES),
        np.empty(LANES, dtype=np.int64),
        np.empty(BLOCK, dtype=np.int64),
        np.empty((_POOL, _POOL_ROWS * LANES)),
        np.empty(_QUEUE, dtype=np.int64),
        np.empty(_QUEUE, dtype=np.int64),
        np.empty((2, _QUEUE)),
        np.empty(_QUEUE, dtype=np.int64),
        np.empty((_GROUPS, _ROOT_PLACES, 4 * LANES)),
        np.empty(3, dtype=np.int64),
        np.empty(BLOCK, dtype=np.int64),
        np.empty(BLOCK, dtype=np.int64),
        workspace(),
    )


@part_of_kernel
def solve_block(n: int, max_bend: float, rows: Array, count: Ints, block: Block) -> None:
    """
    Solve the first n samples of the block as ``solve_minimal`` does.

    Write their solutions to ``rows`` (≥ n, 6, ROW_SIZE) and their numbers to ``count`` (≥ n,).
    """
    for i in range(n):
        count[i] = 0
    for g in range(_groups_of(n)):
        _open_cones(block.groups[g])
    alive = _keep_open(n, block)
    for g in range(_groups_of(alive)):
        _form_sextics(max_bend, block.groups[g])
    _isolate_roots(alive, block)
    for g in range(_groups_of(alive)):
        group = block.groups[g]
        _refine_roots(group, block.roots[g])
        _solve_group(group, alive - g * LANES, block.source[g * LANES :], rows, count, block.one)
    for i in range(alive):
        if block.hard[i]:
            group, lane, sample = block.groups[i // LANES], i % LANES, block.source[i]
            image, board = (
                _points(group, IMAGE_POINTS * LANES + lane),
                _points(group, BOARD_POINTS * LANES + lane),
            )
            count[sample] = solve_minimal(image, board, max_bend, rows[sample], block.one)


@kernel
def put_sample(image: Points, board: Points, at: int, block: Block) -> None:
    """Write a sample to the block."""
    _put_points(image, block.groups[at // LANES], IMAGE_POINTS * LANES + at % LANES)
    _put_points(board, block.groups[at // LANES], BOARD_POINTS * LANES + at % LANES)


@inlined
def padded(n: int) -> int:
    """Return how many samples fill the lanes of n; the last problem may fill those that are left."""
    return (n + LANES - 1) // LANES * LANES


@inlined
def _groups_of(n: int) -> int:
    return (n + LANES - 1) // LANES


@kernel
def _open_cones(group: Array) -> None:
    """Scale the images; find the cones. A problem without one gets the scale 0."""
    for lane in range(LANES):
        scale_px, image, radius = scale_image(_points(group, IMAGE_POINTS * LANES + lane))
        has_weights, weights = board_weights(_points(group, BOARD_POINTS * LANES + lane))
        cone = depth_cone(image, radius, weights)
        _put_points(image, group, _IMAGE * LANES + lane)
        _put_four(weights, group, _WEIGHTS * LANES + lane)
        _put_four(cone.a, group, _CONE * LANES + lane)
        _put_four(cone.b, group, (_CONE + 4) * LANES + lane)
        group[_SCALE_PX * LANES + lane] = scale_px if has_weights and cone.opens else 0.0


@inlined
def _keep_open(n: int, block: Block) -> int:
    """Move the problems with a cone to the front; return their number."""
    kept = 0
    for i in range(n):
        group, lane = block.groups[i // LANES], i % LANES
        if group[_SCALE_PX * LANES + lane] > 0.0:
            if kept != i:
                target = block.groups[kept // LANES]
                for row in range(_BOARD):
                    target[row * LANES + kept % LANES] = group[row * LANES + lane]
            block.source[kept] = i
            kept += 1
    return kept


@kernel
def _form_sextics(max_bend: float, group: Array) -> None:
    """Scale the boards, form the factors, and find where k is small enough."""
    for lane in range(LANES):
        board = scale_board(_points(group, BOARD_POINTS * LANES + lane))
        cone = _cone(group, lane)
        image, weights = (
            _points(group, _IMAGE * LANES + lane),
            _four(group, _WEIGHTS * LANES + lane),
        )
        f = factors(image, weights, cone, board.duals)
        first, second, in_first, in_second, in_third = bounded_parts(f, max_bend)
        _put_points(board.points, group, _BOARD * LANES + lane)
        for j in range(3):
            group[(_BOARD + 8 + j) * LANES + lane] = board.frame[j]
        _put_factors(f, group, lane)
        group[_PARTS * LANES + lane] = first
        group[(_PARTS + 1) * LANES + lane] = second
        group[(_PARTS + 2) * LANES + lane] = 1.0 if in_first else 0.0
        group[(_PARTS + 3) * LANES + lane] = 1.0 if in_second else 0.0
        group[(_PARTS + 4) * LANES + lane] = 1.0 if in_third else 0.0


@inlined
def _isolate_roots(n: int, block: Block) -> None:
    """Split the intervals until each has one root at most; list the intervals with one."""
    counts, work = block.counts, block.work
    for i in range(3):
        counts[i] = 0
    for i in range(n):
        block.hard[i] = block.n_splits[i] = 0
    for g in range(_groups_of(n)):
        group, active = block.groups[g], min(n - g * LANES, LANES)
        for lane in range(LANES):
            block.problem[lane] = g * LANES + lane
            group[_N_ROOTS * LANES + lane] = 0.0
        for part in range(3):
            if _count_part(part, group) > 0:
                _set_part(part, group)
                _describe_whole(group)
                _drop_unwanted(part, group)
                _file_parts(active, group, _LEFT * LANES, block)
    while counts[_N_WHOLE] + counts[_N_SPLITS] > 0:
        if counts[_N_WHOLE] >= LANES or counts[_N_SPLITS] == 0:
            active = _take_whole(block)
            _describe_whole(work)
            _file_parts(active, work, _LEFT * LANES, block)
        else:
            active = _take_splits(block)
            _split(work)
            _file_parts(active, work, _LEFT * LANES, block)
            _file_parts(active, work, _RIGHT * LANES, block)


@inlined
def _count_part(part: int, group: Array) -> int:
    """Return in how many lanes a part is wanted."""
    lanes = 0
    for lane in range(LANES):
        lanes += 1 if group[(_PARTS + 2 + part) * LANES + lane] > 0.0 else 0
    return lanes


@inlined
def _set_part(part: int, group: Array) -> None:
    """Make one of the three parts of (0, 1) the interval of each lane."""
    for lane in range(LANES):
        first, second = group[_PARTS * LANES + lane], group[(_PARTS + 1) * LANES + lane]
        group[_INTERVAL * LANES + lane] = 0.0 if part == 0 else first if part == 1 else second
        high = first if part == 0 else second if part == 1 else 1.0
        group[(_INTERVAL + 1) * LANES + lane] = high


@inlined
def _drop_unwanted(part: int, group: Array) -> None:
    for lane in range(LANES):
        wanted = group[(_PARTS + 2 + part) * LANES + lane]
        group[(_LEFT + _VARIATIONS) * LANES + lane] *= wanted
        group[(_LEFT + _HARD) * LANES + lane] *= wanted


@inlined
def _append_whole(problem: int, low: float, high: float, block: Block) -> None:
    at = block.counts[_N_WHOLE]
    if at == _QUEUE:
        block.hard[problem] = 1
        return
    block.whole_problem[at] = problem
    block.whole[0, at] = low
    block.whole[1, at] = high
    block.counts[_N_WHOLE] = at + 1


@inlined
def _take_whole(block: Block) -> int:
    """Take intervals and their problems' factors; return their number."""
    work = block.work
    n = min(block.counts[_N_WHOLE], LANES)
    block.counts[_N_WHOLE] -= n
    for lane in range(n):
        at = block.counts[_N_WHOLE] + lane
        problem = block.whole_problem[at]
        block.problem[lane] = problem
        work[_INTERVAL * LANES + lane] = block.whole[0, at]
        work[(_INTERVAL + 1) * LANES + lane] = block.whole[1, at]
        group, place = block.groups[problem // LANES], problem % LANES
        for row in range(_FACTORS, _PARTS):
            work[row * LANES + lane] = group[row * LANES + place]
    return n


@kernel
def _describe_whole(work: Array) -> None:
    """Compute the coefficients from the factors."""
    for lane in range(LANES):
        low, high = work[_INTERVAL * LANES + lane], work[(_INTERVAL + 1) * LANES + lane]
        c = coefficients(_factors(work, lane), low, high)
        _put_part(low, high, largest_of(c), c, False, work, _LEFT * LANES + lane)


@inlined
def _take_splits(block: Block) -> int:
    """Take intervals to be split; return their number."""
    n = min(block.counts[_N_SPLITS], LANES)
    block.counts[_N_SPLITS] -= n
    first = block.counts[_N_SPLITS]
    for lane in range(n):
        problem, at = block.split_problem[first + lane], block.splits[first + lane]
        block.problem[lane] = problem
        block.n_splits[problem] += 1
        block.hard[problem] |= int(block.n_splits[problem] > _MAX_SPLITS)
        part, place = block.pool[at // LANES], at % LANES
        for row in range(_INTERVAL_ROWS):
            block.work[(_INTERVAL + row) * LANES + lane] = part[row * LANES + place]
    return n


@kernel
def _split(work: Array) -> None:
    """Split by de Casteljau's scheme."""
    for lane in range(LANES):
        low, high = work[_INTERVAL * LANES + lane], work[(_INTERVAL + 1) * LANES + lane]
        size, share = work[(_INTERVAL + 2) * LANES + lane], work[(_INTERVAL + 3) * LANES + lane]
        left, right = de_casteljau(_seven(work, (_INTERVAL + 4) * LANES + lane), share)
        lost = sign_lost(left, size) or sign_lost(right, size)
        middle = low + (high - low) * share
        _put_part(low, middle, size, left, lost, work, _LEFT * LANES + lane)
        _put_part(middle, high, size, right, lost, work, _RIGHT * LANES + lane)


@inlined
def _put_part(
    low: float, high: float, size: float, c: Seven, lost: bool, work: Array, at: int
) -> None:
    signs = signs_of(c)
    hard = signs.zero_at_high and high < 1.0
    hard = hard or (signs.variations > 1.0 and high - low < SHORTEST)
    work[at] = low
    work[at + 1 * LANES] = high
    work[at + 2 * LANES] = size
    work[at + 3 * LANES] = share_to_split(signs)
    for i in range(7):
        work[at + (4 + i) * LANES] = c[i]
    work[at + _GUESS * LANES] = low + (high - low) * signs.first
    work[at + _RISING * LANES] = 1.0 if signs.rising else 0.0
    work[at + _VARIATIONS * LANES] = signs.variations
    work[at + _HARD * LANES] = 1.0 if hard else 0.0
    work[at + _LOST * LANES] = 1.0 if lost else 0.0


@inlined
def _file_parts(n: int, work: Array, first: int, block: Block) -> None:
    """List each part where it belongs: to be split, to be computed again, or a root."""
    at = min(block.counts[_N_POOL], _POOL - 1)
    block.counts[_N_POOL] = at + 1
    copy_row(work[first : first + _POOL_ROWS * LANES], block.pool[at])
    n_splits = block.counts[_N_SPLITS]
    for lane in range(n):
        problem = block.problem[lane]
        if work[first + _LOST * LANES + lane] > 0.0:
            low, high = work[first + lane], work[first + LANES + lane]
            _append_whole(problem, low, high, block)
            continue
        # Written to both lists without a condition, which would be unpredictable, and counted in
        # one of them.
        block.splits[n_splits] = at * LANES + lane
        block.split_problem[n_splits] = problem
        group, place = block.groups[problem // LANES], problem % LANES
        count = group[_N_ROOTS * LANES + place]
        root = block.roots[problem // LANES, int(count)]
        root[place] = work[first + lane]
        root[1 * LANES + place] = work[first + LANES + lane]
        root[2 * LANES + place] = work[first + _GUESS * LANES + lane]
        root[3 * LANES + place] = work[first + _RISING * LANES + lane]
        full = n_splits == _QUEUE - LANES or at == _POOL - 1 or count >= MAX_SOLUTIONS
        hard = block.hard[problem] | int(work[first + _HARD * LANES + lane] > 0.0) | int(full)
        block.hard[problem] = hard
        variations = work[first + _VARIATIONS * LANES + lane]
        n_splits += int(variations > 1.0) & (1 - hard)
        group[_N_ROOTS * LANES + place] = count + (1.0 if variations == 1.0 and hard == 0 else 0.0)
    block.counts[_N_SPLITS] = n_splits


@inlined
def _refine_roots(group: Array, roots: Array) -> None:
    """Refine all roots of a group; sort those with f² > 0."""
    bracket = group[_BRACKET * LANES : (_BRACKET + 4) * LANES]
    for k in range(MAX_SOLUTIONS):
        if _count_above(k, group) > 0:
            copy_row(roots[k], bracket)
            _start_newton(k, group)
            for _ in range(MAX_NEWTON_STEPS):
                if _newton_steps(group) == 0:
                    break
        _finish_newton(k, group)
        copy_row(
            group[_TAU * LANES : (_TAU + 1) * LANES],
            group[(_SORTED + k) * LANES : (_SORTED + k + 1) * LANES],
        )
    _sort(group)


@inlined
def _count_above(k: int, group: Array) -> int:
    """Return how many lanes have more than k roots."""
    lanes = 0
    for lane in range(LANES):
        lanes += 1 if group[_N_ROOTS * LANES + lane] > k else 0
    return lanes


@inlined
def _start_newton(k: int, group: Array) -> None:
    for lane in range(LANES):
        low, high = group[_BRACKET * LANES + lane], group[(_BRACKET + 1) * LANES + lane]
        group[(_BRACKET + 4) * LANES + lane] = high - low
        group[(_BRACKET + 5) * LANES + lane] = 0.0
        group[(_BRACKET + 6) * LANES + lane] = 1.0 if group[_N_ROOTS * LANES + lane] <= k else 0.0


@inlined
def _finish_newton(k: int, group: Array) -> None:
    """Make τ infinite in the lanes without a root, or without f² > 0 there."""
    for lane in range(LANES):
        feasible = (
            k < group[_N_ROOTS * LANES + lane] and group[(_BRACKET + 5) * LANES + lane] < 0.0
        )
        tau = group[_TAU * LANES + lane]
        group[_TAU * LANES + lane] = tau if feasible else math.inf


@inlined
def _newton_steps(group: Array) -> int:
    """Take one step in each lane that needs one; return how many need another."""
    more = 0
    for lane in range(LANES):
        low, high, tau, rising = _four(group, _BRACKET * LANES + lane)
        before, re, is_done = _three(group, (_BRACKET + 4) * LANES + lane)
        done = is_done > 0.0
        bracket = Bracket(low, high, tau, before, re, done)
        after = newton_step(_factors(group, lane), rising > 0.0, bracket)
        group[_BRACKET * LANES + lane] = low if done else after.low
        group[(_BRACKET + 1) * LANES + lane] = high if done else after.high
        group[_TAU * LANES + lane] = tau if done else after.tau
        group[(_BRACKET + 4) * LANES + lane] = before if done else after.before
        group[(_BRACKET + 5) * LANES + lane] = re if done else after.re
        group[(_BRACKET + 6) * LANES + lane] = 1.0 if done or after.done else 0.0
        more += 0 if done or after.done else 1
    return more


@kernel
def _sort(group: Array) -> None:
    """Sort the values of τ; those without f² > 0 have become infinite."""
    for lane in range(LANES):
        a, b, c, d = _four(group, _SORTED * LANES + lane)
        e, f = group[(_SORTED + 4) * LANES + lane], group[(_SORTED + 5) * LANES + lane]
        # The network of twelve comparisons.
        a, f, b, d, c, e = min(a, f), max(a, f), min(b, d), max(b, d), min(c, e), max(c, e)
        b, c, d, e = min(b, c), max(b, c), min(d, e), max(d, e)
        a, d, c, f = min(a, d), max(a, d), min(c, f), max(c, f)
        a, b, c, d, e, f = min(a, b), max(a, b), min(c, d), max(c, d), min(e, f), max(e, f)
        b, c, d, e = min(b, c), max(b, c), min(d, e), max(d, e)
        _put_four((a, b, c, d), group, _SORTED * LANES + lane)
        group[(_SORTED + 4) * LANES + lane] = e
        group[(_SORTED + 5) * LANES + lane] = f


@inlined
def _solve_group(
    group: Array, n: int, source: Ints, rows: Array, count: Ints, one: Workspace
) -> None:
    """Write the solutions of a group's first n problems, root by root."""
    for k in range(MAX_SOLUTIONS):
        wanted = 0
        for lane in range(LANES):
            tau = group[(_SORTED + k) * LANES + lane]
            group[_TAU * LANES + lane] = tau
            wanted += 1 if tau < 1.0 else 0
        if wanted == 0:
            break
        _find_poses(group)
        for lane in range(min(n, LANES)):
            if group[_VALID * LANES + lane] > 0.0:
                sample = source[lane]
                count[sample] += _write_solution(
                    group, lane, rows[sample, min(count[sample], MAX_SOLUTIONS - 1)], one
                )


@kernel
def _find_poses(group: Array) -> None:
    """Find the solution of one root in each lane, scaled and not."""
    for lane in range(LANES):
        image, board = _points(group, _IMAGE * LANES + lane), _points(group, _BOARD * LANES + lane)
        tau = group[_TAU * LANES + lane]
        has_pose, row = pose_from_root(_factors(group, lane), tau, _cone(group, lane), image)
        public = unscale(
            row, group[_SCALE_PX * LANES + lane], _three(group, (_BOARD + 8) * LANES + lane)
        )
        _put_four(public[:4], group, _FOUND * LANES + lane)
        _put_four(public[4:8], group, (_FOUND + 4) * LANES + lane)
        _put_four(public[8:12], group, (_FOUND + 8) * LANES + lane)
        _put_four((*public[12:], *row[9:11]), group, (_FOUND + 12) * LANES + lane)
        group[(_FOUND + 16) * LANES + lane] = row[11]
        group[(_FOUND + 17) * LANES + lane] = row[12]
        group[(_FOUND + 18) * LANES + lane] = row[13]
        group[_VALID * LANES + lane] = 1.0 if has_pose and tau < 1.0 else 0.0
        group[_ACCURATE * LANES + lane] = 1.0 if is_accurate(row, image, board) else 0.0


@inlined
def _write_solution(group: Array, lane: int, row: Array, one: Workspace) -> int:
    """Write the solution of a lane, refined if it needs it; return 0 if it is none, else 1."""
    for j in range(ROW_SIZE):
        row[j] = group[(_FOUND + j) * LANES + lane]
    if group[_ACCURATE * LANES + lane] > 0.0:
        return 1
    for j in range(5):
        row[TRANSLATION + j] = group[(_FOUND_SCALED + j) * LANES + lane]
    image, board = _points(group, _IMAGE * LANES + lane), _points(group, _BOARD * LANES + lane)
    scale_px, frame = group[_SCALE_PX * LANES + lane], _three(group, (_BOARD + 8) * LANES + lane)
    return refine(row, image, board, scale_px, frame, one)


@inlined
def _three(group: Array, at: int) -> tuple[float, float, float]:
    """Read a lane's numbers of three rows; the functions below read and write more of them."""
    return group[at], group[at + LANES], group[at + 2 * LANES]


@inlined
def _four(group: Array, at: int) -> Four:
    return group[at], group[at + LANES], group[at + 2 * LANES], group[at + 3 * LANES]


@inlined
def _seven(group: Array, at: int) -> Seven:
    return (*_four(group, at), *_three(group, at + 4 * LANES))


@inlined
def _points(group: Array, at: int) -> Points:
    return Points(_four(group, at), _four(group, at + 4 * LANES))


@inlined
def _cone(group: Array, lane: int) -> Cone:
    at = _CONE * LANES + lane
    return Cone(True, _four(group, at), _four(group, at + 4 * LANES))


@inlined
def _factors(group: Array, lane: int) -> Factors:
    at = _FACTORS * LANES + lane
    u0, u1, u2, u3 = _four(group, at)
    v0, v1, v2, v3 = _four(group, at + 4 * LANES)
    l0, l1, l2, l3 = _four(group, at + 8 * LANES)
    p0, p1, p2, p3 = _four(group, at + 12 * LANES)
    return Factors(
        complex(u0, u1),
        complex(u2, u3),
        complex(v0, v1),
        complex(v2, v3),
        complex(l0, l1),
        complex(l2, l3),
        complex(p0, p1),
        complex(p2, p3),
        *_four(group, at + 16 * LANES),
    )


@inlined
def _put_four(four: Four, group: Array, at: int) -> None:
    for i in range(4):
        group[at + i * LANES] = four[i]


@inlined
def _put_points(points: Points, group: Array, at: int) -> None:
    _put_four(points.x, group, at)
    _put_four(points.y, group, at + 4 * LANES)


@inlined
def _put_factors(f: Factors, group: Array, lane: int) -> None:
    at = _FACTORS * LANES + lane
    _put_four((f.u0.real, f.u0.imag, f.u1.real, f.u1.imag), group, at)
    _put_four((f.v0.real, f.v0.imag, f.v1.real, f.v1.imag), group, at + 4 * LANES)
    _put_four((f.l0.real, f.l0.imag, f.l1.real, f.l1.imag), group, at + 8 * LANES)
    _put_four((f.p0.real, f.p0.imag, f.p1.real, f.p1.imag), group, at + 12 * LANES)
    _put_four((f.n0, f.n1, f.d0, f.d1), group, at + 16 * LANES)
