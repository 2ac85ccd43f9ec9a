# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""
Intervals with the sextic's Bernstein coefficients over them, and what the coefficients' signs say.

Splitting an interval in two splits its coefficients cheaply, by de Casteljau's scheme, but leaves
them with the rounding of the whole. Where a coefficient has become so small that its sign could
be rounding's, both parts' are formed anew, from the factors (see ``sextic``).
"""

from __future__ import annotations

from typing import NamedTuple

from .sextic import coefficients, Factors, Seven
from ..geometry import Array
from ..jit import kernel

# A coefficient below this share of the largest that its scheme began with may have any sign: the
# scheme's rounding is some 1e-15 of that.
_SIGNLESS = 1e-10

# A waiting interval: its ends, the largest of the coefficients that it was split from, and its
# coefficients. Depth first: of each split one part waits.
STACK_SHAPE = (1024, 10)
LOW, HIGH, SIZE, _FIRST = 0, 1, 2, 3


class Signs(NamedTuple):
    """
    What the signs of an interval's Bernstein coefficients say.

    Descartes: no variation means no root inside, one means exactly one, more mean at most as
    many. first and second are where the coefficients' polygon crosses zero, as shares of the
    interval; rising says whether the first crossing does.
    """

    variations: int
    first: float
    second: float
    rising: bool
    zero_at_high: bool


@kernel
def signs_of(c: Seven) -> Signs:
    """Count the variations, and find the polygon's first two crossings of zero."""
    zero_at_high = c[6] == 0.0
    if c[0] * c[1] * c[2] == 0.0 or c[3] * c[4] * c[5] == 0.0 or zero_at_high:
        c = _zeros_filled(c)
    # Without a branch: which signs change is what no processor can foresee.
    variations = (
        int((c[0] < 0.0) != (c[1] < 0.0))
        + int((c[1] < 0.0) != (c[2] < 0.0))
        + int((c[2] < 0.0) != (c[3] < 0.0))
        + int((c[3] < 0.0) != (c[4] < 0.0))
        + int((c[4] < 0.0) != (c[5] < 0.0))
        + int((c[5] < 0.0) != (c[6] < 0.0))
    )
    if variations == 0:
        return Signs(0, 0.5, 0.5, False, zero_at_high)
    first, after = _crossing(c, 0)
    if variations == 1:
        return Signs(1, first, 0.5, c[0] < 0.0, zero_at_high)
    second, _ = _crossing(c, after)
    return Signs(variations, first, second, c[0] < 0.0, zero_at_high)


@kernel
def _crossing(c: Seven, start: int) -> tuple[float, int]:
    """Return where the polygon first crosses zero from a corner on, and the corner after it."""
    for i in range(start, 6):
        if (c[i] < 0.0) != (c[i + 1] < 0.0):
            return (i + c[i] / (c[i] - c[i + 1])) / 6.0, i + 1
    return 0.5, 6


@kernel
def _zeros_filled(c: Seven) -> Seven:
    """Give zeros the value before them, or where there is none the first: no sign of their own."""
    last = 0.0
    for i in range(6, -1, -1):
        if c[i] != 0.0:
            last = c[i]
    c0 = last
    c1 = c[1] if c[1] != 0.0 else c0
    c2 = c[2] if c[2] != 0.0 else c1
    c3 = c[3] if c[3] != 0.0 else c2
    c4 = c[4] if c[4] != 0.0 else c3
    c5 = c[5] if c[5] != 0.0 else c4
    c6 = c[6] if c[6] != 0.0 else c5
    return c0, c1, c2, c3, c4, c5, c6


@kernel
def top(stack: Array, at: int) -> Seven:
    """Return an interval's coefficients."""
    return (
        stack[at, _FIRST],
        stack[at, _FIRST + 1],
        stack[at, _FIRST + 2],
        stack[at, _FIRST + 3],
        stack[at, _FIRST + 4],
        stack[at, _FIRST + 5],
        stack[at, _FIRST + 6],
    )


@kernel
def _push(low: float, high: float, size: float, c: Seven, stack: Array, at: int) -> None:
    stack[at, LOW], stack[at, HIGH], stack[at, SIZE] = low, high, size
    for i in range(7):
        stack[at, _FIRST + i] = c[i]


@kernel
def push_anew(f: Factors, low: float, high: float, stack: Array, at: int) -> None:
    """Push an interval with coefficients formed from the factors."""
    c = coefficients(f, low, high)
    largest = max(max(abs(c[0]), abs(c[1])), max(abs(c[2]), abs(c[3])))
    largest = max(max(largest, abs(c[4])), max(abs(c[5]), abs(c[6])))
    _push(low, high, largest, c, stack, at)


@kernel
def split_interval(f: Factors, share: float, stack: Array, at: int) -> None:
    """Replace the interval at ``at`` by its right part, and push its left part above it."""
    low, high, size = stack[at, LOW], stack[at, HIGH], stack[at, SIZE]
    middle = low + (high - low) * share
    left, right = _de_casteljau(top(stack, at), share)
    if _sign_lost(left, size) or _sign_lost(right, size):
        # Both or none: they must agree on the sign in the middle.
        push_anew(f, middle, high, stack, at)
        push_anew(f, low, middle, stack, at + 1)
    else:
        _push(middle, high, size, right, stack, at)
        _push(low, middle, size, left, stack, at + 1)


@kernel
def _sign_lost(c: Seven, size: float) -> bool:
    """Say whether rounding may have made the sign of a coefficient; a zero has none to lose."""
    bound = _SIGNLESS * size
    lost = 0
    for i in range(7):
        lost += int(c[i] != 0.0) & int(abs(c[i]) < bound)
    return lost > 0


@kernel
def _de_casteljau(c: Seven, t: float) -> tuple[Seven, Seven]:
    """Return the coefficients over both parts of an interval that is split at the share t."""
    s = 1.0 - t
    c00, c01, c02, c03, c04, c05, c06 = c
    c10, c11, c12 = s * c00 + t * c01, s * c01 + t * c02, s * c02 + t * c03
    c13, c14, c15 = s * c03 + t * c04, s * c04 + t * c05, s * c05 + t * c06
    c20, c21, c22 = s * c10 + t * c11, s * c11 + t * c12, s * c12 + t * c13
    c23, c24 = s * c13 + t * c14, s * c14 + t * c15
    c30, c31, c32, c33 = s * c20 + t * c21, s * c21 + t * c22, s * c22 + t * c23, s * c23 + t * c24
    c40, c41, c42 = s * c30 + t * c31, s * c31 + t * c32, s * c32 + t * c33
    c50, c51 = s * c40 + t * c41, s * c41 + t * c42
    c60 = s * c50 + t * c51
    return (c00, c10, c20, c30, c40, c50, c60), (c60, c51, c42, c33, c24, c15, c06)
