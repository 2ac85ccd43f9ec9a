# SPDX-License-Identifier: Apache-2.0
"""
The robust loop: LO-MSAC over minimal samples, in one compiled function.

Sample four points, solve, gate by what cameras are, score by the truncated squared reprojection
error in raw pixels (MSAC, Torr and Zisserman 2000), and refine each new best by least squares
over the same truncated error (the LO of Chum, Matas and Kittler 2003).
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from .geometry import Array, Ints
from .jit import jit
from .minimal import solve_minimal, Workspace, workspace
from .refine import levenberg_marquardt, refine_room, RefineRoom, truncated_cost, UNKNOWNS
from .sextic import MAX_ROOTS
from .solution import G, H, ROW_SIZE

# A new best hypothesis is refined in few steps, at first with a wide gate: four noisy points
# leave a model that misses many of its inliers.
_WIDE = 9.0
_WIDE_STEPS = 3
_LOCAL_STEPS = 6
_LOCAL_TOLERANCE = 1e-3
_LAST_STEPS = 100
_LAST_TOLERANCE = 1e-13

# A sample whose largest triangle is below this share of the board's own square extent, or is
# hardly larger in the image than the noise, is drawn again.
_SMALLEST_SHARE = 0.01
_REDRAWS = 20


class Gates(NamedTuple):
    """What a camera must be: tangents of half the field of view, and the distortion's size."""

    corner_px: float
    min_half_fov_rad: float
    max_half_fov_rad: float
    max_distortion: float


class Search(NamedTuple):
    """How long to look, and how far from a model a point may be."""

    limit: float  # px², the square of the inliers' threshold
    confidence: float
    min_iterations: int
    max_iterations: int
    seed: int


class RansacRoom(NamedTuple):
    """Room for the loop, made once."""

    chosen: Ints
    image: Array
    board: Array
    rows: Array
    local: Array
    solver: Workspace
    refine: RefineRoom


def ransac_room() -> RansacRoom:
    """Make the room that ``search_pose`` works in."""
    return RansacRoom(
        np.empty(4, dtype=np.int64),
        np.empty((4, 2)),
        np.empty((4, 2)),
        np.empty((MAX_ROOTS, ROW_SIZE)),
        np.empty(ROW_SIZE),
        workspace(),
        refine_room(),
    )


@jit
def search_pose(
    image: Array, board: Array, gates: Gates, search: Search, best: Array, room: RansacRoom
) -> tuple[int, float]:
    """
    Find the model of least truncated cost; write it to ``best`` (ROW_SIZE,).

    image (N, 2) px from the centre, board (N, 2) centred. Returned are the number of samples and
    the cost in px², infinite where no sample had an acceptable solution.
    """
    n = len(image)
    cost = math.inf
    state = 2463534242 ^ (search.seed & 0x7FFFFFFF)
    smallest = _smallest_triangles(image, board, search.limit)
    needed = float(search.max_iterations)
    iteration = 0
    while iteration < search.max_iterations:
        if iteration >= search.min_iterations and iteration >= needed:
            break
        iteration += 1
        state = _draw_sample(image, board, smallest, state, room)
        for s in range(solve_minimal(room.image, room.board, room.rows, room.solver)):
            row = room.rows[s]
            if not plausible(row, gates):
                continue
            score = truncated_cost(row, image, board, search.limit, cost)
            if not score < cost:
                continue
            best[:] = row
            cost = _local_optimum(row, score, image, board, gates, search.limit, best, room)
            needed = _samples_needed(_share_inside(cost, search.limit, n), search.confidence)
    if cost < math.inf:
        room.local[:] = best
        lower = levenberg_marquardt(
            room.local, image, board, search.limit, UNKNOWNS, _LAST_STEPS, _LAST_TOLERANCE,
            room.refine,
        )  # fmt: skip
        if lower <= cost and plausible(room.local, gates):
            best[:] = room.local
            cost = lower
    return iteration, cost


@jit
def plausible(row: Array, gates: Gates) -> bool:
    """Say whether a solution's camera is one that is built: field of view and distortion."""
    # The corner's ray is (r, g + h r²).
    bend = row[H] * gates.corner_px * gates.corner_px
    half_fov_rad = math.atan2(gates.corner_px, row[G] + bend)
    return (
        gates.min_half_fov_rad <= half_fov_rad <= gates.max_half_fov_rad
        and abs(bend) <= gates.max_distortion * row[G]
    )


@jit
def _local_optimum(
    row: Array,
    score: float,
    image: Array,
    board: Array,
    gates: Gates,
    limit: float,
    best: Array,
    room: RansacRoom,
) -> float:
    """Refine a hypothesis; write it to ``best`` where that lowered its cost. Return the cost."""
    room.local[:] = row
    levenberg_marquardt(
        room.local, image, board, _WIDE * limit, UNKNOWNS, _WIDE_STEPS, _LOCAL_TOLERANCE,
        room.refine,
    )  # fmt: skip
    lower = levenberg_marquardt(
        room.local, image, board, limit, UNKNOWNS, _LOCAL_STEPS, _LOCAL_TOLERANCE, room.refine
    )
    if lower < score and plausible(room.local, gates):
        best[:] = room.local
        return lower
    return score


@jit
def _share_inside(cost: float, limit: float, n: int) -> float:
    """Bound the share of inliers from below: each point outside costs the whole limit."""
    return max(0.0, 1.0 - cost / (limit * n))


@jit
def _samples_needed(share: float, confidence: float) -> float:
    """Return how many samples hold, with that confidence, one of inliers only."""
    all_inside = share**4
    if all_inside >= 1.0:
        return 0.0
    if all_inside <= 1e-12:
        return math.inf
    return math.log(1.0 - confidence) / math.log(1.0 - all_inside)


@jit
def _smallest_triangles(image: Array, board: Array, limit: float) -> tuple[float, float]:
    """Return twice the area that a sample's largest triangle must have: image px², board."""
    width = height = 0.0
    for i in range(len(board)):
        width = max(width, abs(board[i, 0]))
        height = max(height, abs(board[i, 1]))
    # At the threshold for inliers, noise and size would be the same.
    return 4.0 * limit, _SMALLEST_SHARE * (width * width + height * height)


@jit
def _draw_sample(
    image: Array,
    board: Array,
    smallest: tuple[float, float],
    state: int,
    room: RansacRoom,
) -> int:
    """Copy four different points to the room's sample; return the generator's next state."""
    n = len(image)
    for _ in range(_REDRAWS):
        for i in range(4):
            state, chosen = _next_index(state, n)
            while _among(chosen, room.chosen, i):
                state, chosen = _next_index(state, n)
            room.chosen[i] = chosen
            room.image[i, 0], room.image[i, 1] = image[chosen, 0], image[chosen, 1]
            room.board[i, 0], room.board[i, 1] = board[chosen, 0], board[chosen, 1]
        if (
            _largest_triangle(room.image) > smallest[0]
            and _largest_triangle(room.board) > smallest[1]
        ):
            break
    return state


@jit
def _among(index: int, chosen: Ints, count: int) -> bool:
    found = False
    for i in range(count):
        found = found or chosen[i] == index
    return found


@jit
def _next_index(state: int, n: int) -> tuple[int, int]:
    """Draw from 0 … n - 1 by Marsaglia's xorshift32: the same compiled and interpreted."""
    state ^= (state << 13) & 0xFFFFFFFF
    state ^= state >> 17
    state ^= (state << 5) & 0xFFFFFFFF
    return state, state % n


@jit
def _largest_triangle(points: Array) -> float:
    """Return twice the area of the largest of the four triangles of four points."""
    largest = 0.0
    for left_out in range(4):
        a, b, c = (left_out + 1) % 4, (left_out + 2) % 4, (left_out + 3) % 4
        area = (points[b, 0] - points[a, 0]) * (points[c, 1] - points[a, 1]) - (
            points[b, 1] - points[a, 1]
        ) * (points[c, 0] - points[a, 0])
        largest = max(largest, abs(area))
    return largest


@jit
def all_minimal(image: Array, board: Array, gates: Gates, rows: Array, room: RansacRoom) -> int:
    """Write the plausible solutions of exactly four points to ``rows``; return their number."""
    kept = 0
    for s in range(solve_minimal(image, board, room.rows, room.solver)):
        if plausible(room.rows[s], gates):
            rows[kept] = room.rows[s]
            kept += 1
    return kept
