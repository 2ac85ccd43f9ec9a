# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""
The corners of a marker from its four edges, each fitted along its whole length.

A marker's corner itself says little: four pixels of it, rounded by the lens's blur. Its edges are
long. In a strip along an edge the picture is modelled as  a + b tanh(s e),  with e the distance
to a parabola, for a lens bends the edge (to a cubic where the edge is long); a marker's corner is
where two such curves meet.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from p4pfr_ros.core.geometry import Array, Mask
from p4pfr_ros.detection.fitting import fit_patches, sharpness

# Rows of samples across an edge, and samples in a row. From row to row they are shifted by this
# part of their spacing, the golden ratio: all rows together see an edge's place finely.
_ALONG, _ACROSS = 24, 11
_SHIFT = 0.618034
# An edge's ends, which blur bends towards the next edges, are left out: so many pixels, or so many
# widths of the blur within these parts of its length.
_LEFT_OUT_PX, _LEFT_OUT_WIDTHS = 2.5, 2.0
_LEFT_OUT_PARTS = (0.03, 0.08)
# A strip stays within the marker's black border. The first one is wide, to hold an edge that the
# lens bends far off the straight line; the others follow the curve that the one before has found.
_STRIP_IN_CELLS = 0.75
_NARROWEST_PX = 1.5
_WIDEST_PX = (30.0, 5.0, 5.0)
_ITERATIONS = (10, 4, 4)
# The first steps are short: long ones lose an edge that the lens bends far.
_FIRST_DAMPING = 1e-2
# On shorter edges the noise outweighs what a cubic describes better than a parabola, pixels.
_SHORTEST_CUBIC_PX = 80.0
_INTERSECTION_STEPS = 4
# What a real edge shows: some contrast, in grey levels, brighter outside; and little else than the
# model, as a part of the contrast.
_LEAST_CONTRAST = 4.0
_MOST_RESIDUAL = 0.5
# A corner may move by half of a cell; where cells are small by a whole one, but no less and no
# more than so many pixels.
_MOST_MOVED_PX = (2.0, 3.0)


def refine_markers(grey: NDArray[np.uint8], corners: Array, cells: int) -> Array:
    """
    Refine the corners of black markers on white.

    Parameters
    ----------
    grey : (h, w) array
        The picture.
    corners : (M, 4, 2) array
        Corners to within a pixel or two, clockwise.
    cells
        Number of a marker's cells from edge to edge, with its black border.

    Returns
    -------
    The corners (M, 4, 2), refined; a marker of which an edge cannot be fitted keeps its corners.

    """
    if not len(corners):
        return corners
    edges = _Edges(corners)
    curves, blur_px = np.zeros((len(corners) * 4, 4)), np.zeros(len(corners) * 4)
    good: Mask = np.zeros(len(corners) * 4, dtype=bool)
    for widest_px, iterations in zip(_WIDEST_PX, _ITERATIONS, strict=True):
        strip_px = _strip_px(corners, cells, widest_px)
        reach = _reach(edges, blur_px)
        curves, blur_px, good = _fit_once(grey, edges, curves, reach, strip_px, iterations)
    refined = _meet(edges, curves).reshape(-1, 4, 2)
    # An edge that ran away took hold of something else.
    cell_px = 2.0 * edges.half_length.reshape(-1, 4).min(axis=1) / cells
    moved_px = np.linalg.norm(refined - corners, axis=2).max(axis=1)
    near = moved_px < np.maximum(np.clip(cell_px, *_MOST_MOVED_PX), 0.5 * cell_px)
    fitted = near & good.reshape(-1, 4).all(axis=1)
    return np.where(fitted[:, None, None], refined, corners)


class _Edges:
    """
    The edges of M markers, one after the other, each with a frame of its own.

    ``middle``, ``along`` and ``across`` (M * 4, 2) are its middle and unit directions (across
    points out of the marker), ``half_length`` (M * 4,) is in pixels.
    """

    def __init__(self, corners: Array) -> None:
        ends = np.roll(corners, -1, axis=1)
        half = (0.5 * (ends - corners)).reshape(-1, 2)
        self.middle = (0.5 * (corners + ends)).reshape(-1, 2)
        self.half_length = np.maximum(np.linalg.norm(half, axis=1), 1e-6)
        self.along = half / self.half_length[:, None]
        # Corners run clockwise as seen, y down: outwards is to the left of the direction.
        self.across = np.stack([self.along[:, 1], -self.along[:, 0]], axis=1)

    def places(self, u: Array, v_px: Array) -> Array:
        """Return the places (M * 4, m, 2) that are u half lengths along and v px across."""
        u_px = self.half_length[:, None] * u
        along = u_px[..., None] * self.along[:, None]
        places: Array = self.middle[:, None] + along + v_px[..., None] * self.across[:, None]
        return places


def _strip_px(corners: Array, cells: int, widest_px: float) -> Array:
    """Return half the width (M * 4,) of the strip along each edge, pixels."""
    normal = _Edges(corners).across.reshape(-1, 4, 2)
    opposite = [np.roll(corners, -2, axis=1), np.roll(corners, -3, axis=1)]
    depth = [np.abs(np.sum((far - corners) * normal, axis=2)) for far in opposite]
    cell_px = np.minimum(*depth).ravel() / cells
    strip: Array = np.clip(_STRIP_IN_CELLS * cell_px, _NARROWEST_PX, widest_px)
    return strip


def _reach(edges: _Edges, blur_px: Array) -> Array:
    """Return how far from its middle, in half lengths, each edge (M * 4,) is looked at."""
    length_px = 2.0 * edges.half_length
    by_blur = np.clip(_LEFT_OUT_WIDTHS * blur_px / length_px, *_LEFT_OUT_PARTS)
    left_out = np.maximum(_LEFT_OUT_PX / length_px, by_blur)
    reach: Array = np.maximum(1.0 - 2.0 * left_out, 0.5)
    return reach


def _fit_once(
    grey: NDArray[np.uint8],
    edges: _Edges,
    curves: Array,
    reach: Array,
    strip_px: Array,
    iterations: int,
) -> tuple[Array, Array, Mask]:
    """
    Return better curves (M * 4, 4), fitted in a strip around the given ones.

    With them come the widths (M * 4,) of the edges' blur, pixels, and whether what the strips
    show (M * 4,) looks like an edge.
    """
    u, v = _samples()
    us = reach[:, None] * u
    vs_px = strip_px[:, None] * v + _curve(curves, us)
    levels, inside = _levels_at(grey, edges.places(us, vs_px))
    is_cubic = 2.0 * edges.half_length > _SHORTEST_CUBIC_PX

    def model(parameters: Array) -> tuple[Array, Array]:
        return _edge(parameters, us, vs_px, is_cubic)

    start = _start(curves, levels, v > 0.0, strip_px)
    fitted, rms = fit_patches(
        model, start, levels, inside, iterations, first_damping=_FIRST_DAMPING
    )
    contrast = fitted[:, 6]
    found = contrast > _LEAST_CONTRAST
    good = found & (rms < _MOST_RESIDUAL * contrast)
    blur_px = np.where(found, 1.0 / sharpness(fitted[:, 4])[0], 0.0)
    return np.where(found[:, None], fitted[:, :4], curves), blur_px, good


def _samples() -> tuple[Array, Array]:
    """
    Return where in a strip samples are taken, u along and v across (m,), from -1 to 1.

    Were the rows alike, a sharp edge would lie between the same two samples of all of them, and
    nothing would tell where.
    """
    u = np.repeat(np.linspace(-1.0, 1.0, _ALONG), _ACROSS)
    shift = _SHIFT * np.arange(_ALONG) % 1.0
    v = 2.0 / _ACROSS * (np.arange(_ACROSS) + shift[:, None]) - 1.0
    return u, v.ravel()


def _curve(curves: Array, u: Array) -> Array:
    """Return how far across (M * 4, m), pixels, the curves are at u."""
    c0, c1, c2, c3 = (c[:, None] for c in curves.T)
    across: Array = c0 + u * (c1 + u * (c2 + u * c3))
    return across


def _levels_at(grey: NDArray[np.uint8], places: Array) -> tuple[Array, Array]:
    """Interpolate grey levels at places (N, m, 2), with 1 where they are in the image, else 0."""
    height, width = grey.shape
    x, y = places[..., 0], places[..., 1]
    inside = (x >= 0) & (x <= width - 1) & (y >= 0) & (y <= height - 1)
    left = np.clip(np.floor(x), 0, max(width - 2, 0)).astype(np.int64)
    top = np.clip(np.floor(y), 0, max(height - 2, 0)).astype(np.int64)
    dx, dy = np.clip(x - left, 0.0, 1.0), np.clip(y - top, 0.0, 1.0)
    right, bottom = np.minimum(left + 1, width - 1), np.minimum(top + 1, height - 1)
    upper = grey[top, left] * (1.0 - dx) + grey[top, right] * dx
    lower = grey[bottom, left] * (1.0 - dx) + grey[bottom, right] * dx
    return upper * (1.0 - dy) + lower * dy, inside.astype(float)


def _start(curves: Array, levels: Array, is_outside: Mask, strip_px: Array) -> Array:
    """Return parameters (M * 4, 7): the curve's four, sharpness, mean, contrast."""
    outer = levels[:, is_outside].mean(axis=1)
    inner = levels[:, ~is_outside].mean(axis=1)
    # An edge as soft as the strip is wide draws the curve from afar.
    soft = -np.log(np.maximum(strip_px - 1.0, 0.5))
    return np.column_stack([curves, soft, 0.5 * (outer + inner), 0.5 * (outer - inner)])


def _edge(parameters: Array, u: Array, v_px: Array, is_cubic: Mask) -> tuple[Array, Array]:
    """Return a + b tanh(s (v - curve(u))), and its derivatives (M * 4, m, 7)."""
    q, a, b = (column[:, None] for column in parameters[:, 4:].T)
    s, s_by_q = sharpness(q)
    e = v_px - _curve(parameters[:, :4], u)
    tanh = np.tanh(s * e)
    by_se = b * (1.0 - tanh**2)
    by_e = s * by_se
    cubic = -by_e * u**3 * is_cubic[:, None]
    slopes = [-by_e, -by_e * u, -by_e * u**2, cubic, s_by_q * by_se * e, np.ones_like(e), tanh]
    return a + b * tanh, np.stack(slopes, axis=-1)


def _meet(edges: _Edges, curves: Array) -> Array:
    """Return (M * 4, 2): where each edge's curve is met by that of the edge before it."""
    before = np.roll(np.arange(len(curves)).reshape(-1, 4), 1, axis=1).ravel()
    begin, end = np.full(len(curves), -1.0), np.full(len(curves), 1.0)
    for _ in range(_INTERSECTION_STEPS):
        # Newton on  p(begin) = q(end):  p + p' du = q + q' dw.
        p, p_slope = _point_and_slope(edges, curves, begin)
        q, q_slope = (of_all[before] for of_all in _point_and_slope(edges, curves, end))
        across = _cross(p_slope, q_slope)
        across = np.where(np.abs(across) < 1e-9, np.inf, across)  # parallel: stay
        begin = np.clip(begin + _cross(q - p, q_slope) / across, -1.5, -0.5)
        end[before] = np.clip(end[before] + _cross(q - p, p_slope) / across, 0.5, 1.5)
    return _point_and_slope(edges, curves, begin)[0]


def _point_and_slope(edges: _Edges, curves: Array, u: Array) -> tuple[Array, Array]:
    """Return, of each edge, the point (M * 4, 2) of its curve at u, and its derivative by u."""
    across = _curve(curves, u[:, None])
    rise = curves[:, 1] + u * (2.0 * curves[:, 2] + u * 3.0 * curves[:, 3])
    slope = edges.half_length[:, None] * edges.along + rise[:, None] * edges.across
    return edges.places(u[:, None], across)[:, 0], slope


def _cross(a: Array, b: Array) -> Array:
    product: Array = a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]
    return product
