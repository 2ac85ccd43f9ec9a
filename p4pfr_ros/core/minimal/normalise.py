# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""To well-scaled numbers and back: a board in mm, in km or far from its origin is the same."""

from __future__ import annotations

import math

from .solution import G, H, TRANSLATION
from ..geometry import Array
from ..jit import kernel


@kernel
def scale_image(image: Array, scaled: Array, radius: Array) -> float:
    """Scale the farthest point to radius 1; write the radii (4,); return the scale, px."""
    farthest2 = 0.0
    for i in range(4):
        radius[i] = image[i, 0] * image[i, 0] + image[i, 1] * image[i, 1]
        farthest2 = max(farthest2, radius[i])
    if not 0.0 < farthest2 < math.inf:
        return 0.0
    scale_px = math.sqrt(farthest2)
    inverse = 1.0 / scale_px
    for i in range(4):
        scaled[i, 0] = image[i, 0] * inverse
        scaled[i, 1] = image[i, 1] * inverse
        radius[i] = math.sqrt(radius[i]) * inverse
    return scale_px


@kernel
def board_duals(board: Array, scaled: Array, duals: Array) -> float:
    """
    Centre the board and scale it to about 1, and find the vectors that take it apart.

    With the centred points X̂ᵢ, cᵢ = (Σ X̂ X̂ᵀ)⁻¹ X̂ᵢ has Σ cᵢ = 0 and Σ X̂ᵢ cᵢᵀ = I: for any affine
    map of the board, Qᵢ = H X̂ᵢ + t, the sum Σ Qᵢ cᵢᵀ is H. Returned is the scale, board units.
    """
    mx, my = _mean_from_first(board)
    size = 0.0
    for i in range(4):
        # Far from its origin a board's mean is rounded, but differences of its points are not.
        scaled[i, 0] = (board[i, 0] - board[0, 0]) - mx
        scaled[i, 1] = (board[i, 1] - board[0, 1]) - my
        size = max(size, max(abs(scaled[i, 0]), abs(scaled[i, 1])))
    inverse = 1.0 / size
    xx = xy = yy = 0.0
    for i in range(4):
        scaled[i, 0] *= inverse
        scaled[i, 1] *= inverse
        xx += scaled[i, 0] * scaled[i, 0]
        xy += scaled[i, 0] * scaled[i, 1]
        yy += scaled[i, 1] * scaled[i, 1]
    determinant = xx * yy - xy * xy
    for i in range(4):
        duals[i, 0] = (yy * scaled[i, 0] - xy * scaled[i, 1]) / determinant
        duals[i, 1] = (xx * scaled[i, 1] - xy * scaled[i, 0]) / determinant
    return size


@kernel
def _mean_from_first(board: Array) -> tuple[float, float]:
    x, y = board[0, 0], board[0, 1]
    return (
        0.25 * ((board[1, 0] - x) + (board[2, 0] - x) + (board[3, 0] - x)),
        0.25 * ((board[1, 1] - y) + (board[2, 1] - y) + (board[3, 1] - y)),
    )


@kernel
def unscale(row: Array, board: Array, scale_px: float, size: float) -> None:
    """Take a solution from the scaled, centred problem to pixels and the board's own frame."""
    row[G] *= scale_px
    row[H] /= scale_px
    mx, my = _mean_from_first(board)
    mx += board[0, 0]
    my += board[0, 1]
    for i in range(3):
        t = row[TRANSLATION + i] * size
        row[TRANSLATION + i] = t - row[3 * i] * mx - row[3 * i + 1] * my
