# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""
Refinement of chessboard corners, where four squares meet, to hundredths of a pixel.

The image around a corner is modelled as  a + b tanh(s e₁) tanh(s e₂),  where e₁ and e₂ are the
distances to the two lines that cross there, and fitted by least squares over a patch that is
round on the board. The seven parameters are the corner, the angles of the two lines, the
sharpness s, the mean a and the contrast b. The error is about a third of that of OpenCV's
cornerSubPix.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from p4pfr_ros.core.geometry import Array, Mask
from p4pfr_ros.detection.fitting import fit_patches, sharpness

_MIN_RADIUS_PX, _MAX_RADIUS_PX = 2.5, 8.0
# Initial sharpness parameter q of each pass; each pass recentres the patches. The first pass
# starts with soft edges, which converge from farther away.
_START_SHARPNESS = (-2.0, 0.0)
_ITERATIONS = 5
# Acceptance: a minimum contrast, in grey levels; a minimum fraction of the patch inside the image;
# a maximum rms residual, relative to the contrast.
_MIN_CONTRAST = 4.0
_MIN_INSIDE = 0.7
_MAX_RESIDUAL = 0.5


@dataclass(frozen=True, slots=True, eq=False)
class Saddles:
    """
    Fitted corners.

    Parameters
    ----------
    points : (N, 2) array
        Pixels.
    good : (N,) array
        Whether the fit was accepted.

    """

    points: Array
    good: Mask


def refine_saddles(
    grey: NDArray[np.uint8], points: Array, along: Array, across: Array, radius: float
) -> Saddles:
    """
    Fit the corners of a chessboard near given points.

    Parameters
    ----------
    grey : (h, w) array
        The image.
    points : (N, 2) array
        Initial corners, pixels.
    along, across : (N, 2) arrays
        Sides of a square at each corner, along the two lines that cross there, pixels.
    radius
        Radius of the patch, in squares; limited to 8 px, because a lens bends the lines.

    """
    squares = np.stack([along, across], axis=2)
    shortest_px = np.linalg.norm(squares, axis=1).min(axis=1)
    radii = np.maximum(radius, _MIN_RADIUS_PX / np.maximum(shortest_px, 1e-6))
    start = points
    for q in _START_SHARPNESS:
        fitted, residual, inside = _fit_once(grey, start, squares, radii, q)
        start = fitted[:, :2]
    contrast = np.abs(fitted[:, 6])
    moved_px = np.linalg.norm(start - points, axis=1)
    good = (
        (contrast > _MIN_CONTRAST)
        & (residual < _MAX_RESIDUAL * contrast)
        & (moved_px < np.clip(radii * shortest_px, _MIN_RADIUS_PX, _MAX_RADIUS_PX))
        & (inside > _MIN_INSIDE)
    )
    return Saddles(start, good)


def _fit_once(
    grey: NDArray[np.uint8], points: Array, squares: Array, radii: Array, q: float
) -> tuple[Array, Array, Array]:
    """Return parameters (N, 7), rms residuals (N,) and the patch fractions (N,) in the image."""
    # A diverged fit has no patch; its distance from the initial corner rejects it later.
    points = np.clip(np.nan_to_num(points), -100.0, 1e6)
    x, y, observed, inside = _patches(grey, points, int(np.ceil(1.12 * _MAX_RADIUS_PX)))
    patch_weights = _patch_weights(x - points[:, :1], y - points[:, 1:], squares, radii)
    weights = inside * patch_weights
    model = _CrossingLines(x, y)
    start = _start(points, squares, observed, weights)
    start[:, 4] = q
    start[:, 6] *= _contrast_sign(model, start, observed, weights)
    fitted, residual = fit_patches(model, start, observed, weights, _ITERATIONS)
    return fitted, residual, weights.sum(axis=1) / np.maximum(patch_weights.sum(axis=1), 1e-9)


def _patch_weights(dx: Array, dy: Array, squares: Array, radii: Array) -> Array:
    """Return the weights (N, m) of pixels: 1 near the corner, 0 beyond the radius."""
    # A circle on the board is an ellipse in the image: it stays equally clear, on all sides, of
    # the neighbouring corners and markers.
    (a, c), (b, d) = np.moveaxis(squares, (1, 2), (1, 0))[..., None]
    area = a * d - b * c
    area = np.where(np.abs(area) < 1e-6, 1e-6, area)
    on_board2 = ((d * dx - b * dy) ** 2 + (a * dy - c * dx) ** 2) / (area * radii[:, None]) ** 2
    in_image2 = (dx**2 + dy**2) / _MAX_RADIUS_PX**2
    weights: Array = np.clip(1.25 - np.maximum(on_board2, in_image2), 0.0, 1.0)
    return weights


def _patches(
    grey: NDArray[np.uint8], points: Array, half: int
) -> tuple[Array, Array, Array, Array]:
    """Return x, y, grey level, and 1 inside or 0 outside the image, of the pixels at points."""
    height, width = grey.shape
    offset = np.arange(-half, half + 1)
    dy, dx = (o.ravel() for o in np.meshgrid(offset, offset, indexing='ij'))
    centre = np.rint(points).astype(np.int64)
    x, y = centre[:, :1] + dx, centre[:, 1:] + dy
    inside = (x >= 0) & (x < width) & (y >= 0) & (y < height)
    levels = grey[np.clip(y, 0, height - 1), np.clip(x, 0, width - 1)]
    return x.astype(float), y.astype(float), levels.astype(float), inside.astype(float)


def _start(points: Array, squares: Array, observed: Array, weights: Array) -> Array:
    """Return parameters (N, 7): x, y, the two angles, sharpness, mean, contrast."""
    total = np.maximum(weights.sum(axis=1), 1e-9)
    mean = (weights * observed).sum(axis=1) / total
    sigma = np.sqrt((weights * (observed - mean[:, None]) ** 2).sum(axis=1) / total)
    angles = np.arctan2(squares[:, 1], squares[:, 0])
    return np.stack([*points.T, *angles.T, np.zeros(len(points)), mean, sigma], axis=1)


@dataclass(frozen=True, slots=True, eq=False)
class _CrossingLines:
    """The model of the patches with pixels x, y (N, m)."""

    x: Array
    y: Array

    def evaluate(self, parameters: Array) -> tuple[Array, Array]:
        """Return a + b tanh(s e₁) tanh(s e₂) at the pixels, and its derivatives (N, m, 7)."""
        x0, y0, angle1, angle2, q, a, b = (column[:, None] for column in parameters.T)
        s, s_by_q = sharpness(q)
        dx, dy = self.x - x0, self.y - y0
        cos1, sin1, cos2, sin2 = np.cos(angle1), np.sin(angle1), np.cos(angle2), np.sin(angle2)
        e1, e2 = cos1 * dy - sin1 * dx, cos2 * dy - sin2 * dx
        tanh1, tanh2 = np.tanh(s * e1), np.tanh(s * e2)
        by_se1, by_se2 = b * (1.0 - tanh1**2) * tanh2, b * (1.0 - tanh2**2) * tanh1
        by_e1, by_e2 = s * by_se1, s * by_se2
        derivatives = [
            by_e1 * sin1 + by_e2 * sin2,
            -by_e1 * cos1 - by_e2 * cos2,
            -by_e1 * (cos1 * dx + sin1 * dy),
            -by_e2 * (cos2 * dx + sin2 * dy),
            s_by_q * (by_se1 * e1 + by_se2 * e2),
            np.ones_like(self.x),
            tanh1 * tanh2,
        ]
        return a + b * tanh1 * tanh2, np.stack(derivatives, axis=-1)


def _contrast_sign(model: _CrossingLines, start: Array, observed: Array, weights: Array) -> Array:
    """Return the sign (N,) of the contrast that agrees with the observed levels."""
    shape = model.evaluate(start)[1][..., 6]
    correlation = (weights * (observed - start[:, 5:6]) * shape).sum(axis=1)
    return np.where(correlation < 0.0, -1.0, 1.0)
