# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""
The possible depths of the four points: the cone of λ > 0.

The projection λᵢ (xᵢ, yᵢ, 1 + k rᵢ²) = P (Xᵢ, Yᵢ, 1) is linear in P, and four points of a plane
obey Σ mᵢ (Xᵢ, Yᵢ, 1) = 0 with weights m that depend on the board alone. This eliminates the pose:

    Σ mᵢ λᵢ (xᵢ, yᵢ, 1 + k rᵢ²) = 0.

Its first two rows do not contain k: with vᵢ = mᵢ (xᵢ, yᵢ) they are Σ λᵢ vᵢ = 0, two equations in
four depths. Their non-negative solutions are a cone with two extreme rays a and b, and every
physical solution is λ = (1 - τ) a + τ b with 0 < τ < 1. Without a cone there is no solution.
"""

from __future__ import annotations

from ..geometry import Array
from ..jit import kernel

# The rounding error of a product whose true value is zero, relative to the sizes of its factors.
# The image points are differences (pixel minus centre): each has an error of ε times the image's
# size, not its own, and 1e-14 is some fifty times that.
_ROUNDING = 1e-14

# Rays closer than this (sum of absolute differences; each ray sums to 1) enclose no cone.
_MIN_OPENING = 1e-12


@kernel
def depth_cone(image: Array, radius: Array, m: Array, plane: Array, rays: Array) -> bool:
    """
    Find the extreme rays of {λ ≥ 0, Σ λᵢ mᵢ (xᵢ, yᵢ) = 0}; return False if there is no cone.

    image (4, 2) is scaled so that the farthest point has radius 1; ``plane`` (4, 4) is workspace,
    and a and b, each summing to 1, are written to ``rays`` (2, 4).
    """
    # All λ with Σ λᵢ vᵢ = 0 lie in a plane of R⁴. Its Plücker coordinates are the six cross
    # products of the v, and row l of the antisymmetric matrix of their duals,
    #     plane[l, k] = ± vᵢ × vⱼ,   {i, j, k, l} = {0, 1, 2, 3},
    # is the vector of that plane whose entry l is zero: Cramer's rule on the other three. A ray
    # of the cone is a row whose entries have one sign.
    _set_pair(plane, 2, 3, m[0] * m[1] * _cross(image, radius, 0, 1))
    _set_pair(plane, 3, 1, m[0] * m[2] * _cross(image, radius, 0, 2))
    _set_pair(plane, 1, 2, m[0] * m[3] * _cross(image, radius, 0, 3))
    _set_pair(plane, 0, 3, m[1] * m[2] * _cross(image, radius, 1, 2))
    _set_pair(plane, 2, 0, m[1] * m[3] * _cross(image, radius, 1, 3))
    _set_pair(plane, 0, 1, m[2] * m[3] * _cross(image, radius, 2, 3))
    count = 0
    opening = _MIN_OPENING
    for l in range(4):  # noqa: E741
        low = high = total = 0.0
        for k in range(4):
            if k != l:
                low = min(low, plane[l, k])
                high = max(high, plane[l, k])
                total += plane[l, k]
        if low * high < 0.0 or total == 0.0:
            continue
        distance = 0.0
        for k in range(4):
            plane[l, k] = plane[l, k] / total if k != l else 0.0
            if count > 0:
                distance += abs(plane[l, k] - rays[0, k])
        # With a point at the centre, or three collinear board points, three of the rows are the
        # same ray; take the pair with the largest distance.
        if count == 0 or distance > opening:
            which = 0 if count == 0 else 1
            opening = opening if count == 0 else distance
            count += 1
            for k in range(4):
                rays[which, k] = plane[l, k]
    return count >= 2


@kernel
def board_weights(board: Array, m: Array) -> bool:
    """
    Write m (4,) with Σ mᵢ = 0, Σ mᵢ (Xᵢ, Yᵢ) = 0, the largest ±1; False for collinear points.

    mᵢ is, with alternating sign, the area of the triangle of the other three points.
    """
    x1, y1 = board[1, 0] - board[0, 0], board[1, 1] - board[0, 1]
    x2, y2 = board[2, 0] - board[0, 0], board[2, 1] - board[0, 1]
    x3, y3 = board[3, 0] - board[0, 0], board[3, 1] - board[0, 1]
    m[0] = (x2 - x1) * (y3 - y1) - (y2 - y1) * (x3 - x1)
    m[1] = y2 * x3 - x2 * y3
    m[2] = x1 * y3 - y1 * x3
    m[3] = y1 * x2 - x1 * y2
    largest = max(max(abs(m[0]), abs(m[1])), max(abs(m[2]), abs(m[3])))
    # With three collinear points the fourth has zero weight, and rounding must not give it a sign:
    # the computed area is the rounding error of the coordinates times a length.
    length = max(max(abs(x1), abs(y1)), max(max(abs(x2), abs(y2)), max(abs(x3), abs(y3))))
    rounding = _ROUNDING * length * (length + max(abs(board[0, 0]), abs(board[0, 1])))
    if not largest > rounding:
        return False
    inverse = 1.0 / largest
    for i in range(4):
        m[i] = m[i] * inverse if abs(m[i]) > rounding else 0.0
    return True


@kernel
def _set_pair(plane: Array, row: int, column: int, value: float) -> None:
    plane[row, column] = value
    plane[column, row] = -value


@kernel
def _cross(image: Array, radius: Array, i: int, j: int) -> float:
    """Return the cross product; exactly zero if it is rounding (points on one ray, centre)."""
    value: float = image[i, 0] * image[j, 1] - image[i, 1] * image[j, 0]
    return value if abs(value) > _ROUNDING * (radius[i] + radius[j]) else 0.0
