# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""
The sextic of planar P4Pfr: its factors, its values and its Bernstein coefficients.

With λ = (1 - τ) a + τ b from the depth cone, everything is built from six functions *linear* in τ,
four complex and two real (ξ = x + i y; c: the dual vectors of ``pose.board_duals``):

    u = Σ λᵢ ξᵢ cᵢ     v = Σ λᵢ ξ̄ᵢ cᵢ     l = Σ λᵢ cᵢ     p = Σ λᵢ rᵢ² cᵢ
    n = Σ λᵢ mᵢ        d = Σ λᵢ mᵢ rᵢ²

The third row of Σ mᵢ λᵢ (xᵢ, yᵢ, 1 + k rᵢ²) = 0 gives  k = -n / d.  The corners in the camera
frame are Qᵢ = λᵢ (xᵢ, yᵢ, f (1 + k rᵢ²)) up to one scale s, and Σ Qᵢ cᵢ = s (r₁ + i r₂): its
rows are h₁ = (u + v)/2, h₂ = (u - v)/2i and h₃ = f z / d with  z = d l - n p.  r₁ and r₂ are
orthogonal and of one length exactly when the sum of their squares, as complex numbers, is zero:

    h₁² + h₂² + h₃² = q + f² z² / d² = 0,   q = u v.

f² is real, so q and z² are parallel:  S = Im(q z̄²) = 0, of degree 6, and f² = -d² Re(q z̄²)/|z|⁴.

Near fronto-parallel views v and z are both small at the root, and S has a cluster of roots there
that its expanded coefficients are not accurate enough to separate. The factors are linear, so
restricting *them* to an interval and then forming its Bernstein coefficients keeps the relative
accuracy however small the interval is: ``roots`` does so where it needs more digits.
"""

from __future__ import annotations

from typing import NamedTuple

from .cone import Cone
from .four import dot, Four, minus, plus, Points, times
from ..jit import inlined

Seven = tuple[float, float, float, float, float, float, float]


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
    """The sextic and its parts at one τ."""

    sextic: float
    slope: float
    u: complex
    v: complex
    z: complex
    n: float
    d: float
    re: float  # Re(q z̄²)


@inlined
def factors(image: Points, m: Four, cone: Cone, duals: Points) -> Factors:
    """Return the six functions at both ends of the cone; duals: the vectors c."""
    x, y = image
    c_x, c_y = duals
    a, b = cone.a, cone.b
    x_x, x_y, y_x, y_y = times(x, c_x), times(x, c_y), times(y, c_x), times(y, c_y)
    direct = minus(x_x, y_y), plus(x_y, y_x)
    mirrored = plus(x_x, y_y), minus(x_y, y_x)
    r2 = plus(times(x, x), times(y, y))
    a_r2, b_r2 = times(a, r2), times(b, r2)
    return Factors(
        complex(dot(a, direct[0]), dot(a, direct[1])),
        complex(dot(b, direct[0]), dot(b, direct[1])),
        complex(dot(a, mirrored[0]), dot(a, mirrored[1])),
        complex(dot(b, mirrored[0]), dot(b, mirrored[1])),
        complex(dot(a, c_x), dot(a, c_y)),
        complex(dot(b, c_x), dot(b, c_y)),
        complex(dot(a_r2, c_x), dot(a_r2, c_y)),
        complex(dot(b_r2, c_x), dot(b_r2, c_y)),
        dot(a, m),
        dot(b, m),
        dot(a_r2, m),
        dot(b_r2, m),
    )


@inlined
def factors_at(f: Factors, tau: float) -> tuple[complex, complex, complex, complex, float, float]:
    """Return u, v, l, p, n and d at τ."""
    s = 1.0 - tau
    return (
        complex(s * f.u0.real + tau * f.u1.real, s * f.u0.imag + tau * f.u1.imag),
        complex(s * f.v0.real + tau * f.v1.real, s * f.v0.imag + tau * f.v1.imag),
        complex(s * f.l0.real + tau * f.l1.real, s * f.l0.imag + tau * f.l1.imag),
        complex(s * f.p0.real + tau * f.p1.real, s * f.p0.imag + tau * f.p1.imag),
        s * f.n0 + tau * f.n1,
        s * f.d0 + tau * f.d1,
    )


@inlined
def _times(factor: float, z: complex) -> complex:
    """Return factor z; Python and Numba would multiply by factor + 0i."""
    return complex(factor * z.real, factor * z.imag)


@inlined
def evaluate(f: Factors, tau: float) -> Value:
    """Evaluate the sextic and its slope from the factors, not from coefficients."""
    u, v, l, p, n, d = factors_at(f, tau)  # noqa: E741
    dn = f.n1 - f.n0
    dd = f.d1 - f.d0
    z = _times(d, l) - _times(n, p)
    dz = _times(dd, l) + _times(d, f.l1 - f.l0) - _times(dn, p) - _times(n, f.p1 - f.p0)
    q = u * v
    dq = (f.u1 - f.u0) * v + u * (f.v1 - f.v0)
    zz = (z * z).conjugate()
    product = q * zz
    slope = (dq * zz + (q + q) * (z * dz).conjugate()).imag
    return Value(product.imag, slope, u, v, z, n, d, product.real)


@inlined
def coefficients(f: Factors, low: float, high: float) -> Seven:
    """Return the sextic's Bernstein coefficients over an interval."""
    # Only the factors' values at the ends depend on the interval.
    u0, v0, l0, p0, n0, d0 = factors_at(f, low)
    u1, v1, l1, p1, n1, d1 = factors_at(f, high)
    # Bernstein coefficients, each times its binomial, multiply like polynomials. q has degree 2,
    # z degree 2, w = z̄² degree 4.
    q0, q1, q2 = u0 * v0, u0 * v1 + u1 * v0, u1 * v1
    z0 = (_times(d0, l0) - _times(n0, p0)).conjugate()
    z1 = (_times(d0, l1) + _times(d1, l0) - _times(n0, p1) - _times(n1, p0)).conjugate()
    z2 = (_times(d1, l1) - _times(n1, p1)).conjugate()
    z00 = z0 + z0
    w0, w1, w2, w3, w4 = z0 * z0, z00 * z1, z1 * z1 + z00 * z2, (z1 + z1) * z2, z2 * z2
    return (
        (q0 * w0).imag,
        (q0 * w1 + q1 * w0).imag * (1.0 / 6.0),
        (q0 * w2 + q1 * w1 + q2 * w0).imag * (1.0 / 15.0),
        (q0 * w3 + q1 * w2 + q2 * w1).imag * (1.0 / 20.0),
        (q0 * w4 + q1 * w3 + q2 * w2).imag * (1.0 / 15.0),
        (q1 * w4 + q2 * w3).imag * (1.0 / 6.0),
        (q2 * w4).imag,
    )
