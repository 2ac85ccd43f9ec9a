# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""
Draws docs/conventions.png from the numbers that the tests check.

    python docs/draw_conventions.py [--output docs/conventions.png]
"""

from __future__ import annotations

import argparse
from itertools import pairwise
from pathlib import Path
from textwrap import fill
from typing import Any

import matplotlib as mpl
from matplotlib.figure import Figure
from matplotlib.patheffects import withStroke
import numpy as np
from p4pfr_ros.boards import Marker
from p4pfr_ros.boards.conventions import Convention, CONVENTIONS, CORNER_ORDERS
from p4pfr_ros.rendering.pattern import black_shapes
from p4pfr_ros.report.figure_style import STYLE

TAG = Marker(id=0, size_m=1.0, dictionary='DICT_APRILTAG_36h11')
# The colours of x, y and z in ROS.
AXES = ('#d8392f', '#3a9a4b', '#3f66d9')
PAPER, INK, GREY, ORANGE = '#f4f4f2', '#cccccc', '#555555', '#d9722b'
AXIS_LENGTH = 0.36


def main() -> None:
    """Draw the figure."""
    parser = argparse.ArgumentParser(description=__doc__.split('\n\n')[0])
    parser.add_argument('--output', type=Path, default=Path('docs/conventions.png'), help='figure')
    output = parser.parse_args().output
    with mpl.rc_context(STYLE):
        figure = Figure(figsize=(10.0, 7.0), layout='constrained')
        panels = figure.subplots(2, 3).ravel()
        for axes, (names, convention) in zip(panels, _distinct_conventions(), strict=False):
            _draw_marker(axes, names, convention)
        _draw_pixels(panels[-2])
        _draw_camera(panels[-1])
        figure.savefig(output, dpi=110)


def _distinct_conventions() -> list[tuple[list[str], Convention]]:
    """Return the distinct conventions, each with the packages that use it."""
    groups: list[tuple[list[str], Convention]] = []
    for name, convention in CONVENTIONS.items():
        for names, other in groups:
            same_axes = np.array_equal(
                convention.ours_from_theirs.rotation, other.ours_from_theirs.rotation
            )
            if same_axes and convention.corner_order == other.corner_order:
                names.append(name)
                break
        else:
            groups.append(([name], convention))
    return groups


def _draw_marker(axes: Any, names: list[str], convention: Convention) -> None:
    """Draw an upright marker with the axes and the numbered corners of a convention."""
    axes.fill(*(0.64 * np.array([[-1, 1, 1, -1], [-1, -1, 1, 1]])), color=PAPER)
    for quad in black_shapes(TAG):
        axes.fill(*quad.T, color=INK, linewidth=0.0)
    corners = np.array(CORNER_ORDERS[convention.corner_order])
    for start, end in pairwise(1.13 * corners):
        _arrow(axes, start + 0.16 * (end - start), end - 0.16 * (end - start), ORANGE)
    for number, corner in enumerate(corners):
        axes.plot(*corner, 'o', color=ORANGE, markersize=5)
        axes.text(*(1.15 * corner), str(number), color=ORANGE, size=13, ha='center', va='center')
    for name, axis, color in zip('xyz', convention.ours_from_theirs.rotation.T, AXES, strict=True):
        _draw_axis(axes, name, axis, color)
    _finish(axes, fill(', '.join(names), 28), 0.75)


def _draw_axis(axes: Any, name: str, axis: Any, color: str) -> None:
    """Draw one axis as the viewer sees it: an arrow, or a dot or cross along the line of sight."""
    if abs(axis[2]) < 0.5:
        end = AXIS_LENGTH * axis[:2]
        _arrow(axes, (0.0, 0.0), end, color, width=3.0)
        axes.text(*(1.22 * end), name, color=color, size=13, ha='center', va='center')
        return
    axes.plot(0.0, 0.0, 'o', markersize=17, color='white', markeredgecolor=color, mew=2.5)
    axes.plot(0.0, 0.0, '.' if axis[2] > 0.0 else 'x', markersize=9, color=color, mew=2.5)
    direction = 'z, to the viewer' if axis[2] > 0.0 else 'z, into the marker'
    place = (-0.07, -0.1 * np.sign(axis[2]))
    halo = [withStroke(linewidth=3.0, foreground='white')]
    axes.text(*place, direction, color=color, size=9, ha='right', va='center', path_effects=halo)


def _draw_pixels(axes: Any) -> None:
    """Draw the first pixels of an image, with the coordinates of their centres."""
    for row in range(2):
        for column in range(2):
            shade = PAPER if (row + column) % 2 else '#dcdcda'
            axes.fill(column + np.array([0, 1, 1, 0]), row + np.array([0, 0, 1, 1]), color=shade)
            axes.plot(column + 0.5, row + 0.5, 'k.', markersize=4)
            ours, theirs = f'({column}, {row})', f'({column}.5, {row}.5)'
            axes.text(column + 0.5, row + 0.36, ours, color=AXES[2], ha='center')
            axes.text(column + 0.5, row + 0.72, theirs, color=ORANGE, ha='center')
    axes.text(0.0, 2.15, 'OpenCV, image_proc, p4pfr_ros', color=AXES[2])
    axes.text(0.0, 2.33, 'AprilTag library, apriltag_ros', color=ORANGE)
    _finish(axes, 'centres of the first four pixels', None)
    axes.set(xlim=(-0.15, 2.15), ylim=(2.45, -0.1))


def _draw_camera(axes: Any) -> None:
    """Draw the optical frame of REP-103, seen from behind the camera."""
    axes.fill([0.0, 1.6, 1.6, 0.0], [0.0, 0.0, 1.2, 1.2], color=PAPER)
    axes.plot([0.0, 1.6, 1.6, 0.0, 0.0], [0.0, 0.0, 1.2, 1.2, 0.0], color=GREY, linewidth=1.0)
    middle = np.array([0.8, 0.6])
    for name, axis, color in (('x', (1, 0), AXES[0]), ('y', (0, 1), AXES[1])):
        end = middle + 0.42 * np.array(axis)
        _arrow(axes, middle, end, color, width=3.0)
        axes.text(
            *(end + 0.09 * np.array(axis)), name, color=color, size=13, ha='center', va='center'
        )
    axes.plot(*middle, 'o', markersize=17, color='white', markeredgecolor=AXES[2], mew=2.5)
    axes.plot(*middle, 'x', markersize=9, color=AXES[2], mew=2.5)
    axes.text(0.72, 0.48, 'z, forward', color=AXES[2], size=9, ha='right', va='center')
    axes.text(0.03, 0.08, 'u to the right, v down', color=GREY, va='center')
    _finish(axes, 'optical frame (REP-103), on the image', None)
    axes.set(xlim=(-0.1, 1.7), ylim=(1.5, -0.3))


def _arrow(axes: Any, start: Any, end: Any, color: str, width: float = 1.2) -> None:
    style = {'arrowstyle': '-|>', 'color': color, 'linewidth': width, 'shrinkA': 0, 'shrinkB': 0}
    axes.annotate('', xy=end, xytext=start, arrowprops=style | {'mutation_scale': 8 + 3 * width})


def _finish(axes: Any, title: str, reach: float | None) -> None:
    axes.set_title(title)
    axes.set_aspect('equal')
    axes.set_axis_off()
    if reach is not None:
        axes.set(xlim=(-reach, reach), ylim=(-reach, reach))


if __name__ == '__main__':
    main()
