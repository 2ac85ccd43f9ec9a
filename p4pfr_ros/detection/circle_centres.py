# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""
Images of the centres of circles, measured and corrected, of a grid whose place is known.

The image of a circle's centre is not the middle of its image: under perspective a circle becomes
an ellipse whose centre lies farther away, and a lens bends it. For circles as large as half of
their spacing, the two are tenths of a pixel apart. Three steps:

1. The centroid of a circle's ink, from the grey levels around it. Unlike the middle of an outline
   at a threshold, it depends neither on blur nor on the threshold.
2. The map from the board to the image: a homography followed by the division model of a lens about
   the middle of the image, fitted linearly to the centroids of the grid itself.
3. That map shows by how much the centroid of each circle's image differs from the image of its
   centre. The difference is subtracted, and steps 2 and 3 are repeated once.

This module stands alone: to measure circles is another matter than to find them.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray
from p4pfr_ros.boards import CircleGrid
from p4pfr_ros.core.geometry import Array, Ints

# The window of a circle reaches this far into the white gap to its nearest neighbour. The ink is
# counted within it, and the level of the paper is taken from its outer part.
_WINDOW_IN_GAPS = 0.5
# More paper than blur reaches adds only noise.
_WINDOW_PX, _WINDOW_IN_RADII = 4.0, 0.1
_PAPER_FROM = 0.9
# Acceptance: a minimum contrast, in grey levels; the area of the ink, in areas of the projected
# circle; the largest distance from the map of the whole grid, in pixels and medians, and in
# spacings; and for the grid, so many of its circles.
_MIN_CONTRAST = 10.0
_AREA_RANGE = (0.75, 1.3)
_MAX_MISFIT_PX, _MAX_MISFIT_IN_MEDIANS = 0.5, 4.0
_MAX_MISFIT_IN_SPACINGS = 0.1
_MIN_MEASURED_FRACTION = 0.55
# The median distance from the map, in spacings: 0.014 at most in rendered views, however blurred.
_MAX_MEDIAN_IN_SPACINGS = 0.05
# A circle beyond the grid's side has at least this part of the others' contrast.
_LIKE_CONTRAST = 0.5
# In its middle it is at most by this part of the contrast brighter than they are.
_MAX_INK_DIFFERENCE = 0.2
# More on the paper, in contrasts of the circle, besides noise covers the circle. The largest noise
# in medians, and in grey levels: what covers much of the paper raises its median.
_MAX_INK_ON_PAPER, _NOISE_IN_MEDIANS, _MAX_NOISE = 0.3, 5.0, 30.0
# A window that is farther off its circle is moved, and the circle measured again.
_OFF_CENTRE_PX = 0.5
_CORRECTIONS = 2
_OUTLINE_VERTICES = 48


@dataclass(frozen=True, slots=True, eq=False)
class LensMiddle:
    """Where the middle of the whole image is (2,) px, and half of the image's diagonal, px."""

    at_px: Array
    unit_px: float

    @classmethod
    def of(cls, shape: tuple[int, ...], offset_px: ArrayLike = 0.0) -> LensMiddle:
        """Return that of an image (h, w), seen from a part of it that begins at an offset."""
        middle_px = 0.5 * (np.array(shape[1::-1]) - 1.0)
        return cls(middle_px - np.asarray(offset_px), float(np.linalg.norm(middle_px)))


@dataclass(frozen=True, slots=True, eq=False)
class MeasuredGrid:
    """
    A grid of circles whose centres are measured.

    Parameters
    ----------
    ids : (N,) array
        Indices in the board's points.
    centres : (N, 2) array
        Images of the centres, pixels.
    contrast, ink
        Median difference of paper and circles, and level of the lightest circle, grey levels.
    grid_map
        Map from the board to the image.

    """

    ids: Ints
    centres: Array
    contrast: float
    ink: float
    grid_map: _GridMap


def measure_centres(
    grey: NDArray[np.uint8], board: CircleGrid, ids: Ints, middles: Array, lens: LensMiddle
) -> MeasuredGrid | None:
    """
    Measure the images of a grid's centres in an image (h, w), or a part of one.

    Circles that cannot be measured, such as half covered ones, are left out.

    Parameters
    ----------
    grey, board
        The image, and what it shows.
    ids, middles
        Indices (n,) of some of the board's points, and about where they are, (n, 2) px.
    lens
        The middle of the whole image.

    Returns
    -------
    The centres; None if this is no grid of circles.

    """
    first_map = _GridMap.fitted(board.points[ids], middles, lens)
    centres, contrast = _centroids(grey, board, board.points, first_map)
    good = contrast > 0.0
    at_least = max(4, board.columns, int(np.ceil(_MIN_MEASURED_FRACTION * len(board.points))))
    if good.sum() < at_least:
        return None
    corrected = centres
    for _ in range(_CORRECTIONS):
        grid_map = _GridMap.fitted(board.points[good], corrected[good], lens)
        corrected = centres - _centroid_offsets(board, grid_map)
    misfit_px = np.linalg.norm(corrected - grid_map.pixels(board.points), axis=1)
    spacing_px = _spacing_px(board, board.points, grid_map)
    is_grid = np.median((misfit_px / spacing_px)[good]) < _MAX_MEDIAN_IN_SPACINGS
    good &= misfit_px < _MAX_MISFIT_PX + _MAX_MISFIT_IN_MEDIANS * np.median(misfit_px[good])
    good &= misfit_px < _MAX_MISFIT_IN_SPACINGS * spacing_px
    if not is_grid or good.sum() < at_least:
        return None
    x, y = np.rint(centres[good]).astype(np.int64).T
    levels = float(np.median(contrast[good])), float(grey[y, x].max())
    return MeasuredGrid(np.flatnonzero(good), corrected[good], *levels, grid_map)


def share_of_circles(
    grey: NDArray[np.uint8], board: CircleGrid, points: Array, grid: MeasuredGrid
) -> float:
    """
    Return at which share of points (M, 2) m of a grid's plane there are circles like the grid's.

    Of the points in the image, that is; 0 without any.
    """
    expected = grid.grid_map.pixels(points)
    spacing_px = _spacing_px(board, points, grid.grid_map)
    radius_px = (0.5 * board.diameter_m / board.nearest_m * spacing_px)[:, None]
    is_inside = (expected > radius_px) & (expected < np.array(grey.shape[::-1]) - 1 - radius_px)
    inside = np.flatnonzero(is_inside.all(axis=1))
    x, y = np.rint(expected[inside]).astype(np.int64).T
    # Few places need to be looked at closely.
    dark = inside[grey[y, x] < grid.ink + _MAX_INK_DIFFERENCE * grid.contrast]
    if not len(dark):
        return 0.0
    centres, contrast = _centroids(grey, board, points[dark], grid.grid_map)
    off_px = np.linalg.norm(centres - expected[dark], axis=1)
    is_circle = off_px < _MAX_MISFIT_IN_SPACINGS * spacing_px[dark]
    is_circle &= contrast > _LIKE_CONTRAST * grid.contrast
    return float(is_circle.sum() / len(inside))


def _spacing_px(board: CircleGrid, points: Array, grid_map: _GridMap) -> Array:
    """Return about the distance (M,) px of neighbours around points (M, 2) m of the board."""
    spacing_px: Array = np.sqrt(np.abs(np.linalg.det(grid_map.jacobian(points))))
    return board.nearest_m * spacing_px


@dataclass(frozen=True, slots=True, eq=False)
class _GridMap:
    """
    Map from the board to the image: a homography, then the division model about a middle.

    With d = pixel - middle, in units of half the diagonal:  (d, 1 + k |d|²) ~ H (x, y, 1).
    """

    homography: Array
    k: float
    lens: LensMiddle

    @classmethod
    def fitted(cls, board_points: Array, pixels: Array, lens: LensMiddle) -> _GridMap:
        """Fit the map to correspondences (N, 2), in two linear steps."""
        scale = np.abs(board_points).max()
        d = (pixels - lens.at_px) / lens.unit_px
        b = np.pad(board_points / scale, ((0, 0), (0, 1)), constant_values=1.0)
        # The direction from the middle does not depend on the lens:  dx (h2 b) = dy (h1 b).
        rows = np.concatenate([-d[:, 1:] * b, d[:, :1] * b], axis=1)
        upper = np.linalg.svd(rows)[2][-1].reshape(2, 3)
        along = np.sum(d * (b @ upper.T), axis=1)
        if along.sum() < 0.0:
            upper, along = -upper, -along
        # The radius does:  d · (h1 b, h2 b) (1 + k |d|²) = |d|² (h3 b), linear in h3 and k.
        r2 = np.sum(d**2, axis=1)
        system = np.column_stack([r2[:, None] * b, -r2 * along])
        *lower, k = np.linalg.lstsq(system, along, rcond=None)[0]
        homography = np.vstack([upper, lower]) @ np.diag([1.0 / scale, 1.0 / scale, 1.0])
        return cls(homography, float(k), lens)

    def pixels(self, board_points: Array) -> Array:
        """Map points (..., 2) of the board to pixels (..., 2)."""
        q = np.pad(board_points, [*[(0, 0)] * (board_points.ndim - 1), (0, 1)], constant_values=1)
        q = q @ self.homography.T
        # d = s q with k |q|² s² - q₃ s + 1 = 0; this root, so written, is finite at k = 0.
        disc = q[..., 2] ** 2 - 4.0 * self.k * np.sum(q[..., :2] ** 2, axis=-1)
        s = 2.0 / (q[..., 2] + np.sqrt(np.maximum(disc, 0.0)))
        pixels: Array = self.lens.at_px + self.lens.unit_px * s[..., None] * q[..., :2]
        return pixels

    def jacobian(self, board_points: Array) -> Array:
        """Return the derivative (N, 2, 2) of the pixels by the point on the board, px/m."""
        step = 1e-6 * float(np.abs(board_points).max())
        ahead = [self.pixels(board_points + each) for each in step * np.eye(2)]
        behind = [self.pixels(board_points - each) for each in step * np.eye(2)]
        return np.stack([(a - b) / (2.0 * step) for a, b in zip(ahead, behind, strict=True)], 2)


def _centroids(
    grey: NDArray[np.uint8], board: CircleGrid, points: Array, grid_map: _GridMap
) -> tuple[Array, Array]:
    """
    Measure the centroids (N, 2) px of the ink of circles at points (N, 2) m of a board's plane.

    Also return their contrasts (N,), grey levels; 0 where there is no whole circle.
    """
    centres, jacobians = grid_map.pixels(points), grid_map.jacobian(points)
    gap_m = board.nearest_m - board.diameter_m
    reach = 1.0 + 2.0 * _WINDOW_IN_GAPS * gap_m / board.diameter_m  # in radii
    contrast = np.zeros(len(points))
    for n, jacobian in enumerate(jacobians):
        radii_px = 0.5 * board.diameter_m * jacobian
        window = 1.0 + _WINDOW_IN_RADII + _WINDOW_PX / np.sqrt(abs(np.linalg.det(radii_px)))
        window = min(reach, float(window))
        circle = _centroid(grey, centres[n], radii_px, window)
        if circle is not None and np.abs(circle[0] - centres[n]).max() > _OFF_CENTRE_PX:
            circle = _centroid(grey, circle[0], radii_px, window)
        if circle is not None:
            centres[n], contrast[n] = circle
    return centres, contrast


def _centroid(
    grey: NDArray[np.uint8], centre: Array, radii_px: Array, reach: float
) -> tuple[Array, float] | None:
    """
    Return the centroid (2,) px of the ink around a point, and the contrast, grey levels.

    None: it is no whole circle.

    radii_px (2, 2): image vectors of the circle's radii along the board's axes. The window is the
    image of a circle of ``reach`` radii.
    """
    (a, b), (c, d) = radii_px.tolist()
    area_px = abs(a * d - b * c)  # in units of pi
    half = reach * np.sqrt([a * a + b * b, c * c + d * d])
    left, top = np.ceil(centre - half).astype(int).tolist()
    right, bottom = (np.floor(centre + half).astype(int) + 1).tolist()
    if left < 0 or top < 0 or right > grey.shape[1] or bottom > grey.shape[0]:
        return None
    x = np.arange(left, right) - centre[0]
    y = (np.arange(top, bottom) - centre[1])[:, None]
    distance2 = ((d * x - b * y) ** 2 + (a * y - c * x) ** 2) / area_px**2
    row, column = np.nonzero(distance2 < reach**2)
    x, y, distance2 = x[column], y[row, 0], distance2[row, column]
    levels = grey[top:bottom, left:right][row, column].astype(np.float64)
    rim, core = distance2 > (_PAPER_FROM * reach) ** 2, distance2 < 0.25
    if rim.sum() < 8 or not core.any():
        return None
    # The paper's level varies linearly with the place, as far as light does over a circle.
    plane = np.stack([np.ones_like(x), x, y])
    paper = np.linalg.solve(plane[:, rim] @ plane[:, rim].T, plane[:, rim] @ levels[rim]) @ plane
    ink = paper - levels
    contrast = ink[core].mean()
    total = ink.sum()
    if contrast < _MIN_CONTRAST or not (
        _AREA_RANGE[0] < total / (contrast * np.pi * area_px) < _AREA_RANGE[1]
    ):
        return None
    on_paper = np.abs(ink[rim])
    noise = min(_NOISE_IN_MEDIANS * float(np.median(on_paper)), _MAX_NOISE)
    if on_paper.max() > _MAX_INK_ON_PAPER * contrast + noise:
        return None
    return centre + plane[1:] @ ink / total, float(contrast)


def _centroid_offsets(board: CircleGrid, grid_map: _GridMap) -> Array:
    """Return by how much (N, 2) px the centroid of each circle's image is off its centre's."""
    # For a homography alone the image is an ellipse, and with w = h3 c and g = H diag(1, 1, 0) h3
    # its centre is (H c w - r² g) / (w² - r² g3) instead of H c / w. With a lens there is no such
    # formula: the centroid of a polygon through the image of the circle's outline, by Green's
    # theorem. Its error is of the order of r / n², the same on all sides.
    angles = np.linspace(0.0, 2.0 * np.pi, _OUTLINE_VERTICES, endpoint=False)
    circle = 0.5 * board.diameter_m * np.stack([np.cos(angles), np.sin(angles)], axis=1)
    images = grid_map.pixels(board.points)
    outline = grid_map.pixels(board.points[:, None] + circle) - images[:, None]
    following = np.roll(outline, -1, axis=1)
    cross = outline[..., 0] * following[..., 1] - outline[..., 1] * following[..., 0]
    offsets: Array = np.einsum('nv,nvi->ni', cross, outline + following) / (
        3.0 * cross.sum(axis=1)[:, None]
    )
    return offsets
