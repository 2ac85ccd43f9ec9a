# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""
Detection of circle grids: OpenCV finds the circles, whose centres are then measured and corrected.

The image of a circle's centre is not the middle of its image: under perspective a circle becomes
an ellipse whose centre lies farther away, and a lens bends it. For circles as large as half of
their spacing, the two are tenths of a pixel apart. Three steps:

1. The centroid of a circle's ink, from the grey levels around it. Unlike the middle of an outline
   at a threshold, it depends neither on blur nor on the threshold.
2. The map from the board to the image: a homography followed by the division model of a lens about
   the middle of the image, fitted linearly to the centroids of the grid itself.
3. That map shows by how much the centroid of each circle's image differs from the image of its
   centre. The difference is subtracted, and steps 2 and 3 are repeated once.

This module stands alone, as each finder of a family of boards does.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
from numpy.typing import ArrayLike, NDArray
from p4pfr_ros.boards import CircleGrid
from p4pfr_ros.core.geometry import Array, Ints, Mask
from p4pfr_ros.detection.candidates import RejectedCandidate

_cv2: Any = cv2  # its type stubs lack the blob detector

# OpenCV's blob detector ignores circles outside of these areas.
_MIN_AREA_PX = 12.0
_MIN_CIRCULARITY = 0.6
# Trial values of the division model's k, in units of the half diagonal, for the search.
_BENDS = (0.0, -0.2, -0.4, -0.6, -0.8)
_MAX_BLOBS = 2000
_NOTHING = np.empty(0, dtype=np.int64), np.empty((0, 2))
_DRAWN_SIDE_PX, _DRAWN_RADIUS_PX, _SHIFT = 800.0, 3, 4
# The window of a circle reaches this far into the white gap to its nearest neighbour. The ink is
# counted within it, and the level of the paper is taken from its outer part.
_WINDOW_IN_GAPS = 0.5
# More paper than blur reaches adds only noise.
_WINDOW_PX, _WINDOW_IN_RADII = 4.0, 0.1
_PAPER_FROM = 0.9
# Acceptance: a minimum contrast, in grey levels; the area of the ink, in areas of the projected
# circle; and the largest distance from the map of the whole grid, in pixels and medians.
_MIN_CONTRAST = 10.0
_AREA_RANGE = (0.75, 1.3)
_MAX_MISFIT_PX, _MAX_MISFIT_IN_MEDIANS = 0.5, 4.0
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


def find_circle_grid(
    grey: NDArray[np.uint8], board: CircleGrid, lens: LensMiddle
) -> tuple[Ints, Array, tuple[RejectedCandidate, ...]]:
    """
    Find a grid's circles in an image (h, w), or a part of one; lens: the middle of the whole one.

    Returns
    -------
    Ids (N,) (indices in the board's points) and the images of the centres (N, 2) px, empty if the
    grid is not found; then also the circles that were found. Circles that cannot be measured, such
    as half covered ones, are left out.

    """
    blobs, diameters_px = _blobs(grey, board)
    found = _search(board, blobs, lens)
    if found is None:
        return *_NOTHING, _rejected(blobs, diameters_px, 'circle, but no grid')
    centres, good = _centroids(grey, board, _GridMap.fitted(board.points, found, lens))
    if good.sum() < max(4, board.columns):
        return *_NOTHING, _rejected(blobs, diameters_px, 'not a whole circle on white')
    corrected = centres
    for _ in range(_CORRECTIONS):
        grid_map = _GridMap.fitted(board.points[good], corrected[good], lens)
        corrected = centres - _centroid_offsets(board, grid_map)
    misfit_px = np.linalg.norm(corrected - grid_map.pixels(board.points), axis=1)
    good &= misfit_px < _MAX_MISFIT_PX + _MAX_MISFIT_IN_MEDIANS * np.median(misfit_px[good])
    ids = np.flatnonzero(good)
    return ids, corrected[ids], ()


def _rejected(blobs: Array, diameters_px: Array, reason: str) -> tuple[RejectedCandidate, ...]:
    corners = 0.5 * np.array([(-1.0, -1.0), (1.0, -1.0), (1.0, 1.0), (-1.0, 1.0)])
    return tuple(
        RejectedCandidate(blob + diameter_px * corners, reason)
        for blob, diameter_px in zip(blobs[:_MAX_BLOBS], diameters_px, strict=False)
    )


def _blobs(grey: NDArray[np.uint8], board: CircleGrid) -> tuple[Array, Array]:
    """Return the middles (M, 2) and diameters (M,), pixels, of dark circles in an image."""
    parameters = _blob_parameters(grey.size / len(board.points))
    found = _cv2.SimpleBlobDetector_create(parameters).detect(grey)
    middles = np.array([blob.pt for blob in found], dtype=np.float64).reshape(-1, 2)
    return middles, np.array([blob.size for blob in found])


def _search(board: CircleGrid, blobs: Array, lens: LensMiddle) -> Array | None:
    """Return OpenCV's centres (N, 2) px in the order of the board's points, or None."""
    if not len(board.points) <= len(blobs) <= _MAX_BLOBS:
        return None
    r2 = np.sum((blobs - lens.at_px) ** 2, axis=1) / lens.unit_px**2
    for bend in _BENDS:
        straight = lens.at_px + (blobs - lens.at_px) / (1.0 + bend * r2)[:, None]
        ids = _grid_among(straight, board)
        if ids is not None:
            order = _order_as_printed(straight[ids], board)
            if order is not None:
                return blobs[ids][order]
    return None


def _grid_among(blobs: Array, board: CircleGrid) -> Ints | None:
    """Return the indices (N,) of the blobs (M, 2) that OpenCV finds to be the grid, or None."""
    # OpenCV searches an image, not points: the blobs are drawn as small discs.
    low = blobs.min(axis=0)
    scale = _DRAWN_SIDE_PX / float((blobs.max(axis=0) - low).max())
    drawn = scale * (blobs - low) + 4.0 * _DRAWN_RADIUS_PX
    width, height = np.ceil(drawn.max(axis=0) + 4.0 * _DRAWN_RADIUS_PX).astype(int).tolist()
    canvas = np.full((height, width), 255, dtype=np.uint8)
    for x, y in np.rint(drawn * 2**_SHIFT).astype(int).tolist():
        cv2.circle(canvas, (x, y), _DRAWN_RADIUS_PX << _SHIFT, 0, -1, cv2.LINE_8, _SHIFT)
    layout = cv2.CALIB_CB_ASYMMETRIC_GRID if board.asymmetric else cv2.CALIB_CB_SYMMETRIC_GRID
    parameters = _blob_parameters(4.0 * np.pi * _DRAWN_RADIUS_PX**2)
    parameters.minThreshold, parameters.maxThreshold, parameters.thresholdStep = 100, 160, 50
    parameters.minRepeatability = 1
    detector = _cv2.SimpleBlobDetector_create(parameters)
    # Clustering copes with stronger perspective, but not with blobs beside the grid.
    for flags in (layout, layout | cv2.CALIB_CB_CLUSTERING):
        found, centres = cv2.findCirclesGrid(
            canvas, (board.columns, board.rows), flags=flags, blobDetector=detector
        )
        if found:
            distance = np.linalg.norm(centres.reshape(-1, 1, 2) - drawn, axis=2)
            nearest: Ints = distance.argmin(axis=1)
            return nearest if len(set(nearest.tolist())) == len(nearest) else None
    return None


def _blob_parameters(max_area_px: float) -> Any:
    parameters = _cv2.SimpleBlobDetector_Params()
    parameters.filterByArea = True
    parameters.minArea, parameters.maxArea = _MIN_AREA_PX, max(max_area_px, 2.0 * _MIN_AREA_PX)
    parameters.filterByCircularity = True
    parameters.minCircularity = _MIN_CIRCULARITY
    parameters.minDistBetweenBlobs = 2.0
    return parameters


def _order_as_printed(centres: Array, board: CircleGrid) -> Ints | None:
    """
    Return the indices (N,) that put a grid's centres in the order of the board's points.

    If several orders fit, as in symmetric grids, the result is upright. None: no order fits.
    """
    best: tuple[float, float, Ints] | None = None
    indices = np.arange(len(centres)).reshape(board.rows, board.columns)
    for each in _orders(indices):
        order = each.ravel()
        points = centres[order]
        homography, _ = cv2.findHomography(board.points, points)
        if homography is None or np.linalg.det(homography) >= 0.0:
            continue  # mirrored: the board's y axis points up, the image's down
        mapped = cv2.perspectiveTransform(board.points[:, None], homography)[:, 0]
        misfit_px = float(np.sqrt(np.mean(np.sum((mapped - points) ** 2, axis=1))))
        up_px = float(np.sum(points[-board.columns :, 1] - points[: board.columns, 1]))
        # Orders that fit alike differ by less than the lens bends the grid; wrong ones miss by
        # half a spacing.
        if (
            best is None
            or misfit_px < 0.5 * best[0]
            or (misfit_px < 2.0 * best[0] and up_px > best[1])
        ):
            best = misfit_px, up_px, order
    return None if best is None else best[2]


def _orders(grid: Ints) -> Iterator[Ints]:
    """Yield a grid of indices as it is, flipped, turned, and with neighbouring rows exchanged."""
    rows, columns = grid.shape
    grids = [grid]
    if rows == columns:
        grids.append(grid.T)
    if rows % 2 == 0:  # OpenCV does so in asymmetric grids that are turned by half a turn
        grids.append(grid.reshape(rows // 2, 2, columns)[:, ::-1].reshape(rows, columns))
    for each in grids:
        for flipped in (each, each[::-1]):
            yield from (flipped, flipped[:, ::-1])


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
    grey: NDArray[np.uint8], board: CircleGrid, grid_map: _GridMap
) -> tuple[Array, Mask]:
    """Measure the centroid (N, 2) px of each circle's ink; also whether it is accepted (N,)."""
    points = board.points
    centres, jacobians = grid_map.pixels(points), grid_map.jacobian(points)
    gap_m = board.nearest_m - board.diameter_m
    reach = 1.0 + 2.0 * _WINDOW_IN_GAPS * gap_m / board.diameter_m  # in radii
    good = np.zeros(len(points), dtype=bool)
    for n, jacobian in enumerate(jacobians):
        radii_px = 0.5 * board.diameter_m * jacobian
        window = 1.0 + _WINDOW_IN_RADII + _WINDOW_PX / np.sqrt(abs(np.linalg.det(radii_px)))
        window = min(reach, float(window))
        centroid = _centroid(grey, centres[n], radii_px, window)
        if centroid is not None and np.abs(centroid - centres[n]).max() > _OFF_CENTRE_PX:
            centroid = _centroid(grey, centroid, radii_px, window)
        if centroid is not None:
            centres[n], good[n] = centroid, True
    return centres, good


def _centroid(
    grey: NDArray[np.uint8], centre: Array, radii_px: Array, reach: float
) -> Array | None:
    """
    Return the centroid (2,) px of the ink around a point, or None if it is no whole circle.

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
    centroid: Array = centre + plane[1:] @ ink / total
    return centroid


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
