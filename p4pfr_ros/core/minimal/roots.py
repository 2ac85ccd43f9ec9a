# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""The roots of the sextic that may be a camera's: isolated by Descartes' rule, found by Newton."""

from __future__ import annotations

import math

from .intervals import HIGH, LOW, push_anew, signs_of, split_interval, top
from .sextic import evaluate, Factors
from ..geometry import Array
from ..jit import kernel

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
        low, high = stack[waiting, LOW], stack[waiting, HIGH]
        signs = signs_of(top(stack, waiting))
        if signs.variations > 1 and high - low >= _SHORTEST:
            # Between two roots, or near the second of more: the fewest intervals, by trial.
            two = signs.variations == 2
            share = 0.5 * (signs.first + signs.second) if two else signs.second
            share = min(max(share, _MARGIN), 1.0 - _MARGIN)
            split_interval(f, share, stack, waiting)
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
        push_anew(f, 0.0, 1.0, stack, 0)
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
            push_anew(f, low, high, stack, waiting)
            waiting += 1
        high = low
    return waiting


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
        # Convergence is quadratic: the next step would be about size (size / before)². A longer
        # step than a small one may yet find that there is another root close by.
        last = size < _TAU_SMALL and size * size * size <= _TAU_ROUNDING * before * before
        before = size
        tau += step
        if not low < tau < high:
            tau = 0.5 * (low + high)
        elif last:
            break
        value = evaluate(f, tau)
    return tau, value.re
