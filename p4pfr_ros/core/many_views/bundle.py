# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""
Many views of one camera: the squared reprojection errors, and their normal equations.

A pose belongs to a view and the lens to all, so JᵀJ is an arrow: a 6x6 block for each pose, a
border of six columns for the lens. Each view's part of it is kept as one (13, 13) block, with
Jᵀr in the last column; the work is linear in the number of points.
"""

from __future__ import annotations

import math
from typing import NamedTuple

from ..geometry import Array, Ints
from ..jit import jit, kernel
from ..model.lens import COLUMNS, linearise, RESIDUAL, squared_error


class Bundle(NamedTuple):
    """
    The points of all views, one after the other.

    image (M, 2) px from the middle of the picture, board (M, 2), and starts (V + 1,): view v has
    the points from starts[v] to starts[v + 1].
    """

    image: Array
    board: Array
    starts: Ints


@kernel
def view_cost(bundle: Bundle, v: int, pose: Array, lens: Array, limit: float) -> float:
    """Sum a view's squared errors, each cut off at limit, px²."""
    image, board = bundle.image, bundle.board
    total = 0.0
    for i in range(bundle.starts[v], bundle.starts[v + 1]):
        error = squared_error(pose, lens, board[i, 0], board[i, 1], image[i, 0], image[i, 1])
        total += min(error, limit)
    return total


@kernel
def view_block(
    bundle: Bundle, v: int, pose: Array, lens: Array, limit: float, jacobian: Array, block: Array
) -> int:
    """Write JᵀJ and Jᵀr of the view's points within the limit; return their number."""
    image, board = bundle.image, bundle.board
    for a in range(COLUMNS):
        for b in range(COLUMNS):
            block[a, b] = 0.0
    count = 0
    for i in range(bundle.starts[v], bundle.starts[v + 1]):
        linearise(pose, lens, board[i, 0], board[i, 1], image[i, 0], image[i, 1], jacobian)
        first, second = jacobian[0, RESIDUAL], jacobian[1, RESIDUAL]
        # Written so that NaN is outside.
        if not first * first + second * second < limit:
            continue
        count += 1
        for a in range(COLUMNS):
            for b in range(a, COLUMNS):
                block[a, b] += jacobian[0, a] * jacobian[0, b] + jacobian[1, a] * jacobian[1, b]
    for a in range(COLUMNS):
        for b in range(a):
            block[a, b] = block[b, a]
    return count


@jit
def squared_errors(bundle: Bundle, poses: Array, lens: Array, squares: Array) -> None:
    """Write all the squared errors (M,), px²; infinite where a point is not seen."""
    for v in range(len(poses)):
        for i in range(bundle.starts[v], bundle.starts[v + 1]):
            x, y = bundle.board[i, 0], bundle.board[i, 1]
            squares[i] = squared_error(
                poses[v], lens, x, y, bundle.image[i, 0], bundle.image[i, 1]
            )


@jit
def truncated_cost(
    bundle: Bundle, poses: Array, lens: Array, limit: float, enough: float
) -> float:
    """Sum the squared errors of all views, each cut off at limit; stop beyond enough."""
    total = 0.0
    for v in range(len(poses)):
        total += view_cost(bundle, v, poses[v], lens, limit)
        if not total <= enough:
            return math.inf
    return total
