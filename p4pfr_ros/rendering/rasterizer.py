# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""
Exact area coverage of polygons: the mean over each pixel, without sampling.

This module stands alone: it is a compiled kernel, independent of cameras and boards.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike
from p4pfr_ros.core.geometry import Array
from p4pfr_ros.core.jit import jit


def coverage(edges: ArrayLike, image_size: tuple[int, int]) -> Array:
    """
    Return the fraction (h, w) of each pixel that polygons cover.

    Pixel (x, y) is the square of side 1 around the integer point (x, y).

    Parameters
    ----------
    edges : (N, 4) array
        x0, y0, x1, y1 px, of closed polygons, clockwise in the image; the coverage of a
        counter-clockwise polygon is negative. Edges may lie outside the image.
    image_size
        Width and height, pixels.

    """
    width, height = image_size
    differences = np.zeros((height, width + 1))
    _accumulate(np.ascontiguousarray(edges, dtype=np.float64), differences)
    covered: Array = np.cumsum(differences, axis=1)[:, :width]
    return covered


@jit
def _accumulate(edges: Array, differences: Array) -> None:
    """
    Add the contributions of the edges to the coverage, as differences along x.

    By Green's theorem, a polygon's area in a pixel is a sum over its edges: an edge that spans dy
    within a row adds dy to every pixel to its right, and to each pixel that it crosses the area
    to its right. With differences along x, "every pixel to its right" is a single number.
    """
    height, width = differences.shape[0], differences.shape[1] - 1
    for i in range(edges.shape[0]):
        # From here on, pixel borders are at integers.
        x0, y0 = edges[i, 0] + 0.5, edges[i, 1] + 0.5
        x1, y1 = edges[i, 2] + 0.5, edges[i, 3] + 0.5
        sign = -1.0
        if y1 < y0:
            x0, y0, x1, y1, sign = x1, y1, x0, y0, 1.0
        if y1 <= 0.0 or y0 >= height or y0 == y1:
            continue
        dx_dy = (x1 - x0) / (y1 - y0)
        first, last = max(0, math.floor(y0)), min(height, math.ceil(y1))
        for row in range(first, last):
            top, bottom = max(y0, float(row)), min(y1, row + 1.0)
            xa, xb = x0 + (top - y0) * dx_dy, x0 + (bottom - y0) * dx_dy
            dy = sign * (bottom - top)
            _add_slice(differences[row], min(xa, xb), max(xa, xb), dy, width)


@jit
def _add_slice(row: Array, left: float, right: float, dy: float, width: int) -> None:
    """Add the part of an edge in one row, which spans x = left to right and dy."""
    if left >= width:
        return
    if right <= 0.0:
        row[0] += dy
        return
    # A pixel's coverage is its integral of a ramp that rises from 0 at left to dy at right.
    previous = 0.0
    for x in range(max(0, math.floor(left)), width):
        total = _ramp_integral(x + 1.0, left, right, dy) - _ramp_integral(
            float(x), left, right, dy
        )
        row[x] += total - previous
        previous = total
        if x + 1.0 >= right:
            row[x + 1] += dy - previous
            return


@jit
def _ramp_integral(x: float, left: float, right: float, dy: float) -> float:
    """Integrate up to x the ramp that is 0 before left and dy after right."""
    if x <= left:
        return 0.0
    if x >= right:
        return dy * (x - 0.5 * (left + right))
    return dy * 0.5 * (x - left) ** 2 / (right - left)
