# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""
The figures of the HTML report.

This module stands alone: ``html_report`` writes the page around the figures, ``svg`` draws lines.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
import math

import cv2
import numpy as np
from p4pfr_ros import BoardShape, CameraEstimate, DivisionCamera, Keyframe
from p4pfr_ros.core.geometry import Array
from p4pfr_ros.core.model.lens import camera_from_lens, lens_from_camera, LENS_SIZE
from p4pfr_ros.report.calibration_run import count_per_cell, ViewRecord
from p4pfr_ros.report.comparison import CameraDifference
from p4pfr_ros.report.maps import (
    board_heights_m,
    cell_middles,
    map_shape,
    uncertainty_map_px,
)
from p4pfr_ros.report.number_format import plus_minus, shape_text
from p4pfr_ros.report.svg import Chart, colour_scale, DIVERGING, ImageMap

MAP_CELLS = 48
# Residuals are magnified so that the 99th percentile has this share of the image's width.
_ARROW = 0.05
# An arrow of a difference stands for so many cells along each side.
_ARROW_CELLS = 3
# Points of a curve, and the standard deviations of its band.
_POINTS, _BAND = 121, 2.0
# Steps of the derivatives by the lens, standard deviations.
_STEP = 1e-2
# Estimates whose σ is larger than this multiple of the last one do not set the limits of an axis.
_MAX_SIGMA_RATIO = 8.0
# Angles from the optical axis beyond which a pinhole has no use, degrees.
_WIDEST_PINHOLE_DEG = 80.0


@dataclass(frozen=True, slots=True)
class Figure:
    """A figure: its title, HTML, and what it shows, in words."""

    title: str
    html: str
    caption: str


def uncertainty_figure(
    estimate: CameraEstimate, size: tuple[int, int], tolerance_px: float
) -> Figure:
    """Show the standard deviation of projections over the image."""
    sigmas = uncertainty_map_px(estimate, size, map_shape(size[1], size[0], MAP_CELLS))
    end = 2.0 * max(estimate.projection_sigma_px, 1e-3)
    drawing = ImageMap(size, 'Map of projection uncertainty')
    drawing.heat(sigmas, 0.0, end, cv2.COLORMAP_VIRIDIS)
    if estimate.coverage is not None:
        drawing.outline(estimate.coverage)
    labels = ('0', f'{0.5 * end:.2g} px', f'≥ {end:.2g} px')
    return Figure(
        'Projection uncertainty',
        drawing.svg() + colour_scale(cv2.COLORMAP_VIRIDIS, labels),
        'Standard deviation of the pixel that sees a given direction. Outlined: where points were '
        f'seen; there it is {estimate.projection_sigma_px:.2g} px at most, '
        f'{tolerance_px:.2g} px are tolerated. Outside, the lens is extrapolated.',
    )


def coverage_figure(views: Sequence[Keyframe], size: tuple[int, int]) -> Figure:
    """Show all points, and cells that hold some."""
    inliers = _stacked([view.image_points[view.inliers] for view in views])
    outliers = _stacked([view.image_points[~view.inliers] for view in views])
    filled = count_per_cell(inliers, size) > 0
    drawing = ImageMap(size, 'Coverage of the image')
    drawing.cells(filled, 'covered')
    drawing.dots(inliers + 0.5, 'point')
    drawing.dots(outliers + 0.5, 'outlier', 2.2)
    words = f'{len(inliers)} points of {len(views)} views'
    if len(outliers):
        words += f', and {len(outliers)} outliers (large dots)'
    share = 100.0 * filled.mean()
    return Figure('Coverage', drawing.svg(), f'{words}; {share:.0f} % of the cells hold points.')


def residuals_figure(views: Sequence[Keyframe], size: tuple[int, int]) -> Figure:
    """Show the residual of each point, magnified."""
    points = _stacked([view.image_points[view.inliers] for view in views])
    residuals = _stacked([view.residuals_px[view.inliers] for view in views])
    lengths = np.linalg.norm(residuals, axis=1)
    large = float(np.quantile(lengths, 0.99)) if len(lengths) else 0.0
    factor = _ARROW * size[0] / large if large > 0.0 else 1.0
    drawing = ImageMap(size, 'Residuals')
    drawing.arrows(points + 0.5, factor * residuals)
    rms = float(np.sqrt(np.mean(lengths**2))) if len(lengths) else 0.0
    return Figure(
        'Residuals',
        drawing.svg(),
        f'Reprojected minus observed, magnified {factor:.0f} times; rms {rms:.3f} px, 99 % below '
        f'{large:.2g} px. Arrows without a pattern are noise; neighbours in one direction are an '
        'error of the model.',
    )


def distortion_figure(estimate: CameraEstimate, size: tuple[int, int]) -> Figure:
    """Show the radius in the image over the angle from the optical axis."""
    camera = estimate.camera
    corners = np.array([(x, y) for x in (-0.5, size[0] - 0.5) for y in (-0.5, size[1] - 0.5)])
    corner_px = float(np.linalg.norm(corners - camera.center_px, axis=1).max())
    widest_rad = _angle_rad(camera, min(corner_px, 0.999 * camera.fold_radius * camera.focal_px))
    angles = np.linspace(0.0, widest_rad, _POINTS)
    radii, sigmas = _radii_px(estimate, angles)
    degrees = np.degrees(angles)
    chart = Chart(
        (0.0, float(degrees[-1])),
        (0.0, 1.05 * float(np.nanmax(radii))),
        'angle from the optical axis, degrees',
        'radius in the image, px',
        'Radius in the image over the angle from the optical axis',
    )
    narrow = np.minimum(angles, math.radians(_WIDEST_PINHOLE_DEG))
    chart.line(degrees, camera.focal_px * np.tan(narrow), 'reference')
    chart.band(degrees, radii - _BAND * sigmas, radii + _BAND * sigmas)
    chart.line(degrees, radii, 'curve')
    seen_px = estimate.seen_radius_px
    if seen_px is not None and seen_px < corner_px:
        chart.vertical(math.degrees(_angle_rad(camera, seen_px)), 'outermost point')
    return Figure(
        'Distortion',
        chart.svg(),
        f'Solid: the lens, with a band of {_BAND:g} standard deviations; dashed: a lens without '
        f'distortion. The corner of the image is {degrees[-1]:.1f}° off the axis.',
    )


def _angle_rad(camera: DivisionCamera, radius_px: float) -> float:
    """Return the angle of the ray at a radius to the right of the centre."""
    x, y = camera.center_px
    ray = camera.unproject(np.array([x + radius_px, y]))
    return math.atan2(float(np.hypot(*ray[:2])), float(ray[2]))


def _radii_px(estimate: CameraEstimate, angles: Array) -> tuple[Array, Array]:
    """Return the radii (N,) of rays to the right at angles, and their standard deviations."""
    camera = estimate.camera
    rays = np.stack([np.sin(angles), np.zeros_like(angles), np.cos(angles)], axis=-1)
    lens = lens_from_camera(camera, camera.center_px)

    def radii_of(moved: Array) -> Array:
        other = camera_from_lens(moved, camera.center_px)
        radii: Array = np.linalg.norm(other.project(rays) - other.center_px, axis=1)
        return radii

    columns = np.zeros((len(angles), LENS_SIZE))
    for i, sigma in enumerate(np.sqrt(np.maximum(np.diag(estimate.covariance), 0.0))):
        if sigma > 0.0:
            step = np.zeros(LENS_SIZE)
            step[i] = _STEP * sigma
            columns[:, i] = (radii_of(lens + step) - radii_of(lens - step)) / (2.0 * step[i])
    variances = np.sum(columns @ estimate.covariance * columns, axis=1)
    return radii_of(lens), np.sqrt(np.maximum(np.nan_to_num(variances), 0.0))


def convergence_figures(records: Sequence[ViewRecord]) -> list[Figure]:
    """Show focal length and centre ± σ over the views."""
    shown = [(record, record.fused) for record in records if record.fused is not None]
    if len(shown) < 2:
        return []
    numbers = np.array([record.number for record, _ in shown], dtype=float)
    values = np.array([(f.camera.focal_px, *f.camera.center_px) for _, f in shown])
    sigmas = np.array([(f.focal_sigma_px, *f.center_sigma_px) for _, f in shown])
    names = ('focal length', 'centre x', 'centre y')
    titles = [f'{record.name}: {record.verdict.name.lower()}' for record, _ in shown]
    figures = []
    for i, name in enumerate(names):
        html = _course(name, numbers, values[:, i], sigmas[:, i], titles)
        figures.append(
            Figure(name.capitalize(), html, f'{plus_minus(values[-1, i], sigmas[-1, i])} px')
        )
    return figures


def _course(name: str, numbers: Array, values: Array, sigmas: Array, titles: Sequence[str]) -> str:
    relevant = (sigmas > 0.0) & (sigmas <= _MAX_SIGMA_RATIO * max(sigmas[-1], 1e-9))
    relevant[-1] = True
    low = float((values - sigmas)[relevant].min())
    high = float((values + sigmas)[relevant].max())
    margin = 0.12 * (high - low) or 1.0
    chart = Chart(
        (float(numbers[0]), float(numbers[-1])),
        (low - margin, high + margin),
        'image',
        f'{name}, px',
        f'{name} over the images',
        width=340.0,
        height=210.0,
    )
    chart.band(numbers, values - sigmas, values + sigmas)
    chart.line(numbers, values, 'curve')
    chart.dots(numbers, values, 'dot', titles)
    return chart.svg()


def board_figure(name: str, shape: BoardShape, points: Array) -> Figure:
    """Show the height of a board over the plane that fits it best, and its points (N, 2)."""
    low, extent = shape.center - shape.half_extent, 2.0 * np.maximum(shape.half_extent, 1e-9)
    # The first row of a drawing is the upper one.
    heights_mm = 1e3 * board_heights_m(shape)[::-1]
    limit = max(float(np.abs(heights_mm).max()), 0.05)
    drawing = ImageMap((float(extent[0]), float(extent[1])), f'Shape of the board {name}')
    drawing.heat(heights_mm, -limit, limit, DIVERGING)
    drawing.dots((points - low) * (1.0, -1.0) + (0.0, extent[1]), 'mark-dot')
    labels = (f'−{limit:.2g} mm', '0', f'+{limit:.2g} mm (towards the viewer)')
    return Figure(
        name or 'board',
        drawing.svg() + colour_scale(DIVERGING, labels),
        f'Height over the best plane: {shape_text(shape)}.',
    )


def comparison_figures(
    difference: CameraDifference, estimate: CameraEstimate, size: tuple[int, int]
) -> list[Figure]:
    """Show by how many pixels another camera's projections differ, and in which direction."""
    end = 2.0 * max(difference.largest_px, 1e-3)
    lengths = ImageMap(size, 'Length of the difference')
    lengths.heat(difference.lengths_px, 0.0, end, cv2.COLORMAP_MAGMA)
    directions = ImageMap(size, 'Direction of the difference')
    vectors = difference.vectors_px
    coarse = vectors[1::_ARROW_CELLS, 1::_ARROW_CELLS].reshape(-1, 2)
    all_places = cell_middles(size, difference.lengths_px.shape).reshape(vectors.shape)
    places = all_places[1::_ARROW_CELLS, 1::_ARROW_CELLS].reshape(-1, 2)
    shown = np.linalg.norm(coarse, axis=1) <= end
    factor = _ARROW * size[0] / max(difference.largest_px, 1e-3)
    directions.arrows(places[shown] + 0.5, factor * coarse[shown])
    if estimate.coverage is not None:
        lengths.outline(estimate.coverage)
        directions.outline(estimate.coverage, 'border')
    labels = ('0', f'{0.5 * end:.2g} px', f'≥ {end:.2g} px')
    return [
        Figure(
            'Length',
            lengths.svg() + colour_scale(cv2.COLORMAP_MAGMA, labels),
            'Distance between the pixels at which the two cameras see the same direction. Where '
            f'points were seen (outlined): {difference.largest_px:.2g} px at most, '
            f'{difference.rms_px:.2g} px rms.',
        ),
        Figure(
            'Direction',
            directions.svg(),
            f'From this camera to the other, magnified {factor:.0f} times; longer arrows than '
            f'{end:.2g} px are left out.',
        ),
    ]


def _stacked(points: Sequence[Array]) -> Array:
    return np.concatenate(points) if points else np.empty((0, 2))
