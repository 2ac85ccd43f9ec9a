# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""
The cells of markers, read from an image where a marker is or may be.

Cells are read at their centres, through the homography of the marker's four corners; cells around
a marker, in rings, tell how far its black border reaches.
"""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray
from p4pfr_ros.core.geometry import Array, Ints, Mask
from p4pfr_ros.detection.aruco import marker_cells

# Cells that are read around a marker: a border may be that much wider than expected.
RINGS = 3
# A cell is dark below this share of the contrast between the marker's black and white cells.
_DARK = 0.3


def relative_levels(
    grey: NDArray[np.uint8], dictionary: str, corners: Array, ids: Ints, bits: int
) -> tuple[Array, Array]:
    """
    Return the levels of the cells of markers and around them, and the contrast (M,).

    In the levels (M, m, m), 0 is the mean of the marker's black cells and 1 that of the white
    ones, also where they are exchanged; then the contrast is negative.
    """
    expected = expected_cells(dictionary, ids, bits)
    levels = cell_levels(grey, corners, expected.shape[1], RINGS)
    inside = levels[:, RINGS:-RINGS, RINGS:-RINGS]
    black = np.where(expected, inside, 0.0).sum(axis=(1, 2)) / expected.sum(axis=(1, 2))
    white = np.where(expected, 0.0, inside).sum(axis=(1, 2)) / (~expected).sum(axis=(1, 2))
    contrast = white - black
    unit = np.where(contrast == 0.0, 1.0, contrast)[:, None, None]
    return (levels - black[:, None, None]) / unit, contrast


def expected_cells(dictionary: str, ids: Ints, bits: int) -> Mask:
    """Return the cells (M, n, n) of markers with a border of ``bits``, True where black."""
    return np.stack([marker_cells(dictionary, n, bits) for n in ids.tolist()])


def dark_sides(relative: Array) -> Ints:
    """Return how many sides (M, RINGS) of each ring around markers are dark, innermost first."""
    n = relative.shape[1] - 2 * RINGS
    along = slice(RINGS, RINGS + n)
    rings = []
    for ring in range(1, RINGS + 1):
        low, high = RINGS - ring, RINGS + n - 1 + ring
        sides = (
            relative[:, low, along],
            relative[:, high, along],
            relative[:, along, low],
            relative[:, along, high],
        )
        rings.append((np.median(np.stack(sides, axis=1), axis=2) < _DARK).sum(axis=1))
    dark: Ints = np.stack(rings, axis=1)
    return dark


def cell_levels(grey: NDArray[np.uint8], quads: Array, n: int, rings: int) -> Array:
    """
    Return the grey levels at the centres of the cells of quads (M, 4, 2), from the top left.

    Each quad has n x n cells; ``rings`` of cells around it are read too: (M, m, m) with
    m = n + 2 rings.
    """
    at = (np.arange(n + 2 * rings) - rings + 0.5) / n
    return levels_in(grey, quads, np.stack(np.meshgrid(at, at), axis=-1))


def levels_in(grey: NDArray[np.uint8], quads: Array, places: Array) -> Array:
    """
    Return the grey levels (M, ...) at places of quads (M, 4, 2).

    Places (..., 2) are u, v from (0, 0) at the quad's first corner to (1, 1) at its third.
    """
    x, y = np.moveaxis(pixels_of(quads, places.reshape(-1, 2)), -1, 0)
    # Beyond the line at infinity, and far outside the image: the level of the image's margin.
    x, y = (np.nan_to_num(np.clip(each, -1.0, 2.0**15), nan=-1.0) for each in (x, y))
    read = cv2.remap(
        grey,
        x.astype(np.float32),
        y.astype(np.float32),
        cv2.INTER_LINEAR,
        borderMode=cv2.BORDER_REPLICATE,
    )
    levels: Array = read.astype(np.float64).reshape(len(quads), *places.shape[:-1])
    return levels


def pixels_of(quads: Array, places: Array) -> Array:
    """Return the pixels (M, N, 2) of places u, v (N, 2), or (M, N, 2), of quads (M, 4, 2)."""
    padded = np.pad(places, [*[(0, 0)] * (places.ndim - 1), (0, 1)], constant_values=1.0)
    mapped = padded @ _from_unit_square(quads).swapaxes(1, 2)
    with np.errstate(divide='ignore', invalid='ignore'):
        pixels: Array = mapped[..., :2] / mapped[..., 2:]
    return pixels


def _from_unit_square(quads: Array) -> Array:
    """Return the homographies (M, 3, 3) from the corners (0, 0), (1, 0), (1, 1), (0, 1)."""
    # Heckbert, "Fundamentals of texture mapping and image warping", 1989, section 2.2.3.
    p0, p1, p2, p3 = quads.swapaxes(0, 1)
    a, b, c = p1 - p2, p3 - p2, p0 - p1 + p2 - p3
    area = a[:, 0] * b[:, 1] - b[:, 0] * a[:, 1]
    area = np.where(area == 0.0, np.nan, area)
    g = ((c[:, 0] * b[:, 1] - b[:, 0] * c[:, 1]) / area)[:, None]
    h = ((a[:, 0] * c[:, 1] - c[:, 0] * a[:, 1]) / area)[:, None]
    upper = np.stack([p1 - p0 + g * p1, p3 - p0 + h * p3, p0], axis=2)
    lower = np.stack([g, h, np.ones_like(g)], axis=2)
    return np.concatenate([upper, lower], axis=1)
