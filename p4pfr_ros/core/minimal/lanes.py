# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""
The solver for a block of problems, in vector registers.

It calls the formulas of ``one.solve_minimal`` in loops over lanes: eight problems, intervals or
roots side by side. All numbers of one kind, say the first coefficients, are adjacent in memory, so
that LLVM compiles such a loop to instructions that take eight lanes at once, or as many as the
machine's registers hold. No step has a branch; where problems need different work, what is left to
do is collected and packed densely into lanes again:

1. ``_open_cones``: scale, weights, cone. Only the problems with a cone go on.
2. ``_form_sextics``: board, factors, and the parts of (0, 1) where k is small enough.
3. ``_isolate_roots``: intervals of all problems wait in two queues, one for those to be split by
   de Casteljau's scheme, one for those whose coefficients come from the factors.
4. ``_refine_roots``: Newton's method for the first root of each problem, then the second, ...
5. ``_solve_group``: the poses of the roots, likewise.

Rare problems are left to ``solve_minimal``: those with a multiple root or a root at a split point,
and those that need too many intervals. The solutions are the same, to the last bit.
"""

from __future__ import annotations

import math

from .block import (
    ACCURATE,
    Block,
    BOARD,
    BOARD_POINTS,
    BRACKET,
    CONE,
    FACTORS,
    FOUND,
    FOUND_SCALED,
    GUESS,
    HARD,
    IMAGE,
    IMAGE_POINTS,
    INTERVAL,
    INTERVAL_ROWS,
    LANES,
    LEFT,
    load_cone,
    load_factors,
    load_four,
    load_frame,
    load_points,
    load_seven,
    load_three,
    LOST,
    N_POOL,
    N_ROOTS,
    N_SPLITS,
    N_WHOLE,
    padded,
    PARTS,
    POOL,
    POOL_ROWS,
    QUEUE,
    RIGHT,
    RISING,
    SCALE_PX,
    SORTED,
    store_factors,
    store_four,
    store_points,
    TAU,
    VALID,
    VARIATIONS,
    WEIGHTS,
)
from .cone import board_weights, depth_cone
from .one import refine, solve_minimal, Workspace
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
from .sextic import coefficients, factors, Seven
from .solution import MAX_SOLUTIONS, ROW_SIZE
from ..geometry import Array, Ints, TRANSLATION
from ..jit import inlined, part_of_kernel, vectorised_kernel
from ..linalg import copy_row

# A problem with more splits is left to the kernel of one problem.
_MAX_SPLITS = 40


@part_of_kernel
def solve_block(n: int, max_bend: float, rows: Array, count: Ints, block: Block) -> None:
    """
    Solve the first n samples of the block as ``solve_minimal`` does.

    Write their solutions to ``rows`` (≥ n, 6, ROW_SIZE) and their numbers to ``count`` (≥ n,).
    """
    for i in range(n):
        count[i] = 0
    for g in range(padded(n) // LANES):
        _open_cones(block.groups[g])
    alive = _keep_open(n, block)
    for g in range(padded(alive) // LANES):
        _form_sextics(max_bend, block.groups[g])
    _isolate_roots(alive, block)
    for g in range(padded(alive) // LANES):
        group = block.groups[g]
        _refine_roots(group, block.roots[g])
        _solve_group(group, alive - g * LANES, block.source[g * LANES :], rows, count, block.one)
    for i in range(alive):
        if block.hard[i]:
            group, lane, sample = block.groups[i // LANES], i % LANES, block.source[i]
            image, board = (
                load_points(group, IMAGE_POINTS * LANES + lane),
                load_points(group, BOARD_POINTS * LANES + lane),
            )
            count[sample] = solve_minimal(image, board, max_bend, rows[sample], block.one)


@vectorised_kernel
def _open_cones(group: Array) -> None:
    """Scale the images; find the cones. A problem without one gets the scale 0."""
    for lane in range(LANES):
        scale_px, image, radius = scale_image(load_points(group, IMAGE_POINTS * LANES + lane))
        has_weights, weights = board_weights(load_points(group, BOARD_POINTS * LANES + lane))
        cone = depth_cone(image, radius, weights)
        store_points(image, group, IMAGE * LANES + lane)
        store_four(weights, group, WEIGHTS * LANES + lane)
        store_four(cone.a, group, CONE * LANES + lane)
        store_four(cone.b, group, (CONE + 4) * LANES + lane)
        group[SCALE_PX * LANES + lane] = scale_px if has_weights and cone.opens else 0.0


@inlined
def _keep_open(n: int, block: Block) -> int:
    """Move the problems with a cone to the front; return their number."""
    kept = 0
    for i in range(n):
        group, lane = block.groups[i // LANES], i % LANES
        if group[SCALE_PX * LANES + lane] > 0.0:
            if kept != i:
                target = block.groups[kept // LANES]
                for row in range(BOARD):
                    target[row * LANES + kept % LANES] = group[row * LANES + lane]
            block.source[kept] = i
            kept += 1
    return kept


@vectorised_kernel
def _form_sextics(max_bend: float, group: Array) -> None:
    """Scale the boards, form the factors, and find where k is small enough."""
    for lane in range(LANES):
        board = scale_board(load_points(group, BOARD_POINTS * LANES + lane))
        cone = load_cone(group, lane)
        image, weights = (
            load_points(group, IMAGE * LANES + lane),
            load_four(group, WEIGHTS * LANES + lane),
        )
        f = factors(image, weights, cone, board.duals)
        first, second, in_first, in_second, in_third = bounded_parts(f, max_bend)
        store_points(board.points, group, BOARD * LANES + lane)
        for j in range(3):
            group[(BOARD + 8 + j) * LANES + lane] = board.frame[j]
        store_factors(f, group, lane)
        group[PARTS * LANES + lane] = first
        group[(PARTS + 1) * LANES + lane] = second
        group[(PARTS + 2) * LANES + lane] = 1.0 if in_first else 0.0
        group[(PARTS + 3) * LANES + lane] = 1.0 if in_second else 0.0
        group[(PARTS + 4) * LANES + lane] = 1.0 if in_third else 0.0


@inlined
def _isolate_roots(n: int, block: Block) -> None:
    """Split the intervals until each has one root at most; list the intervals with one."""
    counts, work = block.counts, block.work
    for i in range(3):
        counts[i] = 0
    for i in range(n):
        block.hard[i] = block.n_splits[i] = 0
    for g in range(padded(n) // LANES):
        group, active = block.groups[g], min(n - g * LANES, LANES)
        for lane in range(LANES):
            block.problem[lane] = g * LANES + lane
            group[N_ROOTS * LANES + lane] = 0.0
        for part in range(3):
            if _lanes_above(0.0, PARTS + 2 + part, group) > 0:
                _set_part(part, group)
                _describe_whole(group)
                _drop_unwanted(part, group)
                _file_parts(active, group, LEFT * LANES, block)
    while counts[N_WHOLE] + counts[N_SPLITS] > 0:
        if counts[N_WHOLE] >= LANES or counts[N_SPLITS] == 0:
            active = _take_whole(block)
            _describe_whole(work)
            _file_parts(active, work, LEFT * LANES, block)
        else:
            active = _take_splits(block)
            _split(work)
            _file_parts(active, work, LEFT * LANES, block)
            _file_parts(active, work, RIGHT * LANES, block)


@inlined
def _lanes_above(value: float, row: int, group: Array) -> int:
    """Return in how many lanes a number is larger than the value."""
    lanes = 0
    for lane in range(LANES):
        lanes += 1 if group[row * LANES + lane] > value else 0
    return lanes


@inlined
def _set_part(part: int, group: Array) -> None:
    """Make one of the three parts of (0, 1) the interval of each lane."""
    for lane in range(LANES):
        first, second = group[PARTS * LANES + lane], group[(PARTS + 1) * LANES + lane]
        group[INTERVAL * LANES + lane] = 0.0 if part == 0 else first if part == 1 else second
        high = first if part == 0 else second if part == 1 else 1.0
        group[(INTERVAL + 1) * LANES + lane] = high


@inlined
def _drop_unwanted(part: int, group: Array) -> None:
    for lane in range(LANES):
        wanted = group[(PARTS + 2 + part) * LANES + lane]
        group[(LEFT + VARIATIONS) * LANES + lane] *= wanted
        group[(LEFT + HARD) * LANES + lane] *= wanted


@inlined
def _append_whole(problem: int, low: float, high: float, block: Block) -> None:
    at = block.counts[N_WHOLE]
    if at == QUEUE:
        block.hard[problem] = 1
        return
    block.whole_problem[at] = problem
    block.whole[0, at] = low
    block.whole[1, at] = high
    block.counts[N_WHOLE] = at + 1


@inlined
def _take_whole(block: Block) -> int:
    """Take intervals and their problems' factors; return their number."""
    work = block.work
    n: int = min(block.counts[N_WHOLE], LANES)
    block.counts[N_WHOLE] -= n
    for lane in range(n):
        at = block.counts[N_WHOLE] + lane
        problem = block.whole_problem[at]
        block.problem[lane] = problem
        work[INTERVAL * LANES + lane] = block.whole[0, at]
        work[(INTERVAL + 1) * LANES + lane] = block.whole[1, at]
        group, place = block.groups[problem // LANES], problem % LANES
        for row in range(FACTORS, PARTS):
            work[row * LANES + lane] = group[row * LANES + place]
    return n


@vectorised_kernel
def _describe_whole(work: Array) -> None:
    """Compute the coefficients from the factors."""
    for lane in range(LANES):
        low, high = work[INTERVAL * LANES + lane], work[(INTERVAL + 1) * LANES + lane]
        c = coefficients(load_factors(work, lane), low, high)
        _put_part(low, high, largest_of(c), c, False, work, LEFT * LANES + lane)


@inlined
def _take_splits(block: Block) -> int:
    """Take intervals to be split; return their number."""
    n: int = min(block.counts[N_SPLITS], LANES)
    block.counts[N_SPLITS] -= n
    first = block.counts[N_SPLITS]
    for lane in range(n):
        problem, at = block.split_problem[first + lane], block.splits[first + lane]
        block.problem[lane] = problem
        block.n_splits[problem] += 1
        block.hard[problem] |= int(block.n_splits[problem] > _MAX_SPLITS)
        part, place = block.pool[at // LANES], at % LANES
        for row in range(INTERVAL_ROWS):
            block.work[(INTERVAL + row) * LANES + lane] = part[row * LANES + place]
    return n


@vectorised_kernel
def _split(work: Array) -> None:
    """Split by de Casteljau's scheme."""
    for lane in range(LANES):
        low, high = work[INTERVAL * LANES + lane], work[(INTERVAL + 1) * LANES + lane]
        size, share = work[(INTERVAL + 2) * LANES + lane], work[(INTERVAL + 3) * LANES + lane]
        left, right = de_casteljau(load_seven(work, (INTERVAL + 4) * LANES + lane), share)
        lost = sign_lost(left, size) or sign_lost(right, size)
        middle = low + (high - low) * share
        _put_part(low, middle, size, left, lost, work, LEFT * LANES + lane)
        _put_part(middle, high, size, right, lost, work, RIGHT * LANES + lane)


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
    work[at + GUESS * LANES] = low + (high - low) * signs.first
    work[at + RISING * LANES] = 1.0 if signs.rising else 0.0
    work[at + VARIATIONS * LANES] = signs.variations
    work[at + HARD * LANES] = 1.0 if hard else 0.0
    work[at + LOST * LANES] = 1.0 if lost else 0.0


@inlined
def _file_parts(n: int, work: Array, first: int, block: Block) -> None:
    """List each part where it belongs: to be split, to be computed again, or a root."""
    at = min(block.counts[N_POOL], POOL - 1)
    block.counts[N_POOL] = at + 1
    copy_row(work[first : first + POOL_ROWS * LANES], block.pool[at])
    n_splits = block.counts[N_SPLITS]
    for lane in range(n):
        problem = block.problem[lane]
        if work[first + LOST * LANES + lane] > 0.0:
            low, high = work[first + lane], work[first + LANES + lane]
            _append_whole(problem, low, high, block)
            continue
        # Written to both lists without a condition, which would be unpredictable, and counted in
        # one of them.
        block.splits[n_splits] = at * LANES + lane
        block.split_problem[n_splits] = problem
        group, place = block.groups[problem // LANES], problem % LANES
        count = group[N_ROOTS * LANES + place]
        root = block.roots[problem // LANES, int(count)]
        root[place] = work[first + lane]
        root[1 * LANES + place] = work[first + LANES + lane]
        root[2 * LANES + place] = work[first + GUESS * LANES + lane]
        root[3 * LANES + place] = work[first + RISING * LANES + lane]
        full = n_splits == QUEUE - LANES or at == POOL - 1 or count >= MAX_SOLUTIONS
        hard = block.hard[problem] | int(work[first + HARD * LANES + lane] > 0.0) | int(full)
        block.hard[problem] = hard
        variations = work[first + VARIATIONS * LANES + lane]
        n_splits += int(variations > 1.0) & (1 - hard)
        group[N_ROOTS * LANES + place] = count + (1.0 if variations == 1.0 and hard == 0 else 0.0)
    block.counts[N_SPLITS] = n_splits


@inlined
def _refine_roots(group: Array, roots: Array) -> None:
    """Refine all roots of a group; sort those with f² > 0."""
    bracket = group[BRACKET * LANES : (BRACKET + 4) * LANES]
    for k in range(MAX_SOLUTIONS):
        if _lanes_above(1.0 * k, N_ROOTS + 0, group) > 0:
            copy_row(roots[k], bracket)
            _start_newton(k, group)
            for _ in range(MAX_NEWTON_STEPS):
                if _newton_steps(group) == 0:
                    break
        _finish_newton(k, group)
        copy_row(
            group[TAU * LANES : (TAU + 1) * LANES],
            group[(SORTED + k) * LANES : (SORTED + k + 1) * LANES],
        )
    _sort(group)


@inlined
def _start_newton(k: int, group: Array) -> None:
    for lane in range(LANES):
        low, high = group[BRACKET * LANES + lane], group[(BRACKET + 1) * LANES + lane]
        group[(BRACKET + 4) * LANES + lane] = high - low
        group[(BRACKET + 5) * LANES + lane] = 0.0
        group[(BRACKET + 6) * LANES + lane] = 1.0 if group[N_ROOTS * LANES + lane] <= k else 0.0


@inlined
def _finish_newton(k: int, group: Array) -> None:
    """Make τ infinite in the lanes without a root, or without f² > 0 there."""
    for lane in range(LANES):
        feasible = k < group[N_ROOTS * LANES + lane] and group[(BRACKET + 5) * LANES + lane] < 0.0
        tau = group[TAU * LANES + lane]
        group[TAU * LANES + lane] = tau if feasible else math.inf


@vectorised_kernel
def _newton_steps(group: Array) -> int:
    """Take one step in each lane that needs one; return how many need another."""
    more = 0
    for lane in range(LANES):
        low, high, tau, rising = load_four(group, BRACKET * LANES + lane)
        before, re, is_done = load_three(group, (BRACKET + 4) * LANES + lane)
        done = is_done > 0.0
        bracket = Bracket(low, high, tau, before, re, done)
        after = newton_step(load_factors(group, lane), rising > 0.0, bracket)
        group[BRACKET * LANES + lane] = low if done else after.low
        group[(BRACKET + 1) * LANES + lane] = high if done else after.high
        group[TAU * LANES + lane] = tau if done else after.tau
        group[(BRACKET + 4) * LANES + lane] = before if done else after.before
        group[(BRACKET + 5) * LANES + lane] = re if done else after.re
        group[(BRACKET + 6) * LANES + lane] = 1.0 if done or after.done else 0.0
        more += 0 if done or after.done else 1
    return more


@vectorised_kernel
def _sort(group: Array) -> None:
    """Sort the values of τ; those without f² > 0 have become infinite."""
    for lane in range(LANES):
        a, b, c, d = load_four(group, SORTED * LANES + lane)
        e, f = group[(SORTED + 4) * LANES + lane], group[(SORTED + 5) * LANES + lane]
        # The network of twelve comparisons.
        a, f, b, d, c, e = min(a, f), max(a, f), min(b, d), max(b, d), min(c, e), max(c, e)
        b, c, d, e = min(b, c), max(b, c), min(d, e), max(d, e)
        a, d, c, f = min(a, d), max(a, d), min(c, f), max(c, f)
        a, b, c, d, e, f = min(a, b), max(a, b), min(c, d), max(c, d), min(e, f), max(e, f)
        b, c, d, e = min(b, c), max(b, c), min(d, e), max(d, e)
        store_four((a, b, c, d), group, SORTED * LANES + lane)
        group[(SORTED + 4) * LANES + lane] = e
        group[(SORTED + 5) * LANES + lane] = f


@inlined
def _solve_group(
    group: Array, n: int, source: Ints, rows: Array, count: Ints, one: Workspace
) -> None:
    """Write the solutions of a group's first n problems, root by root."""
    for k in range(MAX_SOLUTIONS):
        wanted = 0
        for lane in range(LANES):
            tau = group[(SORTED + k) * LANES + lane]
            group[TAU * LANES + lane] = tau
            wanted += 1 if tau < 1.0 else 0
        if wanted == 0:
            break
        _find_poses(group)
        for lane in range(min(n, LANES)):
            if group[VALID * LANES + lane] > 0.0:
                sample = source[lane]
                count[sample] += _write_solution(
                    group, lane, rows[sample, min(count[sample], MAX_SOLUTIONS - 1)], one
                )


@vectorised_kernel
def _find_poses(group: Array) -> None:
    """Find the solution of one root in each lane, scaled and not."""
    for lane in range(LANES):
        image, board = (
            load_points(group, IMAGE * LANES + lane),
            load_points(group, BOARD * LANES + lane),
        )
        tau = group[TAU * LANES + lane]
        has_pose, row = pose_from_root(
            load_factors(group, lane), tau, load_cone(group, lane), image
        )
        public = unscale(row, group[SCALE_PX * LANES + lane], load_frame(group, lane))
        store_four(public[:4], group, FOUND * LANES + lane)
        store_four(public[4:8], group, (FOUND + 4) * LANES + lane)
        store_four(public[8:12], group, (FOUND + 8) * LANES + lane)
        store_four((*public[12:], *row[9:11]), group, (FOUND + 12) * LANES + lane)
        group[(FOUND + 16) * LANES + lane] = row[11]
        group[(FOUND + 17) * LANES + lane] = row[12]
        group[(FOUND + 18) * LANES + lane] = row[13]
        group[VALID * LANES + lane] = 1.0 if has_pose and tau < 1.0 else 0.0
        group[ACCURATE * LANES + lane] = 1.0 if is_accurate(row, image, board) else 0.0


@inlined
def _write_solution(group: Array, lane: int, row: Array, one: Workspace) -> int:
    """Write the solution of a lane, refined if it needs it; return 0 if it is none, else 1."""
    for j in range(ROW_SIZE):
        row[j] = group[(FOUND + j) * LANES + lane]
    if group[ACCURATE * LANES + lane] > 0.0:
        return 1
    for j in range(5):
        row[TRANSLATION + j] = group[(FOUND_SCALED + j) * LANES + lane]
    image, board = (
        load_points(group, IMAGE * LANES + lane),
        load_points(group, BOARD * LANES + lane),
    )
    scale_px, frame = group[SCALE_PX * LANES + lane], load_frame(group, lane)
    return refine(row, image, board, scale_px, frame, one)
