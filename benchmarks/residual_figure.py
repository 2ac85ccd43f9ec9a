# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""The figure of ``benchmarks.residuals``."""

from __future__ import annotations

from pathlib import Path
from typing import Any, NamedTuple

import matplotlib as mpl
from matplotlib.figure import Figure
import numpy as np
from p4pfr_ros.core.geometry import Array
from p4pfr_ros.report.figure_style import BLUE, GREEN, GREY, ORANGE, STYLE

from .published import QUANTILES, RESIDUALS

# The scatter plot shows at most this many solutions, denser towards the horizon.
_SHOWN = 4_000


class Residuals(NamedTuple):
    """Residuals of all solutions, (s,) each, in the unit of the instances."""

    paper: Array
    paper_any_origin: Array
    rotation: Array
    image: Array
    rounding: Array
    horizon: Array  # smallest |1 + k r²|


def draw_figure(residuals: Residuals, output: Path) -> None:
    """Draw three panels: the histogram, its tail, and the cause of the tail."""
    with mpl.rc_context(STYLE):
        figure = Figure(figsize=(12.0, 4.3), layout='constrained')
        histogram, tail, cause = figure.subplots(1, 3)
        _draw_histogram(histogram, residuals)
        _draw_tail(tail, residuals)
        _draw_cause(cause, residuals)
        output.parent.mkdir(parents=True, exist_ok=True)
        figure.savefig(output, dpi=110)


def _definitions(residuals: Residuals) -> tuple[tuple[str, Array, str], ...]:
    return (
        ("undistorted, paper's sense", residuals.paper, BLUE),
        ('undistorted, true rotation', residuals.rotation, ORANGE),
        ('in the image, true rotation', residuals.image, GREEN),
    )


def _draw_histogram(axes: Any, residuals: Residuals) -> None:
    bins = np.arange(-18.0, -3.9, 0.2)
    for name, values, color in _definitions(residuals):
        logs = np.log10(values)
        axes.hist(logs, bins, histtype='step', color=color, linewidth=1.4, label=name)
    median = RESIDUALS['paper'][0]
    axes.axvline(median, color=GREY, linestyle=':', linewidth=1.2)
    axes.annotate(
        "the paper's\nmedian",
        (median + 0.15, 0.62),
        xycoords=('data', 'axes fraction'),
        color=GREY,
        fontsize=8,
    )
    axes.set(
        title=f'{len(residuals.paper):,} solutions, all four λ of the same sign',
        xlabel='log10 of the residual (RMS over four points)',
        ylabel='solutions per 0.2',
        xlim=(-17.5, -7.0),
    )
    axes.legend(loc='upper right')


def _draw_tail(axes: Any, residuals: Residuals) -> None:
    for _, values, color in _definitions(residuals):
        logs = np.sort(np.log10(values))
        above = 1.0 - np.arange(len(logs)) / len(logs)
        axes.plot(logs, above, color=color, linewidth=1.6)
    # Plot the maximum of n values at 1/n, with the n of this run.
    above_share = [1.0 - share for share in QUANTILES[:-1]] + [1.0 / len(residuals.paper)]
    for (name, published), marker in zip(RESIDUALS.items(), 'os^v', strict=True):
        axes.plot(
            published,
            above_share,
            marker,
            linestyle=':',
            color=GREY,
            markersize=4.5,
            linewidth=0.8,
            label=f'{name}, published',
        )
    axes.set(
        title='share with a larger residual',
        xlabel='log10 of the residual',
        yscale='log',
        ylim=(2e-5, 1.0),
        xlim=(-17.0, 10.5),
    )
    axes.legend(loc='upper right')


def _draw_cause(axes: Any, residuals: Residuals) -> None:
    ranks = np.unique(np.geomspace(1, len(residuals.horizon), _SHOWN).astype(int)) - 1
    shown = np.argsort(residuals.horizon)[ranks]
    for _, values, color in _definitions(residuals)[1:]:
        axes.plot(residuals.horizon[shown], values[shown], '.', color=color, markersize=2.2)
    w = np.geomspace(1e-6, 1.0, 50)
    axes.plot(w, np.finfo(float).eps / w**2, color='black', linewidth=1.0)
    axes.annotate('ε / (1 + k r²)²:\nrounding of k', (2e-5, 1e-5), fontsize=8)
    axes.set(
        title='cause of the tail: points near 90°',
        xlabel='smallest |1 + k r²| (0: 90° from the axis)',
        xscale='log',
        yscale='log',
        xlim=(2e-6, 30.0),
        ylim=(1e-18, 1e-3),
    )
