# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""Focal length and centre over the views of a calibration, with what is left of doubt."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from p4pfr_ros import CameraEstimate, Verdict
from p4pfr_ros.core.geometry import Array
from p4pfr_ros.report.calibration_run import Sighting
from p4pfr_ros.report.figure_style import BLUE, GREY, ORANGE
from p4pfr_ros.report.numbers import plus_minus

# A view whose σ is more than so many times the last one's does not choose the scale.
_LEGIBLE = 8.0
# With more views than this, each has no dot of its own.
_MOST_DOTS = 60
_LINES = ('-', '--', ':')


def draw_history(
    figure: Any,
    sightings: Sequence[Sighting],
    peers: Mapping[str, tuple[float, float, float]] | None = None,
) -> None:
    """
    Draw three panels: focal length, centre x and centre y ± σ over the views.

    Parameters
    ----------
    figure
        A matplotlib Figure or SubFigure.
    sightings
        What to draw: those after which there was a camera.
    peers
        Focal lengths and centres, px, to be drawn as lines, by whose they are.

    """
    known = [seen for seen in sightings if seen.fused is not None]
    numbers = np.array([seen.number for seen in known])
    estimates = [seen.fused for seen in known if seen.fused is not None]
    values = np.array([_values(e) for e in estimates]).reshape(-1, 3)
    sigmas = np.array([_sigmas(e) for e in estimates]).reshape(-1, 3)
    restarts = [seen.number for seen in known if seen.verdict is Verdict.RESTARTED]
    names = ('focal length', 'centre x', 'centre y')
    panels = figure.subplots(1, 3)
    for i, (axes, name) in enumerate(zip(panels, names, strict=True)):
        _draw_one(axes, numbers, values[:, i], sigmas[:, i])
        for number in restarts:
            axes.axvline(number, color=ORANGE, linestyle=':', linewidth=1.2)
        for style, (whose, peer) in zip(_LINES, (peers or {}).items(), strict=False):
            axes.axhline(peer[i], color=ORANGE, linestyle=style, linewidth=1.2, label=whose)
        title = f'{name}, px: {plus_minus(values[-1, i], sigmas[-1, i])}' if known else name
        axes.set(title=title, xlabel='view')
        axes.xaxis.get_major_locator().set_params(integer=True)
    if peers:
        panels[0].legend(loc='upper right')


def _draw_one(axes: Any, numbers: Array, values: Array, sigmas: Array) -> None:
    """Draw a line with a band of ± σ, and circles where a number was held and not estimated."""
    if not len(values):
        return
    free = sigmas > 0.0
    band = np.where(free, sigmas, np.nan)
    axes.fill_between(numbers, values - band, values + band, color=BLUE, alpha=0.2, linewidth=0.0)
    axes.plot(numbers, values, color=BLUE, linewidth=1.2)
    if len(values) <= _MOST_DOTS:
        axes.plot(numbers[free], values[free], '.', color=BLUE, markersize=5)
    axes.plot(numbers[~free], values[~free], 'o', color=BLUE, markerfacecolor='white')
    legible = ~free | (sigmas <= _LEGIBLE * sigmas[-1]) if free[-1] else np.full(len(free), True)
    low = float((values - sigmas)[legible].min())
    high = float((values + sigmas)[legible].max())
    margin = 0.15 * (high - low) or 1.0
    axes.set_ylim(low - margin, high + margin)
    axes.grid(axis='y', color=GREY, alpha=0.15)


def _values(estimate: CameraEstimate) -> tuple[float, float, float]:
    return (estimate.camera.focal_px, *estimate.camera.center_px)


def _sigmas(estimate: CameraEstimate) -> tuple[float, float, float]:
    x, y = estimate.center_sigma_px
    return (float(estimate.focal_sigma_px), float(x), float(y))
