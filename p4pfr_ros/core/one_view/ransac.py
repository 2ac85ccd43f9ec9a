# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""
The robust search: LO-MSAC, in one compiled function.

Draw four points, solve, score by the truncated squared error (MSAC; Torr and Zisserman 2000),
refine each new best model by least squares over the same truncated error (LO; Chum, Matas and
Kittler 2003), and stop when a better sample is unlikely. Samples are drawn without replacement;
nearly collinear ones are drawn again.

A consensus is accepted only if it is more than chance, judged a contrario (Moisan and Stival, IJCV
2004). Suppose that the N image points are uniform in an area A. A model that four of them define
has a given other point within the threshold t with probability α = π t² / A. The expected number
of sets of k inliers, over all sizes, all sets and all fours that may define the model, is

    NFA(k) = (N - 4) C(N, k) C(k, 4) α^(k - 4) = (N - 4) C(N, 4) C(N - 4, k - 4) α^(k - 4).

NFA(4) is more than one, and NFA(k + 1) / NFA(k) = α (N - k) / (k - 3) decreases with k, so the NFA
is below a bound from one k on.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from . import known_camera
from .free_camera import keep_plausible
from .least_squares import (
    count_within,
    least_squares_work,
    LeastSquaresWork,
    minimise,
    plausible,
    POSE,
    Problem,
    truncated_cost,
)
from ..geometry import Array, Ints
from ..jit import jit, part_of_kernel
from ..linalg import copy_row
from ..minimal.block import BLOCK, Block, block_work, LANES, padded, put_sample
from ..minimal.four import chosen_points
from ..minimal.lanes import solve_block
from ..minimal.one import UNFOLDED, Workspace, workspace
from ..minimal.solution import MAX_SOLUTIONS, ROW_SIZE

# A new best hypothesis is refined in few steps, at first with a wide gate: a model of four noisy
# points is far from many of its inliers.
_WIDE = 100.0
_WIDE_STEPS = 3
_LOCAL_STEPS = 6
_LOCAL_TOLERANCE = 1e-3

# A search without an acceptable consensus ends after this multiple of the samples that contain one
# without outliers, since noise spoils some of those too, and not before this many.
_FRUITLESS = 2.0
_FRUITLESS_SAMPLES = 500

# If all points are inliers, with this many degrees of freedom, few samples are enough.
_MANY = 16
_FEW_SAMPLES = 3

# A sample is drawn again if its largest triangle is below this share of the board's squared
# extent, or not larger than the noise in the image.
_SMALLEST_SHARE = 0.01
_REDRAWS = 20

# A triangle with a smaller share of the largest one's area may be turned over by the distortion.
_FLAT_SHARE = 0.1

# Number of samples of four points, each with four triangles, that tell the order of the points. It
# is mirrored if more than this share of the triangles is; outliers turn half of theirs. If fewer
# are, the search finds the inliers, and the pose decides.
_ORDER_SAMPLES = 16
_CLEAR = 0.9

# Largest expected number of sets of inliers by chance.
_MAX_EXPECTED = 1e-3


class Search(NamedTuple):
    """
    The threshold of inliers, and the length of the search.

    limit: the squared threshold, px². fewest: the smallest number of inliers that is accepted; a
    search for fewer does not go on.
    """

    limit: float
    fewest: int
    confidence: float
    min_iterations: int
    max_iterations: int
    seed: int


class RansacWork(NamedTuple):
    """Workspace of the loop, allocated once per call."""

    chosen: Ints
    rows: Array
    local: Array
    solver: Workspace
    refine: LeastSquaresWork


@jit
def ransac_work() -> RansacWork:
    """Allocate the workspace; in compiled code this costs less than passing it as an argument."""
    return RansacWork(
        np.empty(4, dtype=np.int64),
        np.empty((MAX_SOLUTIONS, ROW_SIZE)),
        np.empty(ROW_SIZE),
        workspace(),
        least_squares_work(),
    )


class Samples(NamedTuple):
    """
    Samples drawn ahead, so that the solver takes many at once.

    chosen (BLOCK, 4); number (BLOCK,): how many had been drawn with each; rows (BLOCK, 6,
    ROW_SIZE) and solved (BLOCK,): their hypotheses.
    """

    chosen: Ints
    number: Ints
    rows: Array
    solved: Ints
    block: Block


@part_of_kernel
def _samples() -> Samples:
    return Samples(
        np.empty((BLOCK, 4), dtype=np.int64),
        np.empty(BLOCK, dtype=np.int64),
        np.empty((BLOCK, MAX_SOLUTIONS, ROW_SIZE)),
        np.empty(BLOCK, dtype=np.int64),
        block_work(),
    )


@jit
def search_best(problem: Problem, search: Search, best: Array) -> tuple[int, float]:
    """
    Find the model with the smallest truncated cost; write it to ``best`` (ROW_SIZE,).

    Return the number of samples and the cost in px², which is infinite if none had a solution.
    The result does not depend on how many samples are drawn ahead.
    """
    work, samples = ransac_work(), _samples()
    cost = math.inf
    state = first_state(search.seed)
    smallest = smallest_triangles(problem.board, search.limit)
    n = len(problem.image)
    fruitless = _FRUITLESS * samples_needed(search.fewest, n, search.confidence)
    fruitless = max(fruitless, _FRUITLESS_SAMPLES)
    last = _last_sample(fruitless, search.min_iterations, search)
    number = drawn = waiting = at = 0
    ahead = LANES
    while True:
        if at == waiting:
            if drawn >= last:
                break
            waiting, drawn, state = _draw_ahead(
                problem, smallest, ahead, last, drawn, state, samples
            )
            at, ahead = 0, min(2 * ahead, BLOCK)
            continue
        if samples.number[at] > last:
            break
        number = samples.number[at]
        for s in range(samples.solved[at]):
            row = samples.rows[at, s]
            score = truncated_cost(row, problem, search.limit, cost)
            if not score < cost:
                continue
            copy_row(row, best)
            cost = _local_optimum(score, problem, search.limit, best, work)
            inliers = count_within(best, problem, search.limit)
            at_least = search.min_iterations
            if inliers == n and 2 * inliers >= problem.unknowns + _MANY:
                at_least = min(at_least, _FEW_SAMPLES)
            needed = fruitless
            if inliers >= search.fewest:
                needed = samples_needed(inliers, n, search.confidence)
            last = _last_sample(needed, at_least, search)
        at += 1
    return max(number, last), cost


@part_of_kernel
def _last_sample(needed: float, at_least: int, search: Search) -> int:
    """Return after how many samples the search ends."""
    most = search.max_iterations
    return min(max(math.ceil(min(needed, most)), at_least), most)


@part_of_kernel
def _draw_ahead(
    problem: Problem,
    smallest: tuple[float, float],
    wanted: int,
    last: int,
    drawn: int,
    state: int,
    samples: Samples,
) -> tuple[int, int, int]:
    """
    Draw and solve samples until enough are possible, or the last has been drawn.

    Return how many are possible, how many have been drawn, and the generator's next state.
    """
    n = 0
    while n < wanted and drawn < last:
        drawn += 1
        chosen = samples.chosen[n]
        state = draw_sample(problem.image, problem.board, smallest, state, chosen)
        if problem.unknowns == POSE or not _contradictory(problem.image, problem.board, chosen):
            samples.number[n] = drawn
            n += 1
    if problem.unknowns == POSE:
        for i in range(n):
            board = chosen_points(problem.board, samples.chosen[i])
            rays, row = problem.rays, samples.rows[i, 0]
            samples.solved[i] = known_camera.hypothesis(rays, board, samples.chosen[i], row)
    else:
        _solve(problem, n, samples)
    return n, drawn, state


@part_of_kernel
def _solve(problem: Problem, n: int, samples: Samples) -> None:
    """Write the plausible hypotheses of the first n samples."""
    for at in range(padded(n)):
        chosen = samples.chosen[min(at, n - 1)]
        image, board = chosen_points(problem.image, chosen), chosen_points(problem.board, chosen)
        put_sample(image, board, at, samples.block)
    solve_block(n, UNFOLDED, samples.rows, samples.solved, samples.block)
    for i in range(n):
        samples.solved[i] = keep_plausible(problem.gates, samples.rows[i], samples.solved[i])


@jit
def _local_optimum(
    cost: float, problem: Problem, limit: float, best: Array, work: RansacWork
) -> float:
    """Refine ``best`` in place if that lowers its cost; return the cost."""
    local = work.local
    copy_row(best, local)
    minimise(local, problem, _WIDE * limit, _WIDE_STEPS, _LOCAL_TOLERANCE, work.refine)
    lower = minimise(local, problem, limit, _LOCAL_STEPS, _LOCAL_TOLERANCE, work.refine)
    if lower < cost and plausible(local, problem):
        copy_row(local, best)
        return lower
    return cost


@jit
def first_state(seed: int) -> int:
    """Return the first state of the random generator: 32 bits, not zero."""
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
    """Return twice the minimum area of a sample's largest triangle, in image (px²) and board."""
    width = height = 0.0
    for i in range(len(board)):
        width = max(width, abs(board[i, 0]))
        height = max(height, abs(board[i, 1]))
    # In the image: the square of twice the threshold of inliers.
    return 4.0 * limit, _SMALLEST_SHARE * (width * width + height * height)


@jit
def samples_needed(inliers: int, points: int, confidence: float) -> float:
    """Return how many samples contain one without outliers, with this confidence."""
    # Without replacement: for few points this is less than the fourth power of the inlier ratio.
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
    present = False
    for i in range(count):
        present = present or chosen[i] == index
    return present


@jit
def _contradictory(image: Array, board: Array, chosen: Ints) -> bool:
    """
    Return whether no camera sees these board points in this arrangement.

    A plane's triangles are all seen clockwise as they are on the board, or all turned over. The
    solver would find that too, but in many times the time.
    """
    same = turned = False
    flat_image = _FLAT_SHARE * _largest_triangle(image, chosen)
    flat_board = _FLAT_SHARE * _largest_triangle(board, chosen)
    for left_out in range(4):
        a = _triangle(image, chosen, left_out)
        b = _triangle(board, chosen, left_out)
        if abs(a) > flat_image and abs(b) > flat_board:
            same = same or a * b > 0.0
            turned = turned or a * b < 0.0
    return same and turned


@jit
def _largest_triangle(points: Array, chosen: Ints) -> float:
    """Return twice the area of the largest of the four triangles of four points."""
    largest = 0.0
    for left_out in range(4):
        largest = max(largest, abs(_triangle(points, chosen, left_out)))
    return largest


@jit
def _triangle(points: Array, chosen: Ints, left_out: int) -> float:
    """Return twice the signed area of the triangle of three of four points."""
    a, b, c = chosen[(left_out + 1) % 4], chosen[(left_out + 2) % 4], chosen[(left_out + 3) % 4]
    return _signed_area(points, a, b, c)


@jit
def is_mirrored(image: Array, board: Array, limit: float) -> bool:
    """
    Return whether the points are clearly in a mirrored order, as the back of the board has them.

    image (N, 2) px, y down; board (N, 2), y up; limit: the squared threshold of inliers, px².
    """
    smallest = smallest_triangles(board, limit)
    state = first_state(0)
    chosen = np.empty(4, dtype=np.int64)
    mirrored = total = 0
    for _ in range(1 if len(image) == 4 else _ORDER_SAMPLES):
        state = draw_sample(image, board, smallest, state, chosen)
        for i in range(4):
            a, b, c = chosen[i], chosen[(i + 1) % 4], chosen[(i + 2) % 4]
            in_image, on_board = _signed_area(image, a, b, c), _signed_area(board, a, b, c)
            # Noise may turn a smaller triangle.
            if abs(in_image) > smallest[0] and abs(on_board) > smallest[1]:
                total += 1
                mirrored += 1 if (in_image > 0.0) == (on_board > 0.0) else 0
    return mirrored > _CLEAR * total


@jit
def _signed_area(points: Array, a: int, b: int, c: int) -> float:
    """Return twice the signed area of a triangle."""
    area: float = (points[b, 0] - points[a, 0]) * (points[c, 1] - points[a, 1]) - (
        points[b, 1] - points[a, 1]
    ) * (points[c, 0] - points[a, 0])
    return area


@jit
def fewest_inliers(image: Array, threshold_px: float, max_area: float, at_least: int) -> int:
    """
    Return the smallest number of inliers that is accepted; all points together always are.

    image (N, 2) px; max_area: the image's area, px², which the points' bounding box is limited
    to; at_least: the minimum for other reasons.
    """
    n = len(image)
    alpha = math.pi * threshold_px * threshold_px / _bounding_area(image, threshold_px, max_area)
    k = min(max(at_least, 4), n)
    # The logarithm of the NFA, with m! = Γ(m + 1) and C(N, 4) C(N - 4, k - 4) in one.
    log_expected = math.log(max(n - 4, 1)) + math.lgamma(n + 1.0) - math.log(24.0)
    log_expected -= math.lgamma(k - 3.0) + math.lgamma(n - k + 1.0)
    log_expected += (k - 4) * math.log(alpha)
    while k < n and log_expected > math.log(_MAX_EXPECTED):
        log_expected += math.log(alpha * (n - k) / (k - 3.0))
        k += 1
    return k


@jit
def _bounding_area(image: Array, threshold_px: float, max_area: float) -> float:
    """Return the area of the points' bounding box, px², at least that of a square of 2 t."""
    low_x = high_x = image[0, 0]
    low_y = high_y = image[0, 1]
    for i in range(1, len(image)):
        low_x = min(low_x, image[i, 0])
        high_x = max(high_x, image[i, 0])
        low_y = min(low_y, image[i, 1])
        high_y = max(high_y, image[i, 1])
    smallest = 4.0 * threshold_px * threshold_px
    area: float = max(min((high_x - low_x) * (high_y - low_y), max_area), smallest)
    return area
