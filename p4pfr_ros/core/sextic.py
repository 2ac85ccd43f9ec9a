# SPDX-License-Identifier: Apache-2.0
"""
The sextic of planar P4Pfr: its factors, its values and its roots in (0, 1).

With λ = (1 - τ) a + τ b from the depth cone, all that follows is made of six functions that are
*linear* in τ, four complex and two real (ξ = x + i y; c is the board's, see ``board_duals``):

    u = Σ λᵢ ξᵢ cᵢ     v = Σ λᵢ ξ̄ᵢ cᵢ     l = Σ λᵢ cᵢ     p = Σ λᵢ rᵢ² cᵢ
    n = Σ λᵢ mᵢ        d = Σ λᵢ mᵢ rᵢ²

The third row of Σ mᵢ λᵢ (xᵢ, yᵢ, 1 + k rᵢ²) = 0 gives  k = -n / d.  The corners in the camera
frame are Qᵢ = λᵢ (xᵢ, yᵢ, f (1 + k rᵢ²)) but for one scale s, and Σ Qᵢ cᵢ = s (r₁ + i r₂): its
rows are h₁ = (u + v)/2, h₂ = (u - v)/2i and h₃ = f z / d with  z = d l - n p.  r₁ and r₂ are
orthogonal and of one length exactly when the sum of their squares, as complex numbers, is zero:

    h₁² + h₂² + h₃² = q + f² z² / d² = 0,   q = u v.

f² is real, so q and z² are parallel:  S = Im(q z̄²) = 0, of degree 6, and f² = -d² Re(q z̄²)/|z|⁴.

Near fronto-parallel views u and z are both small at the root, and S has a cluster of roots there
that its expanded coefficients cannot tell apart: the digits are lost in forming them. The factors
are linear, so restricting *them* to an interval, and then forming its Bernstein coefficients,
keeps their relative accuracy however small the interval is. That is the subdivision used here.
"""

from __future__ import annotations

import math
from typing import NamedTuple

from .geometry import Array
from .jit import jit

MAX_ROOTS = 6

Seven = tuple[complex, complex, complex, complex, complex, complex, complex]

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


class Factors(NamedTuple):
    """The six linear functions by their values at τ = 0 and τ = 1."""

    u0: complex
    u1: complex
    v0: complex
    v1: complex
    l0: complex
    l1: complex
    p0: complex
    p1: complex
    n0: float
    n1: float
    d0: float
    d1: float


class Value(NamedTuple):
    """What the factors make of one τ."""

    sextic: float
    slope: float
    u: complex
    v: complex
    z: complex
    n: float
    d: float
    re: float  # Re(q z̄²)


@jit
def factors(image: Array, m: Array, rays: Array, duals: Array) -> Factors:
    """Sum the six functions at both ends; duals is c, (4, 2) as real and imaginary part."""
    u0 = u1 = v0 = v1 = l0 = l1 = p0 = p1 = 0.0j
    n0 = n1 = d0 = d1 = 0.0
    for i in range(4):
        x, y = image[i, 0], image[i, 1]
        a, b = rays[0, i], rays[1, i]
        c = complex(duals[i, 0], duals[i, 1])
        direct, mirrored = complex(x, y) * c, complex(x, -y) * c
        r2 = x * x + y * y
        u0 += a * direct
        u1 += b * direct
        v0 += a * mirrored
        v1 += b * mirrored
        l0 += a * c
        l1 += b * c
        p0 += a * r2 * c
        p1 += b * r2 * c
        n0 += a * m[i]
        n1 += b * m[i]
        d0 += a * m[i] * r2
        d1 += b * m[i] * r2
    return Factors(u0, u1, v0, v1, l0, l1, p0, p1, n0, n1, d0, d1)


@jit
def evaluate(f: Factors, tau: float) -> Value:
    """Evaluate the sextic and its slope from the factors, not from coefficients."""
    s = 1.0 - tau
    u = s * f.u0 + tau * f.u1
    v = s * f.v0 + tau * f.v1
    l = s * f.l0 + tau * f.l1  # noqa: E741
    p = s * f.p0 + tau * f.p1
    n = s * f.n0 + tau * f.n1
    d = s * f.d0 + tau * f.d1
    dn = f.n1 - f.n0
    dd = f.d1 - f.d0
    z = d * l - n * p
    dz = dd * l + d * (f.l1 - f.l0) - dn * p - n * (f.p1 - f.p0)
    q = u * v
    dq = (f.u1 - f.u0) * v + u * (f.v1 - f.v0)
    zz = (z * z).conjugate()
    product = q * zz
    slope = (dq * zz + 2.0 * q * (z * dz).conjugate()).imag
    return Value(product.imag, slope, u, v, z, n, d, product.real)


@jit
def feasible_roots(f: Factors, max_bend: float, roots: Array, stack: Array) -> int:
    """
    Write the roots in (0, 1) that may be a camera's to ``roots`` (6,); return their number.

    A camera's have f² > 0, and k below max_bend, which may be infinite. ``stack`` (STACK_SHAPE)
    is room for intervals.
    """
    found = 0
    waiting = _bounded_bend(f, max_bend, stack)
    for _ in range(_MAX_INTERVALS):
        if waiting == 0 or found == MAX_ROOTS:
            break
        waiting -= 1
        low, high = stack[waiting, 0], stack[waiting, 1]
        signs = _signs(_coefficients(f, low, high))
        if signs.variations == 0 or not signs.feasible:
            continue
        if signs.variations == 1:
            guess = low + (high - low) * signs.first
            roots[found] = _bracketed_newton(f, low, high, guess, signs.rising)
            found += 1
        elif high - low < _SHORTEST:
            roots[found] = 0.5 * (low + high)
            found += 1
        else:
            share = 0.3 * signs.first + 0.7 * signs.second
            split = low + (high - low) * min(max(share, _MARGIN), 1.0 - _MARGIN)
            # A root at the split itself, as symmetric boards have it, shows in neither part.
            at = evaluate(f, split)
            if at.sextic == 0.0 and at.re < 0.0:
                roots[found] = split
                found += 1
            stack[waiting, 0], stack[waiting, 1] = split, high
            stack[waiting + 1, 0], stack[waiting + 1, 1] = low, split
            waiting += 2
    return found


@jit
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

    feasible: bool
    variations: int
    first: float
    second: float
    rising: bool


@jit
def _signs(coefficients: Seven) -> Signs:
    variations = 0
    first = second = 0.5
    rising = False
    at, before = 0, 0.0
    lowest = 0.0
    for i in range(7):
        # f² > 0 asks for Re(q z̄²) < 0, and coefficients bound their polynomial.
        lowest = min(lowest, coefficients[i].real)
        after = coefficients[i].imag
        if before * after < 0.0:
            crossing = (at + (i - at) * before / (before - after)) / 6.0
            if variations == 0:
                first = crossing
                rising = after > 0.0
            elif variations == 1:
                second = crossing
            variations += 1
        if after != 0.0:
            at, before = i, after
    return Signs(lowest < 0.0, variations, first, second, rising)


@jit
def _coefficients(f: Factors, low: float, high: float) -> Seven:
    """Return the Bernstein coefficients of q z̄² over an interval."""
    # The factors' values at the interval's ends are all that changes with the interval.
    s, t = 1.0 - low, 1.0 - high
    u0, u1 = s * f.u0 + low * f.u1, t * f.u0 + high * f.u1
    v0, v1 = s * f.v0 + low * f.v1, t * f.v0 + high * f.v1
    l0, l1 = s * f.l0 + low * f.l1, t * f.l0 + high * f.l1
    p0, p1 = s * f.p0 + low * f.p1, t * f.p0 + high * f.p1
    n0, n1 = s * f.n0 + low * f.n1, t * f.n0 + high * f.n1
    d0, d1 = s * f.d0 + low * f.d1, t * f.d0 + high * f.d1
    # Bernstein coefficients, each times its binomial, multiply like polynomials. q has degree 2,
    # z degree 2, w = z̄² degree 4.
    q0, q1, q2 = u0 * v0, u0 * v1 + u1 * v0, u1 * v1
    z0 = (d0 * l0 - n0 * p0).conjugate()
    z1 = (d0 * l1 + d1 * l0 - n0 * p1 - n1 * p0).conjugate()
    z2 = (d1 * l1 - n1 * p1).conjugate()
    w0, w1, w2, w3, w4 = z0 * z0, 2.0 * z0 * z1, z1 * z1 + 2.0 * z0 * z2, 2.0 * z1 * z2, z2 * z2
    return (
        q0 * w0,
        (q0 * w1 + q1 * w0) * (1.0 / 6.0),
        (q0 * w2 + q1 * w1 + q2 * w0) * (1.0 / 15.0),
        (q0 * w3 + q1 * w2 + q2 * w1) * (1.0 / 20.0),
        (q0 * w4 + q1 * w3 + q2 * w2) * (1.0 / 15.0),
        (q1 * w4 + q2 * w3) * (1.0 / 6.0),
        q2 * w4,
    )


@jit
def _bracketed_newton(f: Factors, low: float, high: float, tau: float, rising: bool) -> float:
    """Find the one root between low and high from a guess: Newton, bisection where it leaves."""
    before = high - low
    for _ in range(_MAX_NEWTON_STEPS):
        value = evaluate(f, tau)
        if (value.sextic < 0.0) == rising:
            low = tau
        else:
            high = tau
        step = -value.sextic / value.slope if value.slope != 0.0 else high - low
        size = abs(step)
        if size <= _TAU_ROUNDING or (size < _TAU_SMALL and size > 0.9 * before):
            return tau
        before = size
        tau += step
        if not low < tau < high:
            tau = 0.5 * (low + high)
    return tau
