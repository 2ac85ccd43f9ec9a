# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""
Refinement of marker corners from the four edges, each fitted along its whole length.

A marker's corner itself carries little information: a few pixels, rounded by blur. Its edges are
long. In a strip along an edge the image is modelled as  a + b tanh(s e),  where e is the distance
to a parabola (a cubic for long edges), because a lens bends the edge; a marker's corner is the
intersection of two such curves.

This module stands alone: it is numerics, without OpenCV and boards, and has tests of its own.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from p4pfr_ros.core.geometry import Array, Mask
from p4pfr_ros.detection.fitting import fit_patches, sharpness

# Number of sample rows along an edge, and of samples per row. Each row is shifted against the one
# before by this fraction of the sample spacing, the golden ratio, so that all rows together
# resolve the edge's position finely.
_ROWS, _SAMPLES_PER_ROW = 24, 11
_SHIFT = 0.618034
# The ends of an edge are excluded, because blur bends them towards the next edges: a number of
# pixels, or a number of blur widths within these fractions of the edge's length.
_EXCLUDED_PX, _EXCLUDED_WIDTHS = 2.5, 2.0
_EXCLUDED_FRACTION = (0.03, 0.08)
# Half the width of the strip stays within the marker's black border. The first strip is wide, to
# contain an edge that the lens bends far off the straight line; later strips follow the curve of
# the previous fit.
_STRIP_IN_CELLS = 0.75
_MIN_STRIP_PX = 1.5
_MAX_STRIP_PX = (30.0, 5.0, 5.0)
_ITERATIONS = (10, 4, 4)
# Strong damping keeps the first steps short: long ones lose a strongly bent edge.
_FIRST_DAMPING = 1e-2
# On shorter edges, the noise outweighs the gain of a cubic over a parabola, pixels.
_MIN_CUBIC_PX = 80.0
_INTERSECTION_STEPS = 4
# Acceptance: a minimum contrast (outside minus inside), in grey levels, and a maximum rms
# residual, relative to the contrast.
_MIN_CONTRAST = 4.0
_MAX_RESIDUAL = 0.5
# Largest accepted shift of a corner: half a cell; for small cells a whole cell, within these
# limits in pixels.
_MAX_SHIFT_PX = (2.0, 3.0)


def refine_markers(grey: NDArray[np.uint8], corners: Array, cells: int) -> Array:
    """
    Refine the corners of black markers on white.

    Parameters
    ----------
    grey : (h, w) array
        The image.
    corners : (M, 4, 2) array
        Initial corners, accurate to a pixel or two, clockwise.
    cells
        Number of cells per side of a marker, black border included.

    Returns
    -------
    The refined corners (M, 4, 2). A marker with an edge that cannot be fitted keeps its corners.

    """
    if not len(corners):
        return corners
    edges = _Edges(corners)
    curves, blur_px = np.zeros((len(corners) * 4, 4)), np.zeros(len(corners) * 4)
    good: Mask = np.zeros(len(corners) * 4, dtype=bool)
    for max_strip_px, iterations in zip(_MAX_STRIP_PX, _ITERATIONS, strict=True):
        strip_px = _strip_px(corners, cells, max_strip_px)
        half_extent = _half_extent(edges, blur_px)
        curves, blur_px, good = _fit_once(grey, edges, curves, half_extent, strip_px, iterations)
    refined = _intersections(edges, curves).reshape(-1, 4, 2)
    # A corner that moved far belongs to a fit of some other edge.
    cell_px = 2.0 * edges.half_length.reshape(-1, 4).min(axis=1) / cells
    shift_px = np.linalg.norm(refined - corners, axis=2).max(axis=1)
    near = shift_px < np.maximum(np.clip(cell_px, *_MAX_SHIFT_PX), 0.5 * cell_px)
    accepted = near & good.reshape(-1, 4).all(axis=1)
    return np.where(accepted[:, None, None], refined, corners)


class _Edges:
    """
    The edges of M markers in order, each with its own frame.

    ``middle``, ``along`` and ``across`` (M * 4, 2) are its midpoint and unit directions (across
    points out of the marker); ``half_length`` (M * 4,) is in pixels.
    """

    def __init__(self, corners: Array) -> None:
        ends = np.roll(corners, -1, axis=1)
        half = (0.5 * (ends - corners)).reshape(-1, 2)
        self.middle = (0.5 * (corners + ends)).reshape(-1, 2)
        self.half_length = np.maximum(np.linalg.norm(half, axis=1), 1e-6)
        self.along = half / self.half_length[:, None]
        # Corners are clockwise in the image, y down: outwards is to the left of the direction.
        self.across = np.stack([self.along[:, 1], -self.along[:, 0]], axis=1)

    def points_at(self, u: Array, v_px: Array) -> Array:
        """Return the pixels (M * 4, m, 2) u half lengths along and v px across."""
        u_px = self.half_length[:, None] * u
        along = u_px[..., None] * self.along[:, None]
        points: Array = self.middle[:, None] + along + v_px[..., None] * self.across[:, None]
        return points


def _strip_px(corners: Array, cells: int, max_strip_px: float) -> Array:
    """Return half the width (M * 4,) of the strip along each edge, pixels."""
    normal = _Edges(corners).across.reshape(-1, 4, 2)
    opposite = [np.roll(corners, -2, axis=1), np.roll(corners, -3, axis=1)]
    depth = [np.abs(np.sum((far - corners) * normal, axis=2)) for far in opposite]
    cell_px = np.minimum(*depth).ravel() / cells
    strip_px: Array = np.clip(_STRIP_IN_CELLS * cell_px, _MIN_STRIP_PX, max_strip_px)
    return strip_px


def _half_extent(edges: _Edges, blur_px: Array) -> Array:
    """Return how far each strip (M * 4,) extends from the edge's midpoint, in half lengths."""
    length_px = 2.0 * edges.half_length
    by_blur = np.clip(_EXCLUDED_WIDTHS * blur_px / length_px, *_EXCLUDED_FRACTION)
    excluded = np.maximum(_EXCLUDED_PX / length_px, by_blur)
    half_extent: Array = np.maximum(1.0 - 2.0 * excluded, 0.5)
    return half_extent


def _fit_once(
    grey: NDArray[np.uint8],
    edges: _Edges,
    curves: Array,
    half_extent: Array,
    strip_px: Array,
    iterations: int,
) -> tuple[Array, Array, Mask]:
    """
    Refine the curves (M * 4, 4), each fitted in a strip around the given curve.

    Returns
    -------
    The curves, the blur widths (M * 4,) in pixels, and whether each fit (M * 4,) is accepted.

    """
    u, v = _samples()
    us = half_extent[:, None] * u
    vs_px = strip_px[:, None] * v + _curve_px(curves, us)
    levels, inside = _levels_at(grey, edges.points_at(us, vs_px))
    model = _EdgeProfile(us, vs_px, is_cubic=2.0 * edges.half_length > _MIN_CUBIC_PX)
    start = _start(curves, levels, v > 0.0, strip_px)
    fitted, rms = fit_patches(
        model, start, levels, inside, iterations, first_damping=_FIRST_DAMPING
    )
    contrast = fitted[:, 6]
    has_contrast = contrast > _MIN_CONTRAST
    good = has_contrast & (rms < _MAX_RESIDUAL * contrast)
    blur_px = np.where(has_contrast, 1.0 / sharpness(fitted[:, 4])[0], 0.0)
    return np.where(has_contrast[:, None], fitted[:, :4], curves), blur_px, good


def _samples() -> tuple[Array, Array]:
    """
    Return the sample positions in a strip, u along and v across (m,), from -1 to 1.

    With identical rows, a sharp edge would lie between the same two samples in every row, and its
    position between them would be undetermined.
    """
    u = np.repeat(np.linspace(-1.0, 1.0, _ROWS), _SAMPLES_PER_ROW)
    shift = _SHIFT * np.arange(_ROWS) % 1.0
    v = 2.0 / _SAMPLES_PER_ROW * (np.arange(_SAMPLES_PER_ROW) + shift[:, None]) - 1.0
    return u, v.ravel()


def _curve_px(curves: Array, u: Array) -> Array:
    """Return the offset across (M * 4, m), pixels, of the curves at u."""
    c0, c1, c2, c3 = (c[:, None] for c in curves.T)
    across: Array = c0 + u * (c1 + u * (c2 + u * c3))
    return across


def _levels_at(grey: NDArray[np.uint8], points: Array) -> tuple[Array, Array]:
    """Interpolate grey levels at pixels (N, m, 2); also return 1 inside, 0 outside the image."""
    height, width = grey.shape
    x, y = points[..., 0], points[..., 1]
    inside = (x >= 0) & (x <= width - 1) & (y >= 0) & (y <= height - 1)
    left = np.clip(np.floor(x), 0, max(width - 2, 0)).astype(np.int64)
    top = np.clip(np.floor(y), 0, max(height - 2, 0)).astype(np.int64)
    dx, dy = np.clip(x - left, 0.0, 1.0), np.clip(y - top, 0.0, 1.0)
    right, bottom = np.minimum(left + 1, width - 1), np.minimum(top + 1, height - 1)
    upper = grey[top, left] * (1.0 - dx) + grey[top, right] * dx
    lower = grey[bottom, left] * (1.0 - dx) + grey[bottom, right] * dx
    return upper * (1.0 - dy) + lower * dy, inside.astype(float)


def _start(curves: Array, levels: Array, is_outside: Mask, strip_px: Array) -> Array:
    """Return initial parameters (M * 4, 7): the curve's four, sharpness, mean, contrast."""
    outer = levels[:, is_outside].mean(axis=1)
    inner = levels[:, ~is_outside].mean(axis=1)
    # An initial edge as soft as the strip is wide converges from anywhere in the strip.
    soft = -np.log(np.maximum(strip_px - 1.0, 0.5))
    return np.column_stack([curves, soft, 0.5 * (outer + inner), 0.5 * (outer - inner)])


@dataclass(frozen=True, slots=True, eq=False)
class _EdgeProfile:
    """The model of the strips with samples at u, v_px (M * 4, m)."""

    u: Array
    v_px: Array
    is_cubic: Mask

    def evaluate(self, parameters: Array) -> tuple[Array, Array]:
        """Return a + b tanh(s (v - curve(u))), and its derivatives (M * 4, m, 7)."""
        u = self.u
        q, a, b = (column[:, None] for column in parameters[:, 4:].T)
        s, s_by_q = sharpness(q)
        e = self.v_px - _curve_px(parameters[:, :4], u)
        tanh = np.tanh(s * e)
        by_se = b * (1.0 - tanh**2)
        by_e = s * by_se
        by_c3 = -by_e * u**3 * self.is_cubic[:, None]
        by_q = s_by_q * by_se * e
        derivatives = [-by_e, -by_e * u, -by_e * u**2, by_c3, by_q, np.ones_like(e), tanh]
        return a + b * tanh, np.stack(derivatives, axis=-1)


def _intersections(edges: _Edges, curves: Array) -> Array:
    """Return (M * 4, 2): the intersection of each edge's curve with that of the previous edge."""
    previous = np.roll(np.arange(len(curves)).reshape(-1, 4), 1, axis=1).ravel()
    begin, end = np.full(len(curves), -1.0), np.full(len(curves), 1.0)
    for _ in range(_INTERSECTION_STEPS):
        # Newton's method on  p(begin) = q(end):  p + p' du = q + q' dw.
        p, p_slope = _point_and_slope(edges, curves, begin)
        q, q_slope = (each[previous] for each in _point_and_slope(edges, curves, end))
        determinant = _cross(p_slope, q_slope)
        determinant = np.where(np.abs(determinant) < 1e-9, np.inf, determinant)  # parallel: stay
        begin = np.clip(begin + _cross(q - p, q_slope) / determinant, -1.5, -0.5)
        end[previous] = np.clip(end[previous] + _cross(q - p, p_slope) / determinant, 0.5, 1.5)
    return _point_and_slope(edges, curves, begin)[0]


def _point_and_slope(edges: _Edges, curves: Array, u: Array) -> tuple[Array, Array]:
    """Return the point (M * 4, 2) of each edge's curve at u (M * 4,), and its derivative by u."""
    across_px = _curve_px(curves, u[:, None])
    rise = curves[:, 1] + u * (2.0 * curves[:, 2] + u * 3.0 * curves[:, 3])
    slope = edges.half_length[:, None] * edges.along + rise[:, None] * edges.across
    return edges.points_at(u[:, None], across_px)[:, 0], slope


def _cross(a: Array, b: Array) -> Array:
    product: Array = a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]
    return product
