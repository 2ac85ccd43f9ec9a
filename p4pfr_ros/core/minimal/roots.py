# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""
The feasible roots of the sextic: isolated by Descartes' rule, refined by Newton's method.

Intervals carry the sextic's Bernstein coefficients. Splitting an interval splits its coefficients
cheaply by de Casteljau's scheme, but leaves them with the rounding error of the whole. If a
coefficient has become so small that rounding could have changed its sign, the coefficients of both
parts are computed again from the factors (see ``sextic``).
"""

from __future__ import annotations

import math
from typing import NamedTuple

from .four import largest
from .sextic import coefficients, evaluate, Factors, Seven
from ..geometry import Array
from ..jit import inlined, kernel

MAX_ROOTS = 6

# The distance of the corners of the coefficients' polygon.
_SIXTH = 1.0 / 6.0

# A shorter interval with two roots or more holds a multiple root, to rounding.
SHORTEST = 1e-13

# Limit of the search if the sextic vanishes everywhere (unobservable) but for rounding errors.
_MAX_INTERVALS = 600

# An interval is split between its roots, but no closer to its ends than this share.
_MARGIN = 0.05

# Newton's method inside its bracket needs some four steps. It ends if a step is below rounding, or
# is small and yet no smaller than the one before.
MAX_NEWTON_STEPS = 64
_TAU_ROUNDING = 3e-16
_TAU_SMALL = 1e-9

# The sign of a coefficient below this share of the largest initial one of de Casteljau's scheme is
# not reliable: the rounding error is some 1e-15 of that.
_SIGNLESS = 1e-10

# An interval on the stack: its ends, the largest coefficient of the interval that it was split
# from, and its own coefficients. Depth first: the right part of each split waits.
STACK_SHAPE = (1024, 10)
_LOW, _HIGH, _SIZE, _FIRST = 0, 1, 2, 3


class Signs(NamedTuple):
    """
    The sign changes of an interval's Bernstein coefficients.

    Descartes: 0 variations mean no root inside, 1 means one root, more are an upper bound.
    first and second are the zero crossings of the coefficients' polygon, as shares of the
    interval; rising: the direction of the first crossing.
    """

    variations: float
    first: float
    second: float
    rising: bool
    zero_at_high: bool


@kernel
def feasible_roots(f: Factors, max_bend: float, roots: Array, stack: Array) -> int:
    """
    Write the roots in (0, 1) that belong to a camera to ``roots`` (6,); return their number.

    They have f² > 0 and k < max_bend, which may be infinite. ``stack`` (STACK_SHAPE) is workspace
    for intervals.
    """
    count = 0
    waiting = _push_bounded(f, max_bend, stack)
    for _ in range(_MAX_INTERVALS):
        if waiting == 0:
            break
        waiting -= 1
        low, high = stack[waiting, _LOW], stack[waiting, _HIGH]
        signs = signs_of(_top(stack, waiting))
        if signs.variations > 1 and high - low >= SHORTEST:
            _split_interval(f, share_to_split(signs), stack, waiting)
            waiting += 2
            continue
        if signs.variations == 1:
            guess = low + (high - low) * signs.first
            root, re = _bracketed_newton(f, low, high, guess, signs.rising)
            count = _append_root(root, re, roots, count)
        elif signs.variations > 1:
            middle = 0.5 * (low + high)
            count = _append_root(middle, evaluate(f, middle).re, roots, count)
        # A root at a split point, as symmetric boards have, appears in neither part.
        if signs.zero_at_high and high < 1.0:
            count = _append_root(high, evaluate(f, high).re, roots, count)
    return count


@kernel
def _append_root(tau: float, re: float, roots: Array, count: int) -> int:
    """Append a root if f² > 0, that is, Re(q z̄²) < 0; return the new number."""
    if count < MAX_ROOTS and re < 0.0:
        roots[count] = tau
        return count + 1
    return count


@kernel
def _push_bounded(f: Factors, max_bend: float, stack: Array) -> int:
    """Push the parts of (0, 1) where k < max_bend, the first on top; return their number."""
    first, second, in_first, in_second, in_third = bounded_parts(f, max_bend)
    waiting = 0
    if in_third:
        _push_from_factors(f, second, 1.0, stack, waiting)
        waiting += 1
    if in_second:
        _push_from_factors(f, first, second, stack, waiting)
        waiting += 1
    if in_first:
        _push_from_factors(f, 0.0, first, stack, waiting)
        waiting += 1
    return waiting


@inlined
def bounded_parts(f: Factors, max_bend: float) -> tuple[float, float, bool, bool, bool]:
    """Split (0, 1) at two values of τ; return them, and whether k < max_bend in each part."""
    # k = -n/d < B  where  e = n + B d  and d have the same sign. Both are linear: at most three
    # parts.
    bounded = max_bend < math.inf
    bend = max_bend if bounded else 0.0
    e0, e1 = f.n0 + bend * f.d0, f.n1 + bend * f.d1
    zero_of_d = f.d0 / (f.d0 - f.d1) if bounded and f.d0 * f.d1 < 0.0 else 1.0
    zero_of_e = e0 / (e0 - e1) if bounded and e0 * e1 < 0.0 else 1.0
    first, second = min(zero_of_d, zero_of_e), max(zero_of_d, zero_of_e)
    return (
        first,
        second,
        not bounded or _same_sign(f, e0, e1, 0.5 * first),
        first < second and _same_sign(f, e0, e1, 0.5 * (first + second)),
        second < 1.0 and _same_sign(f, e0, e1, 0.5 * (second + 1.0)),
    )


@inlined
def _same_sign(f: Factors, e0: float, e1: float, tau: float) -> bool:
    """Return whether d and e have the same sign at τ."""
    s = 1.0 - tau
    return (s * f.d0 + tau * f.d1) * (s * e0 + tau * e1) > 0.0


class Bracket(NamedTuple):
    """
    A root between low and high in the course of Newton's method.

    tau: the latest value; before: the size of the latest step; re: Re(q z̄²) before it.
    """

    low: float
    high: float
    tau: float
    before: float
    re: float
    done: bool


@inlined
def newton_step(f: Factors, rising: bool, bracket: Bracket) -> Bracket:
    """Take a step of Newton's method, or of bisection if that would leave the bracket."""
    low, high, tau, before, _, _ = bracket
    value = evaluate(f, tau)
    is_low = (value.sextic < 0.0) == rising
    low = tau if is_low else low
    high = high if is_low else tau
    step = -value.sextic / value.slope if value.slope != 0.0 else high - low
    size = abs(step)
    converged = size <= _TAU_ROUNDING or (size < _TAU_SMALL and size > 0.9 * before)
    # Convergence is quadratic: the next step would be about size (size / before)². Only for
    # small steps: after a longer one another root may be close.
    last = size < _TAU_SMALL and size * size * size <= _TAU_ROUNDING * before * before
    moved = tau + step
    inside = low < moved < high
    moved = moved if inside else 0.5 * (low + high)
    return Bracket(
        low, high, tau if converged else moved, size, value.re, converged or (last and inside)
    )


@kernel
def _bracketed_newton(
    f: Factors, low: float, high: float, tau: float, rising: bool
) -> tuple[float, float]:
    """Return the one root between low and high, and Re(q z̄²) there to the rounding of a step."""
    bracket = Bracket(low, high, tau, high - low, 0.0, False)
    for _ in range(MAX_NEWTON_STEPS):
        bracket = newton_step(f, rising, bracket)
        if bracket.done:
            break
    return bracket.tau, bracket.re


@inlined
def signs_of(c: Seven) -> Signs:
    """Count the sign changes, and find the polygon's first two zero crossings."""
    # A zero gets the sign of the value before it, or else of the first nonzero one.
    c0 = c[0]
    for i in range(1, 7):
        c0 = c0 if c0 != 0.0 else c[i]
    c1 = c[1] if c[1] != 0.0 else c0
    c2 = c[2] if c[2] != 0.0 else c1
    c3 = c[3] if c[3] != 0.0 else c2
    c4 = c[4] if c[4] != 0.0 else c3
    c5 = c[5] if c[5] != 0.0 else c4
    c6 = c[6] if c[6] != 0.0 else c5
    filled = (c0, c1, c2, c3, c4, c5, c6)
    # Without branches, because they would be unpredictable. From right to left: at the end the
    # first two crossings are left, each with the values on both sides.
    variations = 0.0
    first = second = 0.0
    before1, after1 = before2, after2 = 0.0, 1.0
    for i in range(5, -1, -1):
        change = (filled[i] < 0.0) != (filled[i + 1] < 0.0)
        variations += 1.0 if change else 0.0
        second, before2, after2 = (
            first if change else second,
            before1 if change else before2,
            after1 if change else after2,
        )
        first = float(i) if change else first
        before1 = filled[i] if change else before1
        after1 = filled[i + 1] if change else after1
    return Signs(
        variations,
        (first + before1 / (before1 - after1)) * _SIXTH,
        (second + before2 / (before2 - after2)) * _SIXTH,
        c0 < 0.0,
        c[6] == 0.0,
    )


@inlined
def share_to_split(signs: Signs) -> float:
    """Return where to split an interval: between two roots, or near the second of more."""
    # The fewest intervals in trials.
    two = signs.variations == 2.0
    share = 0.5 * (signs.first + signs.second) if two else signs.second
    return min(max(share, _MARGIN), 1.0 - _MARGIN)


@kernel
def _top(stack: Array, at: int) -> Seven:
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
    stack[at, _LOW], stack[at, _HIGH], stack[at, _SIZE] = low, high, size
    for i in range(7):
        stack[at, _FIRST + i] = c[i]


@kernel
def _push_from_factors(f: Factors, low: float, high: float, stack: Array, at: int) -> None:
    """Push an interval, its coefficients computed from the factors."""
    c = coefficients(f, low, high)
    _push(low, high, largest_of(c), c, stack, at)


@inlined
def largest_of(c: Seven) -> float:
    """Return the largest absolute value of a coefficient."""
    return max(largest((c[0], c[1], c[2], c[3])), largest((c[4], c[5], c[6], 0.0)))


@kernel
def _split_interval(f: Factors, share: float, stack: Array, at: int) -> None:
    """Replace the interval at ``at`` by its right part, and push its left part above it."""
    low, high, size = stack[at, _LOW], stack[at, _HIGH], stack[at, _SIZE]
    middle = low + (high - low) * share
    left, right = de_casteljau(_top(stack, at), share)
    if sign_lost(left, size) or sign_lost(right, size):
        # Always both parts: they must have the same sign in the middle.
        _push_from_factors(f, middle, high, stack, at)
        _push_from_factors(f, low, middle, stack, at + 1)
    else:
        _push(middle, high, size, right, stack, at)
        _push(low, middle, size, left, stack, at + 1)


@inlined
def sign_lost(c: Seven, size: float) -> bool:
    """Return whether rounding may have changed the sign of a nonzero coefficient."""
    bound = _SIGNLESS * size
    lost = 0
    for i in range(7):
        lost += 1 if c[i] != 0.0 and abs(c[i]) < bound else 0
    return lost > 0


@inlined
def de_casteljau(c: Seven, t: float) -> tuple[Seven, Seven]:
    """Return the coefficients of both parts of an interval split at the share t."""
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
