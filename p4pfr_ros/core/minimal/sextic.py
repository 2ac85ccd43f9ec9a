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

from ..geometry import Array
from ..jit import kernel

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


@kernel
def factors(image: Array, m: Array, rays: Array, duals: Array) -> Factors:
    """Return the six functions at both ends; duals is c as real and imaginary part, (4, 2)."""
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


@kernel
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


@kernel
def coefficients(f: Factors, low: float, high: float) -> Seven:
    """Return the sextic's Bernstein coefficients over an interval."""
    # Only the factors' values at the ends depend on the interval.
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
        (q0 * w0).imag,
        (q0 * w1 + q1 * w0).imag * (1.0 / 6.0),
        (q0 * w2 + q1 * w1 + q2 * w0).imag * (1.0 / 15.0),
        (q0 * w3 + q1 * w2 + q2 * w1).imag * (1.0 / 20.0),
        (q0 * w4 + q1 * w3 + q2 * w2).imag * (1.0 / 15.0),
        (q1 * w4 + q2 * w3).imag * (1.0 / 6.0),
        (q2 * w4).imag,
    )
