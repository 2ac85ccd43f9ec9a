# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""
Four points as numbers, not arrays: the arguments of the solver's formulas.

A formula is a function of numbers without branches. The kernel of one problem calls it once; the
kernels of a block (``lanes``) call it in a loop over problems, which LLVM turns into vector
instructions. So both compute the same, to the last bit.
"""

from __future__ import annotations

from typing import NamedTuple

from ..geometry import Array, Ints
from ..jit import inlined

Four = tuple[float, float, float, float]


class Points(NamedTuple):
    """Four points, or vectors, of a plane."""

    x: Four
    y: Four


@inlined
def points_of(array: Array) -> Points:
    """Read the points of an array (4, 2)."""
    return Points(
        (array[0, 0], array[1, 0], array[2, 0], array[3, 0]),
        (array[0, 1], array[1, 1], array[2, 1], array[3, 1]),
    )


@inlined
def four_of(array: Array) -> Four:
    """Read an array (4,)."""
    return array[0], array[1], array[2], array[3]


@inlined
def chosen_points(points: Array, chosen: Ints) -> Points:
    """Read four of the points (N, 2)."""
    a, b, c, d = chosen[0], chosen[1], chosen[2], chosen[3]
    return Points(
        (points[a, 0], points[b, 0], points[c, 0], points[d, 0]),
        (points[a, 1], points[b, 1], points[c, 1], points[d, 1]),
    )


@inlined
def sum_of(a: Four) -> float:
    """Return Σ aᵢ."""
    return a[0] + a[1] + a[2] + a[3]


@inlined
def dot(a: Four, b: Four) -> float:
    """Return Σ aᵢ bᵢ."""
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2] + a[3] * b[3]


@inlined
def plus(a: Four, b: Four) -> Four:
    """Return the sums aᵢ + bᵢ."""
    return a[0] + b[0], a[1] + b[1], a[2] + b[2], a[3] + b[3]


@inlined
def minus(a: Four, b: Four) -> Four:
    """Return the differences aᵢ - bᵢ."""
    return a[0] - b[0], a[1] - b[1], a[2] - b[2], a[3] - b[3]


@inlined
def times(a: Four, b: Four) -> Four:
    """Return the products aᵢ bᵢ."""
    return a[0] * b[0], a[1] * b[1], a[2] * b[2], a[3] * b[3]


@inlined
def scaled(a: Four, factor: float) -> Four:
    """Return a, each number times the factor."""
    return a[0] * factor, a[1] * factor, a[2] * factor, a[3] * factor


@inlined
def choose(condition: bool, a: Four, b: Four) -> Four:
    """Return a if the condition holds, else b."""
    return (
        a[0] if condition else b[0],
        a[1] if condition else b[1],
        a[2] if condition else b[2],
        a[3] if condition else b[3],
    )


@inlined
def largest(a: Four) -> float:
    """Return the largest absolute value."""
    return max(max(abs(a[0]), abs(a[1])), max(abs(a[2]), abs(a[3])))
