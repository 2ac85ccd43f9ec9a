# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""
Two maps of a calibration: how well the camera is known, and the shape of each board.

The module stands alone because its maps are of the result; ``plots`` shows the views behind it.
"""

from __future__ import annotations

from collections.abc import Sequence
import math
from typing import Any

from matplotlib.collections import LineCollection
import numpy as np
from p4pfr_ros import BoardShape, CameraEstimate, Keyframe
from p4pfr_ros.core.geometry import Array, Mask
from p4pfr_ros.report.figure_style import GREY
from p4pfr_ros.report.maps import board_heights_m, map_shape, uncertainty_map_px
from p4pfr_ros.report.number_format import shape_text

# More boards are not drawn.
_MAX_BOARDS = 2
# The colours of the uncertainty end at this multiple of the largest one where points were seen.
_MAX_RATIO = 4.0


def draw_uncertainty_and_boards(
    figure: Any,
    estimate: CameraEstimate,
    image_size: tuple[int, int],
    views: Sequence[Keyframe],
) -> None:
    """
    Draw the uncertainty of the camera over the image, and the heights of up to two boards.

    Parameters
    ----------
    figure
        A matplotlib Figure or SubFigure.
    estimate
        The camera and the shapes.
    image_size
        Width and height of the image, pixels.
    views
        Their points are marked on the boards.

    """
    boards = list(estimate.board_shapes.items())[:_MAX_BOARDS]
    axes = np.atleast_1d(figure.subplots(1, 1 + max(len(boards), 1)))
    _draw_uncertainty(figure, axes[0], estimate, image_size)
    for panel, (name, shape) in zip(axes[1:], boards, strict=False):
        points = [view.board_points for view in views if view.board == name]
        _draw_board(figure, panel, name, shape, np.unique(np.concatenate(points), axis=0))
    if not boards:
        axes[1].set_axis_off()


def _draw_uncertainty(
    figure: Any, axes: Any, estimate: CameraEstimate, size: tuple[int, int]
) -> None:
    """Draw the standard deviation of projections, and the outline of the part that was seen."""
    width, height = size
    sigmas = uncertainty_map_px(estimate, size, map_shape(height, width))
    known_px = estimate.projection_sigma_px
    largest = known_px if known_px > 0.0 else float(np.nanmedian(sigmas))
    extent = (-0.5, width - 0.5, height - 0.5, -0.5)
    image = axes.imshow(
        np.ma.masked_invalid(sigmas),
        cmap='viridis',
        vmin=0.0,
        vmax=_MAX_RATIO * largest,
        extent=extent,
        aspect='equal',
        interpolation='nearest',
    )
    axes.set_facecolor('lightgrey')
    if estimate.coverage is not None:
        _outline(axes, estimate.coverage, size)
    axes.set(xlim=extent[:2], ylim=extent[2:], xticks=(0, width - 1), yticks=(0, height - 1))
    _colour_bar(figure, axes, image, 'standard deviation of a projection, px', extend='max')
    title = 'projection uncertainty'
    if not math.isnan(known_px):
        title += f': {known_px:.2g} px at most where seen (white)'
    axes.set_title(title)


def _colour_bar(figure: Any, axes: Any, image: Any, label: str, extend: str = 'neither') -> None:
    """Draw a colour bar as high as the map."""
    bar = figure.colorbar(image, cax=axes.inset_axes((1.02, 0.0, 0.035, 1.0)), extend=extend)
    bar.set_label(label)


def _outline(axes: Any, seen: Mask, size: tuple[int, int]) -> None:
    """Outline the cells in which points were seen."""
    rows, columns = seen.shape
    padded = np.pad(seen, 1)
    xs, ys = (np.linspace(0.0, size[i], n + 1) - 0.5 for i, n in ((0, columns), (1, rows)))
    beside = np.nonzero(padded[1:-1, :-1] != padded[1:-1, 1:])
    above = np.nonzero(padded[:-1, 1:-1] != padded[1:, 1:-1])
    segments = [
        *([(xs[j], ys[i]), (xs[j], ys[i + 1])] for i, j in zip(*beside, strict=True)),
        *([(xs[j], ys[i]), (xs[j + 1], ys[i])] for i, j in zip(*above, strict=True)),
    ]
    lines = LineCollection(segments, colors='white', linewidths=1.5, capstyle='projecting')
    axes.add_collection(lines)


def _draw_board(figure: Any, axes: Any, name: str, shape: BoardShape, points: Array) -> None:
    """Draw the height of a board over its best plane."""
    (x, y), (half_x, half_y) = shape.center, shape.half_extent
    heights_mm = 1e3 * board_heights_m(shape)
    limit = max(float(np.abs(heights_mm).max()), 0.05)
    extent = [1e3 * side for side in (x - half_x, x + half_x, y - half_y, y + half_y)]
    image = axes.imshow(
        heights_mm,
        cmap='RdBu_r',
        vmin=-limit,
        vmax=limit,
        origin='lower',
        extent=extent,
        aspect='equal',
        interpolation='bilinear',
    )
    axes.plot(*(1e3 * points.T), '.', color=GREY, markersize=4.0, clip_on=False)
    axes.set(xlabel='x, mm', ylabel='y, mm')
    _colour_bar(figure, axes, image, 'height over the best plane, mm (red: to the viewer)')
    title = 'shape of the board' + (f' {name}' if name else '')
    axes.set_title(f'{title}, points as dots:\n{shape_text(shape)}')
