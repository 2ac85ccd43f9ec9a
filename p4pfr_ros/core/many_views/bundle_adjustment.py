# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""Bundle adjustment: Levenberg-Marquardt over one lens and the poses of all views."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from .bundle import Bundle, truncated_cost, view_block
from .schur import pose_step, reduce_view
from ..geometry import Array
from ..jit import jit
from ..linalg import rotate, solve_in_place
from ..minimal.solution import TRANSLATION
from ..model.lens import COLUMNS, FOCAL, K, LENS_SIZE, POSE_COLUMNS

# Numbers of a pose: the rotation row by row, then the translation.
POSE_SIZE = 12

_FIRST_DAMPING = 1e-6
_SMALLEST_DAMPING = 1e-12
_LARGEST_DAMPING = 1e8


class LensPrior(NamedTuple):
    """What is known of the lens beforehand: mean (6,), and information (6, 6) in 1 / px²."""

    mean: Array
    information: Array


class AdjustRoom(NamedTuple):
    """
    Room to work in, for V views.

    blocks (V, 13, 13): JᵀJ and Jᵀr of each view; solved (V, 6, 13): its pose by the lens.
    """

    blocks: Array
    solved: Array
    poses: Array
    lens: Array
    reduced: Array
    system: Array
    jacobian: Array
    lens_step: Array
    step: Array


def adjust_room(views: int) -> AdjustRoom:
    """Make the room for so many views."""
    return AdjustRoom(
        np.empty((views, COLUMNS, COLUMNS)),
        np.empty((views, POSE_COLUMNS, COLUMNS)),
        np.empty((views, POSE_SIZE)),
        np.empty(LENS_SIZE),
        np.empty((LENS_SIZE, LENS_SIZE + 1)),
        np.empty((LENS_SIZE, LENS_SIZE + 1)),
        np.empty((2, COLUMNS)),
        np.empty(LENS_SIZE),
        np.empty(POSE_COLUMNS),
    )


@jit
def adjust(
    bundle: Bundle,
    poses: Array,
    lens: Array,
    order: int,
    prior: LensPrior,
    limit: float,
    max_steps: int,
    tolerance: float,
    room: AdjustRoom,
) -> float:
    """
    Lower the truncated cost from poses (V, 12) and lens (6,) on, in place; return it, px².

    order: how many of k, k2, k3 are free. The prior's information is weighed by the noise's
    variance, so that its squares are in px² too. The blocks of the last linearisation stay in
    the room, at the answer within the tolerance.
    """
    cost = _cost(bundle, poses, lens, prior, limit, math.inf)
    damping = _FIRST_DAMPING
    moved = True
    for _ in range(max_steps):
        if moved:
            fill_blocks(bundle, poses, lens, limit, room)
        moved = False
        lower = math.inf
        if _step(poses, lens, order, prior, damping, room):
            lower = _cost(bundle, room.poses, room.lens, prior, limit, cost)
        if lower < cost:
            gain = cost - lower
            poses[:] = room.poses
            lens[:] = room.lens
            moved = True
            cost = lower
            damping = max(0.1 * damping, _SMALLEST_DAMPING)
            if gain <= tolerance * cost:
                break
        else:
            damping *= 10.0
            if damping > _LARGEST_DAMPING:
                break
    return cost


@jit
def fill_blocks(bundle: Bundle, poses: Array, lens: Array, limit: float, room: AdjustRoom) -> int:
    """Write each view's normal equations to the room; return how many points are in them."""
    count = 0
    for v in range(len(poses)):
        count += view_block(bundle, v, poses[v], lens, limit, room.jacobian, room.blocks[v])
    return count


@jit
def _cost(
    bundle: Bundle, poses: Array, lens: Array, prior: LensPrior, limit: float, enough: float
) -> float:
    beforehand = 0.0
    for a in range(LENS_SIZE):
        for b in range(LENS_SIZE):
            away = (lens[a] - prior.mean[a]) * (lens[b] - prior.mean[b])
            beforehand += prior.information[a, b] * away
    return beforehand + truncated_cost(bundle, poses, lens, limit, enough - beforehand)


@jit
def lens_equations(
    views: int, lens: Array, prior: LensPrior, damping: float, room: AdjustRoom
) -> bool:
    """Write the (6, 7) equations of the lens alone to room.reduced; False where a pose is open."""
    reduced = room.reduced
    for a in range(LENS_SIZE):
        pull = 0.0
        for b in range(LENS_SIZE):
            reduced[a, b] = prior.information[a, b]
            pull -= prior.information[a, b] * (lens[b] - prior.mean[b])
        reduced[a, LENS_SIZE] = pull
    known = True
    for v in range(views):
        known = known and reduce_view(room.blocks[v], damping, room.solved[v], reduced)
    return known


@jit
def _step(
    poses: Array, lens: Array, order: int, prior: LensPrior, damping: float, room: AdjustRoom
) -> bool:
    """Write lens and poses after one damped step to the room; False where there is none."""
    if not lens_equations(len(poses), lens, prior, damping, room):
        return False
    free = K + order
    for a in range(free):
        for b in range(free):
            room.system[a, b] = room.reduced[a, b]
        room.system[a, a] *= 1.0 + damping
        room.system[a, free] = room.reduced[a, LENS_SIZE]
    if not solve_in_place(room.system, free):
        return False
    for a in range(LENS_SIZE):
        room.lens_step[a] = room.system[a, free] if a < free else 0.0
        room.lens[a] = lens[a] + room.lens_step[a]
    for v in range(len(poses)):
        step = room.step
        pose_step(room.solved[v], room.lens_step, step)
        rotate(poses[v], step[0], step[1], step[2], room.poses[v])
        for i in range(3):
            room.poses[v, TRANSLATION + i] = poses[v, TRANSLATION + i] + step[3 + i]
    return bool(room.lens[FOCAL] > 0.0)


@jit
def view_equations(views: int, room: AdjustRoom, told: Array) -> None:
    """Write what each view tells of the lens, its pose not known: equations (V, 6, 7)."""
    for v in range(views):
        told[v] = 0.0
        reduce_view(room.blocks[v], 0.0, room.solved[v], told[v])
