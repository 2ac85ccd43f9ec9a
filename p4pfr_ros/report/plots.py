# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""A calibration as a picture: where the corners were, what is left over, how it converged."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import matplotlib as mpl
from matplotlib.figure import Figure
import numpy as np
from p4pfr_ros import Keyframe, SelfCalibration
from p4pfr_ros.core.geometry import Array
from p4pfr_ros.files.yaml_fields import ConfigError
from p4pfr_ros.report.calibration_history import draw_history
from p4pfr_ros.report.calibration_run import COLUMNS, coverage, ROWS, Sighting
from p4pfr_ros.report.figure_style import BLUE, GREY, ORANGE, STYLE

ENDINGS = ('.pdf', '.png', '.svg')
# All but one residual in a hundred are drawn shorter than this part of the picture's width.
_ARROW = 0.05
_BAR_PX = (0.01, 0.02, 0.05, 0.1, 0.2, 0.5, 1.0, 2.0, 5.0, 10.0)


def check_ending(path: Path) -> None:
    """
    See that a report can be written under this name.

    Raises
    ------
    ConfigError
        Its ending is another.

    """
    if path.suffix.lower() not in ENDINGS:
        raise ConfigError(f'{path}: expected a name that ends in {", ".join(ENDINGS)}')


def write_report(path: Path, calibration: SelfCalibration, sightings: Sequence[Sighting]) -> None:
    """
    Write the `report`, in the format that the path's ending names.

    Raises
    ------
    ConfigError
        There is no such place to write to, or no such format.

    """
    check_ending(path)
    with mpl.rc_context(STYLE):
        figure = report(calibration.views, calibration.image_size, sightings)
        try:
            figure.savefig(path, dpi=120)
        except OSError as error:
            raise ConfigError(f'{path}: expected a place to write to: {error.strerror}') from None


def report(
    views: Sequence[Keyframe], image_size: tuple[int, int], sightings: Sequence[Sighting]
) -> Figure:
    """Draw corners and residuals of the views, and focal length and centre over all sightings."""
    figure = Figure(figsize=(12.0, 8.0), layout='constrained')
    parts: Any = figure.subfigures(2, 1, height_ratios=(1.45, 1.0))
    upper, lower = parts
    corners, residuals = upper.subplots(1, 2)
    _draw_coverage(corners, views, image_size)
    _draw_residuals(residuals, views, image_size)
    draw_history(lower, sightings)
    return figure


def _draw_coverage(axes: Any, views: Sequence[Keyframe], size: tuple[int, int]) -> None:
    """Draw all points, and shade the cells by how many they hold."""
    _frame(axes, size)
    used = _stacked([view.image_points[view.inliers] for view in views])
    outliers = _stacked([view.image_points[~view.inliers] for view in views])
    counts = coverage(used, size)
    width, height = size
    axes.imshow(
        np.sqrt(counts),
        cmap='Blues',
        vmin=0.0,
        vmax=2.0 * max(1.0, np.sqrt(counts.max())),
        extent=(-0.5, width - 0.5, height - 0.5, -0.5),
        aspect='equal',
    )
    axes.plot(*used.T, '.', color=BLUE, markersize=2.5)
    axes.plot(*outliers.T, 'x', color=ORANGE, markersize=4.0)
    axes.set_title(
        f'{len(used)} points of {len(views)} views'
        + (f', {len(outliers)} left out (crosses)' if len(outliers) else '')
        + f'; {100.0 * (counts > 0).mean():.0f} % of {COLUMNS}x{ROWS} cells covered'
    )


def _draw_residuals(axes: Any, views: Sequence[Keyframe], size: tuple[int, int]) -> None:
    """Draw each inlier's residual where it is, all longer by one factor."""
    _frame(axes, size)
    used = _stacked([view.image_points[view.inliers] for view in views])
    residuals = _stacked([view.residuals_px[view.inliers] for view in views])
    lengths = np.linalg.norm(residuals, axis=1)
    large = float(np.quantile(lengths, 0.99)) if len(lengths) else 0.0
    factor = _ARROW * size[0] / large if large > 0.0 else 1.0
    axes.quiver(
        *used.T,
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
    axes.set_title(f'residuals, {factor:.0f} times as long: rms {rms:.2f} px')


def _draw_scale_bar(axes: Any, size: tuple[int, int], factor: float, large: float) -> None:
    """Draw below the picture how long a round number of pixels is."""
    bar = next((px for px in _BAR_PX if px >= large), _BAR_PX[-1])
    middle, below = 0.5 * size[0], 1.04 * size[1]
    ends = middle - bar * factor, middle
    axes.plot(ends, (below, below), color=GREY, linewidth=2.0, clip_on=False)
    axes.text(middle + 0.01 * size[0], below, f'{bar:g} px', va='center', color=GREY)


def _frame(axes: Any, size: tuple[int, int]) -> None:
    """Give axes the picture's pixels, y down."""
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
