# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""From a root of the sextic to its focal length, distortion and pose."""

from __future__ import annotations

import math

from .sextic import evaluate, Factors
from .solution import G, H, TRANSLATION
from ..geometry import Array
from ..jit import kernel


@kernel
def pose_from_root(f: Factors, tau: float, row: Array) -> bool:
    """Write rotation, focal length and h of a root; its translation slot holds the scale."""
    at = evaluate(f, tau)
    norm = at.z.real * at.z.real + at.z.imag * at.z.imag
    # q + f² z²/d² = 0: z = 0 (fronto-parallel) leaves f open, d = 0 leaves k open, and where the
    # product is not negative f² would not be positive.
    if not (norm > 0.0 and at.d != 0.0 and at.re < 0.0):
        return False
    focal = math.sqrt(-at.re) * abs(at.d) / norm
    if not focal < math.inf:
        return False
    h1 = 0.5 * (at.u + at.v)
    h2 = -0.5j * (at.u - at.v)
    h3 = (focal / at.d) * at.z
    scale = orthogonal_factor(h1, h2, h3, row)
    row[TRANSLATION] = scale
    row[G] = focal
    row[H] = -focal * at.n / at.d
    return scale > 0.0


@kernel
def orthogonal_factor(h1: complex, h2: complex, h3: complex, row: Array) -> float:
    """
    Write the rotation nearest to s [r₁ r₂] = [Re h, Im h] and return its scale s; 0: none.

    It is exactly orthonormal, whatever rounding did to h.
    """
    # H (HᵀH)^(-1/2), with the 2x2 root in closed form:
    #     G^(1/2) = (G + δ I)/t,  G^(-1/2) = (adj G + δ I)/(δ t),  δ² = det G,  t² = tr G + 2 δ.
    g11 = h1.real * h1.real + h2.real * h2.real + h3.real * h3.real
    g22 = h1.imag * h1.imag + h2.imag * h2.imag + h3.imag * h3.imag
    g12 = h1.real * h1.imag + h2.real * h2.imag + h3.real * h3.imag
    delta = math.sqrt(max(0.0, g11 * g22 - g12 * g12))
    trace = math.sqrt(g11 + g22 + 2.0 * delta)
    if not delta > 0.0:
        return 0.0
    inverse = 1.0 / (delta * trace)
    a, b, c = (g22 + delta) * inverse, -g12 * inverse, (g11 + delta) * inverse
    row[0], row[1] = h1.real * a + h1.imag * b, h1.real * b + h1.imag * c
    row[3], row[4] = h2.real * a + h2.imag * b, h2.real * b + h2.imag * c
    row[6], row[7] = h3.real * a + h3.imag * b, h3.real * b + h3.imag * c
    row[2] = row[3] * row[7] - row[6] * row[4]
    row[5] = row[6] * row[1] - row[0] * row[7]
    row[8] = row[0] * row[4] - row[3] * row[1]
    return 0.5 * trace


@kernel
def place_centroid(rays: Array, tau: float, image: Array, row: Array) -> None:
    """Replace the scale in the translation slot by the centroid in the camera's frame."""
    scale = 0.25 / row[TRANSLATION]
    tx = ty = tz = 0.0
    for i in range(4):
        depth = (1.0 - tau) * rays[0, i] + tau * rays[1, i]
        x, y = image[i, 0], image[i, 1]
        tx += depth * x
        ty += depth * y
        tz += depth * (row[G] + row[H] * (x * x + y * y))
    row[TRANSLATION] = scale * tx
    row[TRANSLATION + 1] = scale * ty
    row[TRANSLATION + 2] = scale * tz
