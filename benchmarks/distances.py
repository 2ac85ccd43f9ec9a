# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""Residuals of solved instances: RMS distance over the four points, by three definitions."""

from __future__ import annotations

import numpy as np
from p4pfr_ros.core.geometry import Array, TRANSLATION
from p4pfr_ros.core.minimal.solution import G, H

from .standard_normal import Solved


def undistorted(solved: Solved) -> Array:
    """Return the RMS (s,) of f X/Z - x / (1 + k r²), with a true rotation."""
    points = _in_camera(solved)
    focal = solved.rows[:, G, None, None]
    observed = solved.image / horizon(solved)[..., None]
    return _rms(focal * points[..., :2] / points[..., 2:] - observed)


def in_image(solved: Solved) -> Array:
    """Return the RMS (s,) of projection - pixel, on the branch of the fold that has the pixel."""
    points = _in_camera(solved)
    focal, h = solved.rows[:, G, None], solved.rows[:, H, None]
    xy, z = points[..., :2], points[..., 2]
    # x = s X with g + h r² = s Z:  h ρ² s² - Z s + g = 0. Each form is accurate on its side.
    rho2 = np.sum(xy**2, axis=-1)
    root = np.sqrt(np.maximum(z**2 - 4.0 * focal * h * rho2, 0.0))
    with np.errstate(divide='ignore', invalid='ignore'):
        near = np.where(z < 0.0, (z - root) / (2.0 * h * rho2), 2.0 * focal / (z + root))
        far = (z + root) / (2.0 * h * rho2)
    unfolded = h * np.sum(solved.image**2, axis=-1) < focal
    scale = np.where(unfolded, near, far)
    return _rms(scale[..., None] * xy - solved.image)


def paper(solved: Solved, nearest_horizon: bool) -> Array:
    """
    Return the residual (s,) in the paper's sense: of P = [h₁ h₂ t], columns as computed.

    The points Q of the sextic's root are an affine image of the board: H maps the board's edges
    from one point to those of Q. The choice of this point affects only rounding: it is the first,
    or the one with the smallest |1 + k r²|, where rounding matters most.
    """
    m = _weights(solved.board)
    r2 = np.sum(solved.image**2, axis=-1)
    weighted = m * solved.depths
    k = -np.sum(weighted, axis=-1) / np.sum(weighted * r2, axis=-1)
    w = 1.0 + k[:, None] * r2
    corners = solved.depths[..., None] * np.concatenate([solved.image, w[..., None]], axis=-1)
    order = (
        np.argsort(np.abs(w), axis=-1) if nearest_horizon else np.tile(np.arange(4), (len(m), 1))
    )
    # Of the triangles that this point forms with two others, take the largest: the weight of the
    # omitted point is its area.
    others = order[:, 1:]
    missing = np.argmax(np.abs(np.take_along_axis(m, others, axis=1)), axis=1)
    keep = np.array([[1, 2], [0, 2], [0, 1]])[missing]
    base = np.column_stack([order[:, 0], np.take_along_axis(others, keep, axis=1)])
    flat = np.take_along_axis(solved.board, base[..., None], axis=1)
    spatial = np.take_along_axis(corners, base[..., None], axis=1)
    inverse = _inverse2(flat[:, 1:] - flat[:, :1])
    shares = (solved.board - flat[:, :1]) @ inverse
    points = shares @ (spatial[:, 1:] - spatial[:, :1]) + spatial[:, :1]
    return _rms(points[..., :2] / points[..., 2:] - solved.image / w[..., None])


def horizon(solved: Solved) -> Array:
    """Return 1 + k r² of all points (s, 4); zero is 90° from the axis."""
    k = solved.rows[:, H] / solved.rows[:, G]
    w: Array = 1.0 + k[:, None] * np.sum(solved.image**2, axis=-1)
    return w


def rounding(solved: Solved) -> Array:
    """Return how far (s,) a rounding of k by half an ulp moves the undistorted points."""
    w = horizon(solved)[..., None]
    return _rms(0.5 * np.finfo(float).eps * np.abs(1.0 - w) / w**2 * solved.image)


def _in_camera(solved: Solved) -> Array:
    rotation = solved.rows[:, :TRANSLATION].reshape(-1, 3, 3)
    rotated = np.einsum('nij,npj->npi', rotation[:, :, :2], solved.board)
    points: Array = rotated + solved.rows[:, None, TRANSLATION:G]
    return points


def _rms(vectors: Array) -> Array:
    rms: Array = np.sqrt(np.mean(np.sum(vectors**2, axis=-1), axis=-1))
    return rms


def _weights(board: Array) -> Array:
    """Return m (s, 4) with Σ mᵢ (Xᵢ, Yᵢ, 1) = 0: the areas of the triangles that omit point i."""

    def area(i: int, j: int, k: int) -> Array:
        a, b = board[:, j] - board[:, i], board[:, k] - board[:, i]
        cross: Array = a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]
        return cross

    return np.column_stack([area(1, 2, 3), -area(0, 2, 3), area(0, 1, 3), -area(0, 1, 2)])


def _inverse2(matrices: Array) -> Array:
    a, b, c, d = (matrices[:, i, j] for i in (0, 1) for j in (0, 1))
    adjugate = np.stack([d, -b, -c, a], axis=-1).reshape(-1, 2, 2)
    inverse: Array = adjugate / (a * d - b * c)[:, None, None]
    return inverse
