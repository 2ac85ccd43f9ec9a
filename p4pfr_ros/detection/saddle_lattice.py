# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""
Search for the inner corners of a chessboard: saddle points of the image that form a lattice.

A corner between four squares is a saddle of the grey level, its bright sides are the white
squares, and the edges are near the directions in between. Two saddles are neighbours if each is
the nearest one along an edge of the other, and bright and dark sides alternate; a lattice grows
along the sides of squares. So no model of lens or board is needed. The time depends on the number
of pixels and of saddles, which is limited, and on nothing else in the image.

This module stands alone: it is numerics, without boards, and has tests of its own.
"""

from __future__ import annotations

import threading
from typing import Any, NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray
from p4pfr_ros.core.geometry import Array, Ints
from p4pfr_ros.core.jit import kernel
from p4pfr_ros.detection.square_lattice import joined

# Binomial weights: they remove patterns of single pixels, such as a Bayer mosaic, and leave
# squares of four.
_BINOMIAL = np.array([1, 6, 15, 20, 15, 6, 1]) / 64.0
# Smoothed levels are integers, in this part of a grey level.
_PER_LEVEL = 128.0
# Borders are reflected, which makes saddles of edges that end there.
_BORDER_PX = 4
_NEIGHBOURHOOD = np.ones((5, 5), np.uint8)
# The image is searched in bands of about this size, which stay in the cache.
_BAND_PIXELS = 320_000
# Derivatives from the 3x3 levels around a pixel, as sums with these weights: by x, y, xx, yy, xy.
_MIDDLE, _SLOPE, _BEND = [0.0, 1.0, 0.0], [-0.5, 0.0, 0.5], [1.0, -2.0, 1.0]
_DERIVATIVES = np.array(
    [
        np.outer(along_y, along_x)
        for along_y, along_x in (
            (_MIDDLE, _SLOPE),
            (_SLOPE, _MIDDLE),
            (_MIDDLE, _BEND),
            (_BEND, _MIDDLE),
            (_SLOPE, _SLOPE),
        )
    ]
)
# Smallest √(-det) of the second derivatives at a saddle, grey levels / px².
_MIN_CURVATURE = 0.7
# A maximum of -det farther than this from its saddle point, px, is not a corner.
_MAX_OFFSET_PX = 1.0
# Largest ratio of sum and difference of the second derivatives' eigenvalues; 0 at a corner.
_MAX_TRACE = 0.7
# Largest sine of the angle between an edge of a saddle and its neighbour, or their edges.
_MAX_SINE = 0.5
# Largest distance between neighbours, pixels: larger squares are found in smaller images.
_MAX_SPACING_PX = 110.0
# Largest ratio of the curvatures of neighbours.
_MAX_CURVATURE_RATIO = 5.0


class Saddle(NamedTuple):
    """Columns of an array of saddles: pixels, unit vector near an edge, curvature."""

    x: int = 0
    y: int = 1
    # The second edge is near this vector, turned from x towards y by 90 degrees; a bright side
    # lies between the two.
    first: int = 2
    curvature: int = 4


_COLUMNS, _WIDTH = Saddle(), 5


def find_saddles(grey: NDArray[np.uint8], at_most: int) -> Array:
    """Return the strongest saddles (N, 5) of an image; see ``Saddle`` for the columns."""
    height, width = grey.shape
    step = max(_BAND_PIXELS // width, 8 * _BORDER_PX) - 2 * _BORDER_PX
    bands = []
    for top in range(0, max(height - 2 * _BORDER_PX, 1), step):
        band = _saddles_in_band(grey[top : top + step + 2 * _BORDER_PX], at_most)
        band[:, 1] += top
        bands.append(band)
    saddles = np.concatenate(bands)
    strongest_first = np.argsort(-saddles[:, _COLUMNS.curvature], kind='stable')
    return saddles[strongest_first[:at_most]]


def _saddles_in_band(grey: NDArray[np.uint8], at_most: int) -> Array:
    """Return the strongest saddles (N, 5) of some rows, clear of their border."""
    smooth, strength, dilated, is_peak = _workspace(*grey.shape)
    cv2.sepFilter2D(grey, cv2.CV_16S, _PER_LEVEL * _BINOMIAL, _BINOMIAL, dst=smooth)
    _curvature2(smooth, strength)
    strength[:_BORDER_PX] = strength[-_BORDER_PX:] = 0.0
    strength[:, :_BORDER_PX] = strength[:, -_BORDER_PX:] = 0.0
    cv2.dilate(strength, _NEIGHBOURHOOD, dst=dilated)
    np.greater_equal(strength, dilated, out=is_peak)
    is_peak &= strength > 16.0 * (_PER_LEVEL * _MIN_CURVATURE) ** 2
    peaks = np.flatnonzero(is_peak)
    if len(peaks) > at_most:
        peaks = peaks[np.argpartition(strength.ravel()[peaks], -at_most)[-at_most:]]
    # Of equal neighbours, as at a corner in a drawing, the first one stays.
    before = [dy * grey.shape[1] + dx for dy in (-2, -1) for dx in range(-2, 3)] + [-2, -1]
    peaks = peaks[~is_peak.ravel()[peaks[:, None] + before].any(axis=1)]
    y, x = np.divmod(peaks, grey.shape[1])
    return _described(smooth, x, y)


class _Buffers(threading.local):
    """Memory that is used again: fresh pages cost more time than the work on them."""

    def __init__(self) -> None:
        dtypes = (np.int16, np.float32, np.float32, np.bool_)
        self.flat = [np.zeros(2 * _BAND_PIXELS, dtype) for dtype in dtypes]


_buffers = _Buffers()


def _workspace(height: int, width: int) -> list[NDArray[Any]]:
    """Return arrays (h, w): smoothed levels, strength, its maxima, where the maxima are."""
    if height * width > 2 * _BAND_PIXELS:  # a panorama of few rows
        return [np.zeros((height, width), each.dtype) for each in _buffers.flat]
    return [each[: height * width].reshape(height, width) for each in _buffers.flat]


@kernel
def _curvature2(smooth: NDArray[np.int16], strength: NDArray[np.float32]) -> None:
    """Write 16 times -det of the second derivatives: positive at saddles."""
    # In integers, with a single conversion, and from index 1: so the compiler finds the vector
    # instructions.
    height, width = smooth.shape
    for y in range(1, height - 1):
        for x in range(1, width - 1):
            level = np.int64(smooth[y, x])
            xx = np.int64(smooth[y, x - 1]) + np.int64(smooth[y, x + 1]) - 2 * level
            yy = np.int64(smooth[y - 1, x]) + np.int64(smooth[y + 1, x]) - 2 * level
            falling = np.int64(smooth[y - 1, x - 1]) + np.int64(smooth[y + 1, x + 1])
            rising = np.int64(smooth[y - 1, x + 1]) + np.int64(smooth[y + 1, x - 1])
            xy4 = falling - rising
            strength[y, x] = np.float32(xy4 * xy4 - 16 * xx * yy)


def _described(smooth: NDArray[np.int16], x: Ints, y: Ints) -> Array:
    """Return the saddles (N, 5) near pixels."""
    steps = np.arange(-1, 2)
    around = smooth[y[:, None, None] + steps[:, None], x[:, None, None] + steps] / _PER_LEVEL
    # Not as a product of matrices: its rounding depends on the number of threads.
    by_x, by_y, xx, yy, xy = np.einsum('dij,nij->dn', _DERIVATIVES, around)
    determinant = xx * yy - xy * xy
    # Newton's step to the saddle point, where the gradient vanishes.
    dx, dy = (xy * by_y - yy * by_x) / determinant, (xy * by_x - xx * by_y) / determinant
    # Around the direction of the positive eigenvalue is a bright side. At a corner that is blurred
    # alike in all directions the eigenvalues are opposite, whatever the angle between the edges.
    alpha = 0.5 * np.arctan2(2.0 * xy, xx - yy)
    half_trace, radius = 0.5 * (xx + yy), np.hypot(0.5 * (xx - yy), xy)
    first = alpha - 0.25 * np.pi
    saddles = np.column_stack(
        [x + dx, y + dy, np.cos(first), np.sin(first), np.sqrt(-determinant)]
    )
    good = np.maximum(np.abs(dx), np.abs(dy)) < _MAX_OFFSET_PX
    good &= np.abs(half_trace) < _MAX_TRACE * radius
    described: Array = saddles[good]
    return described


def lattices(saddles: Array, at_least: int) -> list[tuple[Ints, Ints]]:
    """
    Group saddles into lattices of at least so many points, the largest first.

    Returns
    -------
    For each lattice the indices (M,) of its saddles and their cells (M, 2), as from ``joined``.

    """
    links, nearest2 = np.empty((len(saddles), 4), np.int64), np.empty((len(saddles), 4))
    by_x = np.argsort(saddles[:, _COLUMNS.x], kind='stable')
    _link(saddles, by_x, links, nearest2)
    return joined(links, nearest2, at_least)


@kernel
def _link(saddles: Array, by_x: Ints, links: Ints, nearest2: Array) -> None:
    """
    Write the nearest neighbour of each saddle along its four edges, or -1.

    Edge p of a saddle points along the first (0), second (1), first backwards (2), second
    backwards (3). by_x (N,) are the indices in the order of x; nearest2 (N, 4) are the distances²,
    px².
    """
    for i in range(len(saddles)):
        for p in range(4):
            links[i, p], nearest2[i, p] = -1, _MAX_SPACING_PX**2
    for m in range(len(saddles)):
        i = by_x[m]
        for n in range(m + 1, len(saddles)):
            j = by_x[n]
            dx, dy = saddles[j, 0] - saddles[i, 0], saddles[j, 1] - saddles[i, 1]
            if dx > _MAX_SPACING_PX:
                break
            d2 = dx * dx + dy * dy
            if d2 > _MAX_SPACING_PX**2:
                continue
            p, q = _edge_towards(saddles[i], dx, dy, d2), _edge_towards(saddles[j], -dx, -dy, d2)
            if p < 0 or q < 0 or not _alternate(saddles[i], saddles[j]):
                continue
            if d2 < nearest2[i, p]:
                links[i, p], nearest2[i, p] = j, d2
            if d2 < nearest2[j, q]:
                links[j, q], nearest2[j, q] = i, d2


@kernel
def _edge_towards(saddle: Array, dx: float, dy: float, d2: float) -> int:
    """Return which edge of a saddle points to an offset, or -1."""
    along, across = saddle[2] * dx + saddle[3] * dy, saddle[2] * dy - saddle[3] * dx
    if across * across < _MAX_SINE**2 * d2:
        return 0 if along > 0.0 else 2
    if along * along < _MAX_SINE**2 * d2:
        return 1 if across > 0.0 else 3
    return -1


@kernel
def _alternate(one: Array, other: Array) -> bool:
    """Return whether bright sides of one saddle continue in dark sides of the other."""
    # A bright side lies between the first and the second edge. So the first edge of one must be
    # parallel to the second edge of the other.
    ratio = one[4] / other[4]
    sine = one[2] * other[2] + one[3] * other[3]
    return bool(
        abs(sine) < _MAX_SINE and 1.0 / _MAX_CURVATURE_RATIO < ratio < _MAX_CURVATURE_RATIO
    )
