# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""Counts the real roots of the sextic with f² > 0, by the signs of depths and of Z."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from p4pfr_ros.core.geometry import Array, Mask
from p4pfr_ros.core.jit import jit
from p4pfr_ros.core.minimal.cone import board_weights, Cone
from p4pfr_ros.core.minimal.four import Four, four_of, Points, points_of, times
from p4pfr_ros.core.minimal.pose import scale_board, scale_image
from p4pfr_ros.core.minimal.sextic import coefficients, factors

Complexes = NDArray[np.complex128]

_BINOMIALS = np.array([1.0, 6.0, 15.0, 20.0, 15.0, 6.0, 1.0])

# Largest imaginary part, relative to 1 + |s|, of an eigenvalue that counts as real.
_REAL_TOLERANCE = 1e-9


class Counts(NamedTuple):
    """Numbers of real roots with f² > 0."""

    real: int
    depths_of_one_sign: int  # all four λ: the rays of the pixels meet the points
    z_of_one_sign: int  # all four λ (1 + k r²): the points lie on one side of the camera


def count(image: Array, board: Array) -> Counts:
    """Count the roots of n instances, image and board points (n, 4, 2)."""
    n_instances = len(image)
    polynomials = np.zeros((n_instances, 7))
    basis = np.zeros((n_instances, 2, 4))
    ends = np.zeros((n_instances, 2, 4), dtype=np.complex128)  # of u, v, l, p
    weights, radius2 = np.zeros((n_instances, 4)), np.zeros((n_instances, 4))
    _expand_all(image, board, polynomials, basis, ends, weights, radius2)
    s = _roots(polynomials)
    instance, root = np.nonzero(np.abs(s.imag) < _REAL_TOLERANCE * (1.0 + np.abs(s)))
    share = s[instance, root].real[:, None]
    depths = basis[instance, 0] + share * basis[instance, 1]
    u, v, l, p = (ends[instance, 0] + share * ends[instance, 1]).T  # noqa: E741
    m, r2 = weights[instance], radius2[instance]
    n, d = np.sum(m * depths, axis=1), np.sum(m * depths * r2, axis=1)
    z = d * l - n * p
    focal_is_real = (u * v * np.conj(z) ** 2).real < 0.0
    z_of_points = depths * (d[:, None] - n[:, None] * r2)
    return Counts(
        int(np.sum(focal_is_real)),
        int(np.sum(focal_is_real & _one_sign(depths))),
        int(np.sum(focal_is_real & _one_sign(z_of_points))),
    )


@jit
def _expand_all(
    image: Array,
    board: Array,
    polynomials: Array,
    basis: Array,
    ends: Complexes,
    weights: Array,
    radius2: Array,
) -> None:
    for i in range(len(image)):
        _, scaled, radius = scale_image(points_of(image[i]))
        _, m = board_weights(points_of(board[i]))
        weights[i, :] = m
        radius2[i, :] = times(radius, radius)
        _null_space(scaled, m, basis[i])
        # λ = basis[0] + s basis[1] with s = τ / (1 - τ), on the whole real line instead of [0, 1].
        cone = Cone(True, four_of(basis[i, 0]), four_of(basis[i, 1]))
        f = factors(scaled, m, cone, scale_board(points_of(board[i])).duals)
        ends[i, 0, :] = (f.u0, f.v0, f.l0, f.p0)
        ends[i, 1, :] = (f.u1, f.v1, f.l1, f.p1)
        bernstein = coefficients(f, 0.0, 1.0)
        for j in range(7):
            polynomials[i, j] = _BINOMIALS[j] * bernstein[j]


@jit
def _null_space(image: Points, m: Four, basis: Array) -> None:
    """Write two vectors λ (2, 4) with Σ λᵢ mᵢ (xᵢ, yᵢ) = 0, the largest entry of each about 1."""
    for vector, j in ((0, 2), (1, 3)):
        # Cramer's rule on the points 0, 1 and j.
        basis[vector, :] = 0.0
        basis[vector, 0] = m[1] * m[j] * _cross(image, 1, j)
        basis[vector, 1] = m[j] * m[0] * _cross(image, j, 0)
        basis[vector, j] = m[0] * m[1] * _cross(image, 0, 1)
        basis[vector] /= np.abs(basis[vector]).max()


@jit
def _cross(image: Points, i: int, j: int) -> float:
    value: float = image.x[i] * image.y[j] - image.y[i] * image.x[j]
    return value


def _roots(polynomials: Array) -> Complexes:
    """Return all six roots of polynomials (n, 7), constant term first."""
    companion = np.zeros((len(polynomials), 6, 6))
    companion[:, range(1, 6), range(5)] = 1.0
    companion[:, :, 5] = -polynomials[:, :6] / polynomials[:, 6:]
    roots: Complexes = np.linalg.eigvals(companion).astype(np.complex128)
    return roots


def _one_sign(values: Array) -> Mask:
    return np.logical_or((values > 0.0).all(axis=1), (values < 0.0).all(axis=1))
