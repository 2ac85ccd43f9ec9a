# SPDX-License-Identifier: Apache-2.0
"""
Four depths, seen before anything else: the cone of λ > 0.

The projection λᵢ (xᵢ, yᵢ, 1 + k rᵢ²) = P (Xᵢ, Yᵢ, 1) is linear in P, and four points of a plane
obey Σ mᵢ (Xᵢ, Yᵢ, 1) = 0 with weights m that the board alone fixes. So the pose drops out:

    Σ mᵢ λᵢ (xᵢ, yᵢ, 1 + k rᵢ²) = 0.

Its first two rows do not hold k: with vᵢ = mᵢ (xᵢ, yᵢ) they are Σ λᵢ vᵢ = 0, two equations in
four depths. Their non-negative solutions are a cone with two extreme rays a and b, and every
physical solution is λ = (1 - τ) a + τ b with 0 < τ < 1. No cone: no solution, at little cost.
"""

from __future__ import annotations

import math
from typing import NamedTuple

from .geometry import Array
from .jit import jit

Four = tuple[float, float, float, float]

# What rounding leaves of a product whose true value is zero, as a multiple of the sizes of its
# factors. The image points are differences (pixel minus centre): each carries an error of ε
# times the image's size, not of its own, and 1e-14 is some fifty times that.
_ROUNDING = 1e-14

# Rays closer than this (in the sum of absolute differences; each ray sums to 1) leave no inside.
_MIN_OPENING = 1e-12


class Cone(NamedTuple):
    """The two extreme rays, each summing to 1, and the weights m. Empty: found is False."""

    found: bool
    a: Four
    b: Four
    m: Four


@jit
def depth_cone(x: Four, y: Four, weights: Four) -> Cone:
    """
    Find the extreme rays of {λ ≥ 0, Σ λᵢ mᵢ (xᵢ, yᵢ) = 0}.

    x and y are four tuples, image points scaled so that the farthest has radius 1.
    """
    m0, m1, m2, m3 = weights
    # All λ with Σ λᵢ vᵢ = 0 lie in a plane of R⁴. Its Plücker coordinates are the six cross
    # products of the v, and column l of the antisymmetric matrix P of their duals,
    #     P[k, l] = ± vᵢ × vⱼ,   {i, j, k, l} = {0, 1, 2, 3},
    # is the vector of that plane whose entry l is zero: Cramer's rule on the other three. A ray
    # of the cone is a column whose entries have one sign.
    p23 = m0 * m1 * _cross(x[0], y[0], x[1], y[1])
    p13 = -m0 * m2 * _cross(x[0], y[0], x[2], y[2])
    p12 = m0 * m3 * _cross(x[0], y[0], x[3], y[3])
    p03 = m1 * m2 * _cross(x[1], y[1], x[2], y[2])
    p02 = -m1 * m3 * _cross(x[1], y[1], x[3], y[3])
    p01 = m2 * m3 * _cross(x[2], y[2], x[3], y[3])

    columns = (
        (0.0, -p01, -p02, -p03),
        (p01, 0.0, -p12, -p13),
        (p02, p12, 0.0, -p23),
        (p03, p13, p23, 0.0),
    )
    found = 0
    a = b = columns[0]
    opening = _MIN_OPENING
    for column in columns:
        total = column[0] + column[1] + column[2] + column[3]
        low = min(min(column[0], column[1]), min(column[2], column[3]))
        high = max(max(column[0], column[1]), max(column[2], column[3]))
        if low * high < 0.0 or total == 0.0:
            continue
        ray = (column[0] / total, column[1] / total, column[2] / total, column[3] / total)
        if found == 0:
            a = ray
            found = 1
            continue
        # With a point at the centre, or three of the board on a line, three of the columns are
        # one ray; take the pair that stands furthest apart.
        apart = abs(ray[0] - a[0]) + abs(ray[1] - a[1]) + abs(ray[2] - a[2]) + abs(ray[3] - a[3])
        if apart > opening:
            b = ray
            opening = apart
            found = 2
    return Cone(found == 2, a, b, weights)


@jit
def board_weights(board: Array) -> Four:
    """
    Return m with Σ mᵢ = 0 and Σ mᵢ (Xᵢ, Yᵢ) = 0, the largest 1; all zero for points on a line.

    mᵢ is, with alternating sign, the area of the triangle of the other three points.
    """
    x1, y1 = board[1, 0] - board[0, 0], board[1, 1] - board[0, 1]
    x2, y2 = board[2, 0] - board[0, 0], board[2, 1] - board[0, 1]
    x3, y3 = board[3, 0] - board[0, 0], board[3, 1] - board[0, 1]
    m0 = (x2 - x1) * (y3 - y1) - (y2 - y1) * (x3 - x1)
    m1 = y2 * x3 - x2 * y3
    m2 = x1 * y3 - y1 * x3
    m3 = y1 * x2 - x1 * y2
    largest = max(max(abs(m0), abs(m1)), max(abs(m2), abs(m3)))
    # Rounding of the coordinates times a length is what an area of zero comes out as. Three
    # points on a line: the fourth has no weight, and that area must not give it a sign.
    length = max(max(abs(x1), abs(y1)), max(max(abs(x2), abs(y2)), max(abs(x3), abs(y3))))
    rounding = _ROUNDING * length * (length + max(abs(board[0, 0]), abs(board[0, 1])))
    if not largest > rounding:
        return (0.0, 0.0, 0.0, 0.0)
    zero = rounding / largest
    return (
        _unless_below(m0 / largest, zero),
        _unless_below(m1 / largest, zero),
        _unless_below(m2 / largest, zero),
        _unless_below(m3 / largest, zero),
    )


@jit
def _cross(ax: float, ay: float, bx: float, by: float) -> float:
    """Cross product; exactly zero where it is zero but for rounding (one ray, or the centre)."""
    return _unless_below(ax * by - ay * bx, _ROUNDING * (math.hypot(ax, ay) + math.hypot(bx, by)))


@jit
def _unless_below(value: float, bound: float) -> float:
    return value if abs(value) > bound else 0.0
