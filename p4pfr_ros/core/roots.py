# SPDX-License-Identifier: Apache-2.0
"""
The roots of the sextic that may be a camera's: isolated by Descartes' rule, found by Newton.

Each interval's coefficients are formed from the factors anew, never from those of the interval
that it is part of: halving would cost them the digits by which they shrink.
"""

from __future__ import annotations

import math
from typing import NamedTuple

from .geometry import Array
from .jit import kernel
from .sextic import coefficients, evaluate, Factors, Seven

MAX_ROOTS = 6

# An interval this short with two roots or more left holds a multiple root, to rounding.
_SHORTEST = 1e-13

# Where the sextic is zero throughout (nothing to observe), rounding gives it signs at every depth.
_MAX_INTERVALS = 600

# An interval is split where its roots seem to lie apart, but not closer to its ends than this.
_MARGIN = 0.05

# Newton's method, kept inside its bracket, needs some four steps. It is over when a step is lost
# in rounding, or is so small and yet no smaller than the one before that it must be rounding.
_MAX_NEWTON_STEPS = 64
_TAU_ROUNDING = 3e-16
_TAU_SMALL = 1e-9

# Waiting intervals: depth first, one half of each kept, down to _SHORTEST.
STACK_SHAPE = (1024, 2)


@kernel
def feasible_roots(f: Factors, max_bend: float, roots: Array, stack: Array) -> int:
    """
    Write the roots in (0, 1) that may be a camera's to ``roots`` (6,); return their number.

    A camera's have f² > 0, and k below max_bend, which may be infinite. ``stack`` (STACK_SHAPE)
    is room for intervals.
    """
    found = 0
    waiting = _bounded_bend(f, max_bend, stack)
    for _ in range(_MAX_INTERVALS):
        if waiting == 0:
            break
        waiting -= 1
        low, high = stack[waiting, 0], stack[waiting, 1]
        signs = _signs(coefficients(f, low, high))
        if signs.variations > 1 and high - low >= _SHORTEST:
            # Nearer the second root: the first is then alone more often than not.
            share = 0.3 * signs.first + 0.7 * signs.second
            split = low + (high - low) * min(max(share, _MARGIN), 1.0 - _MARGIN)
            stack[waiting, 0], stack[waiting, 1] = split, high
            stack[waiting + 1, 0], stack[waiting + 1, 1] = low, split
            waiting += 2
            continue
        if signs.variations == 1:
            guess = low + (high - low) * signs.first
            root, re = _bracketed_newton(f, low, high, guess, signs.rising)
            found = _keep(root, re, roots, found)
        elif signs.variations > 1:
            middle = 0.5 * (low + high)
            found = _keep(middle, evaluate(f, middle).re, roots, found)
        # A root where an interval was split, as symmetric boards have it, shows in neither part.
        if signs.zero_at_high and high < 1.0:
            found = _keep(high, evaluate(f, high).re, roots, found)
    return found


@kernel
def _keep(tau: float, re: float, roots: Array, found: int) -> int:
    """Append a root where f² > 0, which asks for Re(q z̄²) < 0; return the new number."""
    if found < MAX_ROOTS and re < 0.0:
        roots[found] = tau
        return found + 1
    return found


@kernel
def _bounded_bend(f: Factors, max_bend: float, stack: Array) -> int:
    """Write the parts of (0, 1) where k < max_bend, the first on top; return their number."""
    if max_bend == math.inf:
        stack[0, 0], stack[0, 1] = 0.0, 1.0
        return 1
    # k = -n/d < B  where  e = n + B d  and d have one sign. Both are linear: three parts at most.
    e0, e1 = f.n0 + max_bend * f.d0, f.n1 + max_bend * f.d1
    one = f.d0 / (f.d0 - f.d1) if f.d0 * f.d1 < 0.0 else 1.0
    other = e0 / (e0 - e1) if e0 * e1 < 0.0 else 1.0
    waiting = 0
    high = 1.0
    for low in (max(one, other), min(one, other), 0.0):
        middle = 0.5 * (low + high)
        d = (1.0 - middle) * f.d0 + middle * f.d1
        e = (1.0 - middle) * e0 + middle * e1
        if low < high and d * e > 0.0:
            stack[waiting, 0], stack[waiting, 1] = low, high
            waiting += 1
        high = low
    return waiting


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
def _signs(c: Seven) -> Signs:
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
def _bracketed_newton(
    f: Factors, low: float, high: float, tau: float, rising: bool
) -> tuple[float, float]:
    """
    Find the one root between low and high from a guess: Newton, bisection where it leaves.

    Returned are the root and Re(q z̄²) there, or a step's rounding away.
    """
    before = high - low
    value = evaluate(f, tau)
    for _ in range(_MAX_NEWTON_STEPS):
        if (value.sextic < 0.0) == rising:
            low = tau
        else:
            high = tau
        step = -value.sextic / value.slope if value.slope != 0.0 else high - low
        size = abs(step)
        if size <= _TAU_ROUNDING or (size < _TAU_SMALL and size > 0.9 * before):
            break
        # Convergence is quadratic: the next step would be about size (size / before)².
        last = size * size * size <= _TAU_ROUNDING * before * before
        before = size
        tau += step
        if not low < tau < high:
            tau = 0.5 * (low + high)
        elif last:
            break
        value = evaluate(f, tau)
    return tau, value.re
