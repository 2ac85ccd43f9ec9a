# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""Small linear algebra for the kernels, without allocation."""

from __future__ import annotations

import math

from .geometry import Array
from .jit import jit, kernel

# On the diagonal of a scaled matrix, so that it can always be inverted.
_NO_INFORMATION = 1e-11


@kernel
def solve_in_place(system: Array, n: int) -> bool:
    """
    Solve n equations by elimination with row pivots; the answer is column n.

    system is (≥ n, ≥ n + 1): the matrix, and in column n the right side. False: it is singular.
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
                kept = system[j, column]
                system[j, column] = system[pivot, column]
                system[pivot, column] = kept
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


@jit
def invert_information(information: Array, system: Array, inverse: Array) -> None:
    """
    Invert a symmetric matrix (n, n) of mixed units; what it does not hold gets a huge variance.

    system (≥ n, ≥ n + 1) is room to work in.
    """
    n = len(inverse)
    for j in range(n):
        for a in range(n):
            for b in range(n):
                system[a, b] = information[a, b] / (_size(information, a) * _size(information, b))
            system[a, a] += _NO_INFORMATION
            system[a, n] = 1.0 if a == j else 0.0
        solve_in_place(system, n)
        for a in range(n):
            inverse[a, j] = system[a, n] / (_size(information, a) * _size(information, j))


@kernel
def _size(information: Array, a: int) -> float:
    """Return the root of an entry of the diagonal; 1 where it is 0, or rounding below it."""
    return math.sqrt(information[a, a]) if information[a, a] > 0.0 else 1.0


@kernel
def copy_row(source: Array, target: Array) -> None:
    """Copy one-dimensional arrays; a slice's assignment would allocate, as they might overlap."""
    for i in range(len(target)):
        target[i] = source[i]


@kernel
def rotate(rotation: Array, wx: float, wy: float, wz: float, out: Array) -> None:
    """Turn a rotation (nine numbers, row by row) by ω, radians in the target frame."""
    # The quaternion of the angle 2 atan(|ω|/2) agrees with exp(ω) to second order, which is all
    # that a step of least squares needs, and it is a rotation, to rounding, at every size.
    s = 1.0 / (1.0 + 0.25 * (wx * wx + wy * wy + wz * wz)) ** 0.5
    x, y, z = 0.5 * s * wx, 0.5 * s * wy, 0.5 * s * wz
    for j in range(3):
        a, b, c = rotation[j], rotation[3 + j], rotation[6 + j]
        # A vector v turns to  v + 2 s (q x v) + 2 q x (q x v).
        tx = 2.0 * (y * c - z * b)
        ty = 2.0 * (z * a - x * c)
        tz = 2.0 * (x * b - y * a)
        out[j] = a + s * tx + y * tz - z * ty
        out[3 + j] = b + s * ty + z * tx - x * tz
        out[6 + j] = c + s * tz + x * ty - y * tx
