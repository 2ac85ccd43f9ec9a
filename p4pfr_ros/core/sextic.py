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

from typing import NamedTuple

from .geometry import Array
from .jit import jit

MAX_ROOTS = 6

# An interval this short with two roots or more left holds a multiple root, to rounding.
_SHORTEST = 1e-13

# Where the sextic is zero throughout (nothing to observe), rounding gives it signs at every depth.
_MAX_INTERVALS = 600

# Halving costs coefficients the digits by which they shrink. Those that have shrunk to this share
# of what they were formed as are formed again, from the factors.
_TOO_SMALL = 1e-3

# Newton's method, kept inside its bracket, needs some four steps. It is over when a step is lost
# in rounding, or is so small and yet no smaller than the one before that it must be rounding.
_MAX_NEWTON_STEPS = 64
_TAU_ROUNDING = 3e-16
_TAU_SMALL = 1e-9

# A waiting interval: its ends, the size its coefficients were formed with, and the Bernstein
# coefficients of Re(q z̄²) and of Im(q z̄²). Halves down to _SHORTEST, the other half of each
# waiting, make at most some fifty.
STACK_SHAPE = (64, 17)
_LOW, _HIGH, _SIZE, _REAL, _IMAGINARY = 0, 1, 2, 3, 10


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
def feasible_roots(f: Factors, roots: Array, stack: Array) -> int:
    """
    Write the roots in (0, 1) where f² can be positive to ``roots`` (6,); return their number.

    ``stack`` (STACK_SHAPE) is room for intervals.
    """
    found = 0
    waiting = 1
    _form(f, 0.0, 1.0, stack[0])
    for _ in range(_MAX_INTERVALS):
        if waiting == 0 or found == MAX_ROOTS:
            break
        waiting -= 1
        interval = stack[waiting]
        # f² > 0 asks for Re(q z̄²) < 0, and coefficients bound their polynomial.
        if not _any_negative(interval):
            continue
        variations = _variations(interval)
        if variations == 0:
            continue
        if variations == 1:
            roots[found] = _bracketed_newton(f, interval)
            found += 1
        elif interval[_HIGH] - interval[_LOW] < _SHORTEST:
            roots[found] = 0.5 * (interval[_LOW] + interval[_HIGH])
            found += 1
        else:
            left = stack[waiting + 1]
            _halve(f, interval, left)
            # A root at the middle itself, as symmetric boards have it, shows in neither half.
            if left[_IMAGINARY + 6] == 0.0 and left[_REAL + 6] < 0.0:
                roots[found] = left[_HIGH]
                found += 1
            waiting += 2
    return found


@jit
def _any_negative(interval: Array) -> bool:
    lowest = 0.0
    for i in range(7):
        lowest = min(lowest, interval[_REAL + i])
    return lowest < 0.0


@jit
def _variations(interval: Array) -> int:
    """
    Count the sign variations of the sextic's Bernstein coefficients.

    Descartes: none means no root inside, one means exactly one, more mean at most as many.
    """
    variations = 0
    last = 0.0
    for i in range(7):
        coefficient = interval[_IMAGINARY + i]
        if coefficient != 0.0:
            if last * coefficient < 0.0:
                variations += 1
            last = coefficient
    return variations


@jit
def _halve(f: Factors, interval: Array, left: Array) -> None:
    """Write the left half to ``left``, and the right half in place: de Casteljau's scheme."""
    middle = 0.5 * (interval[_LOW] + interval[_HIGH])
    left[_LOW], left[_HIGH], left[_SIZE] = interval[_LOW], middle, interval[_SIZE]
    interval[_LOW] = middle
    for j in range(7):
        left[_REAL + j] = interval[_REAL]
        left[_IMAGINARY + j] = interval[_IMAGINARY]
        for i in range(6 - j):
            interval[_REAL + i] = 0.5 * (interval[_REAL + i] + interval[_REAL + i + 1])
            interval[_IMAGINARY + i] = 0.5 * (
                interval[_IMAGINARY + i] + interval[_IMAGINARY + i + 1]
            )
    # Both are formed again or none is: they must agree on the sign in the middle.
    if min(_largest(left), _largest(interval)) < _TOO_SMALL * interval[_SIZE]:
        _form(f, left[_LOW], middle, left)
        _form(f, middle, interval[_HIGH], interval)


@jit
def _largest(interval: Array) -> float:
    largest = 0.0
    for i in range(7):
        largest = max(largest, abs(interval[_IMAGINARY + i]))
    return largest


@jit
def _form(f: Factors, low: float, high: float, interval: Array) -> None:
    """Write the Bernstein coefficients of q z̄² over an interval, formed from the factors."""
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
    _put(interval, 0, q0 * w0)
    _put(interval, 1, (q0 * w1 + q1 * w0) * (1.0 / 6.0))
    _put(interval, 2, (q0 * w2 + q1 * w1 + q2 * w0) * (1.0 / 15.0))
    _put(interval, 3, (q0 * w3 + q1 * w2 + q2 * w1) * (1.0 / 20.0))
    _put(interval, 4, (q0 * w4 + q1 * w3 + q2 * w2) * (1.0 / 15.0))
    _put(interval, 5, (q1 * w4 + q2 * w3) * (1.0 / 6.0))
    _put(interval, 6, q2 * w4)
    interval[_LOW], interval[_HIGH], interval[_SIZE] = low, high, _largest(interval)


@jit
def _put(interval: Array, i: int, coefficient: complex) -> None:
    interval[_REAL + i] = coefficient.real
    interval[_IMAGINARY + i] = coefficient.imag


@jit
def _bracketed_newton(f: Factors, interval: Array) -> float:
    """Find the one root of an interval: Newton's steps, bisection where they leave."""
    low, high = interval[_LOW], interval[_HIGH]
    tau, rising = _first_guess(interval)
    before = high - low
    for _ in range(_MAX_NEWTON_STEPS):
        value = evaluate(f, tau)
        if (value.sextic < 0.0) == rising:
            low = tau
        else:
            high = tau
        step = -value.sextic / value.slope if value.slope != 0.0 else high - low
        size = abs(step)
        if size <= _TAU_ROUNDING or (size < _TAU_SMALL and size > 0.5 * before):
            return tau
        before = size
        tau += step
        if not low < tau < high:
            tau = 0.5 * (low + high)
    return tau


@jit
def _first_guess(interval: Array) -> tuple[float, bool]:
    """Return where the polygon of the coefficients crosses zero, and whether it rises there."""
    at = 0
    before = after = 0.0
    for i in range(7):
        after = interval[_IMAGINARY + i]
        if before * after < 0.0:
            share = (at + (i - at) * before / (before - after)) / 6.0
            break
        # Zeros are stepped over, as they are in counting the variations.
        if after != 0.0:
            at, before = i, after
    else:
        share = 0.5
    tau = interval[_LOW] + (interval[_HIGH] - interval[_LOW]) * share
    return tau, after > before
