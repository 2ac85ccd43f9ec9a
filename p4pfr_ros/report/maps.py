# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""Maps over the image, and over a board, for plots, reports and the live page."""

from __future__ import annotations

import math

import numpy as np
from p4pfr_ros import BoardShape, CameraEstimate, DivisionCamera
from p4pfr_ros.core.geometry import Array, Mask
from p4pfr_ros.core.many_views.progress import Coverage, projection_sigmas_px

# Cells of the maps along the longer side.
_CELLS = 64


def map_shape(height: float, width: float, cells: int = _CELLS) -> tuple[int, int]:
    """Return rows and columns of nearly square cells, so many along the longer side."""
    longer = max(height, width)
    rows, columns = (max(2, round(cells * side / longer)) for side in (height, width))
    return rows, columns


def cell_middles(image_size: tuple[int, int], shape: tuple[int, int]) -> Array:
    """Return the middles (rows * columns, 2) of the cells of a map, row by row, pixels."""
    y, x = ((np.indices(shape)[i] + 0.5) * image_size[1 - i] / shape[i] - 0.5 for i in (0, 1))
    return np.stack([x.ravel(), y.ravel()], axis=-1)


def uncertainty_map_px(
    estimate: CameraEstimate, image_size: tuple[int, int], shape: tuple[int, int]
) -> Array:
    """
    Return the standard deviation of projections in each cell of the image, pixels.

    shape: rows and columns. NaN where the lens sees nothing.
    """
    pixels, seen = cell_middles(image_size, shape), seen_pixels(estimate, image_size)
    return uncertainty_px(estimate, pixels, seen).reshape(shape)


def seen_pixels(estimate: CameraEstimate, image_size: tuple[int, int]) -> Array:
    """Return the middles (n, 2) of the parts of the image in which points were seen."""
    coverage = Coverage(image_size, True if estimate.coverage is None else estimate.coverage)
    return coverage.pixels(estimate.camera.center_px, estimate.seen_radius_px or math.inf)


def uncertainty_px(estimate: CameraEstimate, pixels: Array, seen: Array) -> Array:
    """
    Return the standard deviation of projections at pixels (N, 2), in the worst direction.

    Anywhere in the image: the turn of the camera that is taken out is the one that explains most
    where points were seen, at pixels (n, 2). NaN where the lens sees nothing.
    """
    camera = estimate.camera
    sigmas = projection_sigmas_px(camera, estimate.covariance, pixels, seen)
    visible: Array = np.where(sees(camera, pixels), sigmas, np.nan)
    return visible


def sees(camera: DivisionCamera, pixels: Array) -> Mask:
    """Return whether rays reach pixels (N, 2): beyond the fold of a lens they reach others."""
    off_px = np.abs(camera.project(camera.unproject(pixels)) - pixels).max(axis=1)
    reached: Mask = off_px < 1e-3 * camera.focal_px
    return reached


def board_heights_m(shape: BoardShape) -> Array:
    """
    Return the heights (rows, columns) of a board over the plane that fits it best, metres.

    Of points from the lower left corner of the board to the upper right one.
    """
    (x, y), (half_x, half_y) = shape.center, shape.half_extent
    rows, columns = map_shape(max(half_y, 1e-9), max(half_x, 1e-9))
    xs = np.linspace(x - half_x, x + half_x, columns)
    ys = np.linspace(y - half_y, y + half_y, rows)
    points = shape.points(np.stack(np.meshgrid(xs, ys), axis=-1).reshape(-1, 2))
    plane = np.column_stack([points[:, :2], np.ones(len(points))])
    heights = points[:, 2]
    flat: Array = heights - plane @ np.linalg.lstsq(plane, heights, rcond=None)[0]
    return flat.reshape(rows, columns)
