# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""Elimination, inversion of information matrices and rotations in kernels; polynomial roots."""

from __future__ import annotations

import math

import numpy as np
from numpy.polynomial import polynomial as poly

from .geometry import Array
from .jit import kernel

# Roots with a relative imaginary part up to this count as real: rounding splits a double root
# into a complex pair.
_NEARLY_REAL = 1e-7

# Coefficients below this share of the largest one count as zero.
_NEGLIGIBLE = 1e-60

# Ridge added to an information matrix whose diagonal is scaled to ones, so that it can always be
# inverted. It exceeds rounding (some 1e-15), which must not pass for information, and reduces a
# variance by 1 % where the smallest eigenvalue is 1e-11, by 10 % where it is 1e-12.
_RIDGE = 1e-13

# A smaller diagonal entry counts as no information: the square of its inverse might overflow.
_NO_INFORMATION = 1e-150


@kernel
def solve_in_place(system: Array, n: int) -> bool:
    """
    Solve n equations by elimination with row pivots; return False if the matrix is singular.

    system (≥ n, ≥ n + 1) holds the matrix, and in column n the right side, which the solution
    replaces.
    """
    for j in range(n):
        pivot = j
        for i in range(j + 1, n):
            if abs(system[i, j]) > abs(system[pivot, j]):
                pivot = i
        if not abs(system[pivot, j]) > 0.0:
            return False
        if pivot != j:
            for column in range(j, n + 1):
                entry = system[j, column]
                system[j, column] = system[pivot, column]
                system[pivot, column] = entry
        inverse = 1.0 / system[j, j]
        for i in range(j + 1, n):
            factor = system[i, j] * inverse
            for column in range(j + 1, n + 1):
                system[i, column] -= factor * system[j, column]
    for j in range(n - 1, -1, -1):
        total = system[j, n]
        for column in range(j + 1, n):
            total -= system[j, column] * system[column, n]
        system[j, n] = total / system[j, j]
    return True


@kernel
def invert_information(information: Array, n: int, system: Array, inverse: Array) -> None:
    """
    Invert a symmetric matrix (≥ n, ≥ n) of mixed units into the first n rows of ``inverse``.

    Unknowns without information get a huge variance. system (≥ n, ≥ n) is workspace.
    """
    # In ``system``, above the diagonal U = Lᵀ, Cholesky's factor of the scaled matrix, on it
    # 1 / Uᵢᵢ, below it Y = L⁻¹; the inverse is YᵀY. The innermost loops run along rows and sum
    # nothing up, so that no addition waits for another.
    scales = inverse[n - 1]  # written last
    for i in range(n):
        entry = information[i, i]
        scales[i] = 1.0 / math.sqrt(entry) if entry > _NO_INFORMATION else 1.0
    for i in range(n):
        for j in range(i, n):
            system[i, j] = information[j, i] * (scales[i] * scales[j])
    for j in range(n):
        system[j, j] = 1.0 / math.sqrt(max(system[j, j], 0.0) + _RIDGE)
        for i in range(j + 1, n):
            system[j, i] *= system[j, j]
        for i in range(j + 1, n):
            factor = system[j, i]
            for m in range(i, n):
                system[i, m] -= factor * system[j, m]
    _invert_factor(n, system)
    for i in range(n - 1):
        for j in range(i + 1):
            inverse[i, j] = 0.0
    for m in range(n):
        for i in range(min(m + 1, n - 1)):
            factor = system[m, i]
            for j in range(i + 1):
                inverse[i, j] += factor * system[m, j]
    for i in range(n):
        own = scales[i]
        for j in range(i + 1):
            entry = inverse[i, j] if i < n - 1 else system[i, i] * system[i, j]
            inverse[i, j] = inverse[j, i] = entry * (own * scales[j])


@kernel
def _invert_factor(n: int, system: Array) -> None:
    """Write Y = L⁻¹ below the diagonal, which has 1 / Lᵢᵢ; above it is Lᵀ."""
    for i in range(n):
        for j in range(i):
            system[i, j] = 0.0
        for m in range(i):
            factor = system[m, i]
            for j in range(m + 1):
                system[i, j] -= factor * system[m, j]
        for j in range(i):
            system[i, j] *= system[i, i]


def inverse_of_information(information: Array) -> Array:
    """Invert a symmetric matrix (n, n) as `invert_information` does."""
    n = len(information)
    inverse = np.empty((n, n))
    if n == 0:
        return inverse
    # A copy: a read-only array would compile the kernel once more.
    invert_information(np.array(information, order='C'), n, np.empty((n, n + 1)), inverse)
    return inverse


@kernel
def copy_row(source: Array, target: Array) -> None:
    """Copy a one-dimensional array; slice assignment would allocate, as the two might overlap."""
    for i in range(len(target)):
        target[i] = source[i]


@kernel
def rotate(rotation: Array, wx: float, wy: float, wz: float, out: Array) -> None:
    """Write a rotation (9,), row by row, rotated by ω, radians in the target frame."""
    # The quaternion of the angle 2 atan(|ω|/2) agrees with exp(ω) to second order, enough for a
    # step of least squares, and is a rotation to rounding for every ω.
    s = 1.0 / (1.0 + 0.25 * (wx * wx + wy * wy + wz * wz)) ** 0.5
    x, y, z = 0.5 * s * wx, 0.5 * s * wy, 0.5 * s * wz
    for j in range(3):
        a, b, c = rotation[j], rotation[3 + j], rotation[6 + j]
        # A vector v rotates to  v + 2 s (q x v) + 2 q x (q x v).
        tx = 2.0 * (y * c - z * b)
        ty = 2.0 * (z * a - x * c)
        tz = 2.0 * (x * b - y * a)
        out[j] = a + s * tx + y * tz - z * ty
        out[3 + j] = b + s * ty + z * tx - x * tz
        out[6 + j] = c + s * tz + x * ty - y * tx


def smallest_positive_root(polynomial: Array) -> float:
    """
    Return the smallest positive root of a polynomial, given by ascending coefficients.

    Infinite if there is none; 0 if a coefficient is not finite.
    """
    if not np.isfinite(polynomial).all():
        return 0.0
    size = np.abs(polynomial)
    roots = poly.polyroots(poly.polytrim(np.where(size > _NEGLIGIBLE * size.max(), polynomial, 0)))
    real = roots.real[(np.abs(roots.imag) <= _NEARLY_REAL * np.abs(roots)) & (roots.real > 0.0)]
    return float(real.min()) if real.size else math.inf
