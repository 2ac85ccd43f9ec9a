# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""
Reading of a marker's cells inside its fitted edges.

The cells' centres follow the fitted curves: the homography of the four corners, and the distance
of each edge from its chord, which fades towards the opposite edge (a Coons patch).

This module stands alone: it reads at given edges; ``marker_edges`` fits them.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from p4pfr_ros.core.geometry import Array
from p4pfr_ros.core.jit import kernel

# A cell counts as wrong if it is on the wrong side of the middle between dark and bright by so
# much of the contrast: blur makes small cells grey. Largest fraction of wrong cells: detectors
# correct a few wrong bits; a code at a wrong place has a quarter and more.
_WRONG_IN_CONTRASTS = 0.15
_MAX_WRONG_FRACTION = 0.06
# Cells that are neither clearly black nor white are read at their boundaries, or small.
_UNCLEAR_IN_CONTRASTS, _MAX_UNCLEAR_FRACTION = -0.5, 0.05
# White cells are as bright as the margin, 1 contrast above the middle. If they are brighter than
# this, the margin is too narrow to be seen, and the edge lies between the marker and a wall.
_MAX_EXCESS = 2.0
# If none of them is as bright as this, a wall brighter than the paper is taken for the margin.
_MIN_BRIGHTEST = 0.4


@kernel
def perspective(corners: Array) -> tuple[float, float]:
    """Return g and h of the homography from the unit square to corners (4, 2)."""
    # Its denominator is 1 + g s + h t.
    ax, ay = corners[1, 0] - corners[2, 0], corners[1, 1] - corners[2, 1]
    bx, by = corners[3, 0] - corners[2, 0], corners[3, 1] - corners[2, 1]
    cx = corners[0, 0] - corners[1, 0] - bx
    cy = corners[0, 1] - corners[1, 1] - by
    cross = ax * by - ay * bx
    return (cx * by - cy * bx) / cross, (ax * cy - ay * cx) / cross


@kernel
def point_in_square(corners: Array, g: float, h: float, s: float, t: float) -> tuple[float, float]:
    """Return the pixel of (s, t) in the unit square, from corner 0 to 1 and from 0 to 3."""
    # Corner 1 is (column 1 + column 3) / (1 + g) of the homography, corner 3 likewise.
    of_s, of_t, w = s * (1.0 + g), t * (1.0 + h), 1.0 + g * s + h * t
    x = corners[0, 0] * (1.0 - s - t) + of_s * corners[1, 0] + of_t * corners[3, 0]
    y = corners[0, 1] * (1.0 - s - t) + of_s * corners[1, 1] + of_t * corners[3, 1]
    return x / w, y / w


@kernel
def reads(
    grey: NDArray[np.uint8],
    corners: Array,
    frames: Array,
    edges: Array,
    cells: NDArray[np.bool_],
) -> int:
    """
    Return whether the cells in the image are those of a marker: 2 if so, 1 if doubtful, 0 if not.

    corners (4, 2) px are clockwise, frames (4, 7) and edges (4, 7) as in ``marker_edges``, and
    cells (n, n) are True where black.
    """
    count = len(cells)
    g, h = perspective(corners)
    wrong, unclear, white, excess, brightest = 0, 0, 0, 0.0, 0.0
    for row in range(count):
        t = (row + 0.5) / count
        for column in range(count):
            s = (column + 0.5) / count
            x, y = point_in_square(corners, g, h, s, t)
            middle, contrast = 0.0, 0.0
            for i in range(4):
                # Along edge i, clockwise, and the weight of it at the opposite edge: 0.
                along = s if i == 0 else t if i == 1 else 1.0 - s if i == 2 else 1.0 - t
                near = 1.0 - t if i == 0 else s if i == 1 else t if i == 2 else 1.0 - s
                u, p = 2.0 * along - 1.0, edges[i]
                # The curve less its chord.
                sag_px = (u * u - 1.0) * (p[2] + u * p[3])
                x += near * sag_px * frames[i, 4]
                y += near * sag_px * frames[i, 5]
                middle += 0.5 * near * p[5]
                contrast += 0.5 * near * p[6]
            level = _level_at(grey, x, y)
            off = level - middle if cells[row, column] else middle - level
            unclear += off > _UNCLEAR_IN_CONTRASTS * contrast
            if off > _WRONG_IN_CONTRASTS * contrast:
                wrong += 1
            elif not cells[row, column]:
                white += 1
                excess += (level - middle) / contrast
                brightest = max(brightest, (level - middle) / contrast)
    has_white_margin = excess <= _MAX_EXCESS * white and (not white or brightest >= _MIN_BRIGHTEST)
    if not has_white_margin or wrong > _MAX_WRONG_FRACTION * count * count:
        return 0
    return 2 if unclear <= _MAX_UNCLEAR_FRACTION * count * count else 1


@kernel
def _level_at(grey: NDArray[np.uint8], x: float, y: float) -> float:
    """Interpolate a grey level; beyond the image, the nearest one."""
    height, width = grey.shape
    x, y = min(max(x, 0.0), width - 1.001), min(max(y, 0.0), height - 1.001)
    left, top = int(x), int(y)
    dx, dy = x - left, y - top
    upper = grey[top, left] * (1.0 - dx) + grey[top, left + 1] * dx
    lower = grey[top + 1, left] * (1.0 - dx) + grey[top + 1, left + 1] * dx
    return float(upper * (1.0 - dy) + lower * dy)
