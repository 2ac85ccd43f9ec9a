# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""
The report of a calibration: coverage, residuals, uncertainty, boards and convergence.

The module stands alone because it needs matplotlib, an optional dependency.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import matplotlib as mpl
from matplotlib.figure import Figure
import numpy as np
from p4pfr_ros import CameraEstimate, Keyframe, SelfCalibration, Verdict
from p4pfr_ros.core.geometry import Array
from p4pfr_ros.files.writing import not_writable
from p4pfr_ros.files.yaml_fields import ConfigError
from p4pfr_ros.report.calibration_run import COLUMNS, count_per_cell, ROWS, ViewRecord
from p4pfr_ros.report.figure_style import BLUE, GREY, ORANGE, STYLE
from p4pfr_ros.report.number_format import plus_minus
from p4pfr_ros.report.shape_plots import draw_uncertainty_and_boards

_SUFFIXES = ('.pdf', '.png', '.svg')
# The 99th percentile of the residuals is drawn with this share of the image width.
_ARROW = 0.05
_BAR_PX = (0.01, 0.02, 0.05, 0.1, 0.2, 0.5, 1.0, 2.0, 5.0, 10.0)
# Views whose σ is larger than this multiple of the last σ do not affect the axis limits.
_MAX_SIGMA_RATIO = 8.0
# With more views than this, single views are not marked by dots.
_MAX_DOTS = 60
_LINE_STYLES = ('-', '--', ':')


def check_suffix(path: Path) -> None:
    """
    Check that the file extension is a supported format.

    Raises
    ------
    ConfigError
        It is not.

    """
    if path.suffix.lower() not in _SUFFIXES:
        raise ConfigError(f'{path}: expected a file name ending in {", ".join(_SUFFIXES)}')


def write_report(path: Path, calibration: SelfCalibration, records: Sequence[ViewRecord]) -> None:
    """
    Draw the report of a calibration and write it in the format of the file extension.

    Raises
    ------
    ConfigError
        The format is not supported, or the path is not writable.

    """
    check_suffix(path)
    with mpl.rc_context(STYLE):
        figure = draw_report(calibration.views, calibration.image_size, records, calibration.fused)
        try:
            figure.savefig(path, dpi=120)
        except OSError as error:
            raise not_writable(path, error) from None


def draw_report(
    views: Sequence[Keyframe],
    image_size: tuple[int, int],
    records: Sequence[ViewRecord],
    estimate: CameraEstimate | None = None,
) -> Figure:
    """
    Draw the keyframes, the estimate, and the camera's history over all records.

    Of the keyframes points and residuals; of the estimate, if there is one, the uncertainty over
    the image and the shapes of the boards.
    """
    height = 8.0 if estimate is None else 12.6
    figure = Figure(figsize=(12.0, height), layout='constrained')
    ratios = (1.45, 1.0) if estimate is None else (1.45, 1.45, 1.0)
    parts: Any = figure.subfigures(len(ratios), 1, height_ratios=ratios)
    coverage, residuals = parts[0].subplots(1, 2)
    _draw_coverage(coverage, views, image_size)
    _draw_residuals(residuals, views, image_size)
    if estimate is not None:
        draw_uncertainty_and_boards(parts[1], estimate, image_size, views)
    draw_history(parts[-1], records)
    return figure


def _draw_coverage(axes: Any, views: Sequence[Keyframe], size: tuple[int, int]) -> None:
    """Draw all points, and shade each cell by its number of inliers."""
    _frame(axes, size)
    inliers = _stacked([view.image_points[view.inliers] for view in views])
    outliers = _stacked([view.image_points[~view.inliers] for view in views])
    counts = count_per_cell(inliers, size)
    width, height = size
    axes.imshow(
        np.sqrt(counts),
        cmap='Blues',
        vmin=0.0,
        vmax=2.0 * max(1.0, np.sqrt(counts.max())),
        extent=(-0.5, width - 0.5, height - 0.5, -0.5),
        aspect='equal',
    )
    axes.plot(*inliers.T, '.', color=BLUE, markersize=2.5)
    axes.plot(*outliers.T, 'x', color=ORANGE, markersize=4.0)
    axes.set_title(
        f'{len(inliers)} points of {len(views)} views'
        + (f', {len(outliers)} outliers (crosses)' if len(outliers) else '')
        + f'; {100.0 * (counts > 0).mean():.0f} % of {COLUMNS}x{ROWS} cells covered'
    )


def _draw_residuals(axes: Any, views: Sequence[Keyframe], size: tuple[int, int]) -> None:
    """Draw the residual of each inlier, magnified."""
    _frame(axes, size)
    inliers = _stacked([view.image_points[view.inliers] for view in views])
    residuals = _stacked([view.residuals_px[view.inliers] for view in views])
    lengths = np.linalg.norm(residuals, axis=1)
    large = float(np.quantile(lengths, 0.99)) if len(lengths) else 0.0
    factor = _ARROW * size[0] / large if large > 0.0 else 1.0
    axes.quiver(
        *inliers.T,
        *residuals.T,
        angles='xy',
        scale_units='xy',
        scale=1.0 / factor,
        color=BLUE,
        width=0.0018,
        headwidth=4.0,
    )
    _draw_scale_bar(axes, size, factor, large)
    rms = float(np.sqrt(np.mean(lengths**2))) if len(lengths) else 0.0
    axes.set_title(f'residuals, magnified {factor:.0f} times; rms {rms:.2f} px')


def _draw_scale_bar(axes: Any, size: tuple[int, int], factor: float, large: float) -> None:
    """Draw a bar of a round number of pixels below the image; large is a typical residual."""
    bar = next((px for px in _BAR_PX if px >= large), _BAR_PX[-1])
    middle, below = 0.5 * size[0], 1.04 * size[1]
    ends = middle - bar * factor, middle
    axes.plot(ends, (below, below), color=GREY, linewidth=2.0, clip_on=False)
    axes.text(middle + 0.01 * size[0], below, f'{bar:g} px', va='center', color=GREY)


def _frame(axes: Any, size: tuple[int, int]) -> None:
    """Set the axes to the image's pixels, y down."""
    width, height = size
    axes.set(
        xlim=(-0.5, width - 0.5),
        ylim=(height - 0.5, -0.5),
        aspect='equal',
        xticks=(0, width - 1),
        yticks=(0, height - 1),
    )
    axes.spines[['top', 'right']].set_visible(True)


def _stacked(points: Sequence[Array]) -> Array:
    return np.concatenate(points) if points else np.empty((0, 2))


def draw_history(
    figure: Any,
    records: Sequence[ViewRecord],
    comparisons: Mapping[str, tuple[float, float, float]] | None = None,
) -> None:
    """
    Draw three panels: focal length, centre x and centre y ± σ over the views.

    Parameters
    ----------
    figure
        A matplotlib Figure or SubFigure.
    records
        The views; those without a camera are skipped.
    comparisons
        Focal length and centre, px, by label; drawn as horizontal lines for comparison.

    """
    shown = [(record, record.fused) for record in records if record.fused is not None]
    numbers = np.array([record.number for record, _ in shown])
    estimates = [fused for _, fused in shown]
    values = np.array([_values(e) for e in estimates]).reshape(-1, 3)
    sigmas = np.array([_sigmas(e) for e in estimates]).reshape(-1, 3)
    restarts = [record.number for record, _ in shown if record.verdict is Verdict.RESTARTED]
    names = ('focal length', 'centre x', 'centre y')
    panels = figure.subplots(1, 3)
    for i, (axes, name) in enumerate(zip(panels, names, strict=True)):
        _draw_parameter(axes, numbers, values[:, i], sigmas[:, i])
        for number in restarts:
            axes.axvline(number, color=ORANGE, linestyle=':', linewidth=1.2)
        for style, (label, camera) in zip(_LINE_STYLES, (comparisons or {}).items(), strict=False):
            axes.axhline(camera[i], color=ORANGE, linestyle=style, linewidth=1.2, label=label)
        title = f'{name}, px: {plus_minus(values[-1, i], sigmas[-1, i])}' if estimates else name
        axes.set(title=title, xlabel='view')
        axes.xaxis.get_major_locator().set_params(integer=True)
    if comparisons:
        panels[0].legend(loc='upper right')


def _draw_parameter(axes: Any, numbers: Array, values: Array, sigmas: Array) -> None:
    """Draw a line with a band of ± σ; circles mark views where the parameter was held fixed."""
    if not len(values):
        return
    free = sigmas > 0.0
    band = np.where(free, sigmas, np.nan)
    axes.fill_between(numbers, values - band, values + band, color=BLUE, alpha=0.2, linewidth=0.0)
    axes.plot(numbers, values, color=BLUE, linewidth=1.2)
    if len(values) <= _MAX_DOTS:
        axes.plot(numbers[free], values[free], '.', color=BLUE, markersize=5)
    axes.plot(numbers[~free], values[~free], 'o', color=BLUE, markerfacecolor='white')
    max_sigma = _MAX_SIGMA_RATIO * sigmas[-1] if free[-1] else np.inf
    in_limits = sigmas <= max_sigma
    low = float((values - sigmas)[in_limits].min())
    high = float((values + sigmas)[in_limits].max())
    margin = 0.15 * (high - low) or 1.0
    axes.set_ylim(low - margin, high + margin)
    axes.grid(axis='y', color=GREY, alpha=0.15)


def _values(estimate: CameraEstimate) -> tuple[float, float, float]:
    return (estimate.camera.focal_px, *estimate.camera.center_px)


def _sigmas(estimate: CameraEstimate) -> tuple[float, float, float]:
    x, y = estimate.center_sigma_px
    return (float(estimate.focal_sigma_px), float(x), float(y))
