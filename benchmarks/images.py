# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""
Draws depth_cone.png and sextic.png of docs/derivation.md, both for one instance.

    python -m benchmarks.images [--output docs]
"""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any, NamedTuple

import matplotlib as mpl
from matplotlib.figure import Figure
import numpy as np
from p4pfr_ros.core.geometry import Array
from p4pfr_ros.core.minimal.cone import board_weights, depth_cone
from p4pfr_ros.core.minimal.four import points_of
from p4pfr_ros.core.minimal.pose import scale_board, scale_image
from p4pfr_ros.core.minimal.sextic import coefficients, evaluate, Factors, factors
from p4pfr_ros.report.figure_style import STYLE
from p4pfr_ros.scenes.instances import draw_instances

_DOCS = Path(__file__).parent.parent / 'docs'

# An instance with four roots that are well separated in the figure.
_SEED = 188
COLORS = ('#1f5fa8', '#d9722b', '#3a8f5c', '#8a4f9e')
SHADE, INK = '#e8eef5', '#333333'


class Scene(NamedTuple):
    """The depth cone and the sextic of one instance."""

    rays: Array
    factors: Factors


def main(arguments: list[str] | None = None) -> int:
    """Draw both figures."""
    parser = argparse.ArgumentParser(
        prog='python -m benchmarks.images', description=__doc__.split('\n\n')[0]
    )
    parser.add_argument(
        '--output', type=Path, default=_DOCS, metavar='FOLDER', help='default: docs'
    )
    output = parser.parse_args(arguments).output
    scene = prepare(_SEED)
    with mpl.rc_context(STYLE):
        _draw_cone(scene).savefig(output / 'depth_cone.png', dpi=110)
        _draw_sextic(scene).savefig(output / 'sextic.png', dpi=110)
    return 0


def prepare(seed: int) -> Scene:
    """Run the first steps of the solver on an instance."""
    drawn = draw_instances('patch', 1, seed)
    image, board = drawn.image_points[0], drawn.board_points[0]
    _, scaled, radius = scale_image(points_of(image))
    _, weights = board_weights(points_of(board))
    cone = depth_cone(scaled, radius, weights)
    duals = scale_board(points_of(board)).duals
    return Scene(np.array([cone.a, cone.b]), factors(scaled, weights, cone, duals))


def roots(f: Factors, low: float = 0.0, high: float = 1.0) -> Array:
    """Return the real roots between two τ, by dense sampling and bisection."""
    tau = np.linspace(low, high, 20_001)
    signs = np.sign(values(f, tau))
    located = []
    for i in np.nonzero(signs[:-1] * signs[1:] < 0.0)[0]:
        left, right = tau[i], tau[i + 1]
        for _ in range(60):
            middle = 0.5 * (left + right)
            if np.sign(evaluate(f, middle).sextic) == signs[i]:
                left = middle
            else:
                right = middle
        located.append(left)
    return np.array(located)


def values(f: Factors, tau: Array) -> Array:
    """Evaluate the sextic at many τ."""
    return np.array([evaluate(f, float(t)).sextic for t in tau])


def _draw_cone(scene: Scene) -> Figure:
    figure = Figure(figsize=(9.5, 3.8), layout='constrained')
    plane, depths = figure.subplots(1, 2)
    _draw_plane(plane, scene)
    _draw_depths(depths, scene)
    return figure


def _draw_plane(axes: Any, scene: Scene) -> None:
    """Draw the plane Σ λᵢ vᵢ = 0 in R⁴ and the lines on which one depth is zero."""
    a, b = scene.rays
    first = (a + b) / np.linalg.norm(a + b)
    second = b - a - ((b - a) @ first) * first
    second /= np.linalg.norm(second)
    a2, b2 = (np.array([ray @ second, ray @ first]) for ray in (a, b))
    far = 3.0
    axes.fill([0.0, far * a2[0], far * b2[0]], [0.0, far * a2[1], far * b2[1]], color=SHADE)
    for i, color in enumerate(COLORS):
        # λᵢ = α first + β second is zero along (-first, second), in the axes (second, first).
        along = np.array([-first[i], second[i]])
        along *= 2.0 / np.linalg.norm(along)
        axes.plot(*np.outer(along, [-1.0, 1.0]), color=color, linewidth=1.3, label=f'λ{i + 1} = 0')
    for ray, name in ((a2, 'a'), (b2, 'b')):
        axes.annotate('', ray, (0.0, 0.0), arrowprops={'arrowstyle': '-|>', 'color': INK})
        axes.annotate(name, ray * 1.12, ha='center', va='center', fontsize=12, style='italic')
    axes.plot(*np.column_stack([a2, b2]), color=INK, linewidth=2.2)
    axes.annotate(
        '(1 - τ) a + τ b', 0.5 * (a2 + b2), xytext=(0, 14), textcoords='offset points', ha='center'
    )
    size = 1.35 * max(np.linalg.norm(a2), np.linalg.norm(b2))
    axes.set(xlim=(-size, size), ylim=(-0.5 * size, size), aspect='equal', xticks=[], yticks=[])
    axes.set_title('the plane Σ λᵢ vᵢ = 0; shaded: all λ ≥ 0')
    axes.legend(loc='lower right', ncols=2, frameon=True, edgecolor='none', framealpha=1.0)


def _draw_depths(axes: Any, scene: Scene) -> None:
    low, high = -0.6, 1.6
    tau = np.array([low, high])
    axes.axvspan(0.0, 1.0, color=SHADE)
    axes.axhline(0.0, color=INK, linewidth=0.8)
    for i, color in enumerate(COLORS):
        a, b = scene.rays[:, i]
        axes.plot(tau, (1.0 - tau) * a + tau * b, color=color, linewidth=1.5, label=f'λ{i + 1}')
    for root in roots(scene.factors, low, high):
        inside = 0.0 < root < 1.0
        axes.plot(root, 0.0, 'o', color=INK, markerfacecolor=INK if inside else 'white', zorder=5)
    axes.set(
        title='depths along the cone; dots: real roots of the sextic',
        xlabel='τ',
        ylabel='λ (sum 1)',
        xlim=(low, high),
    )
    axes.legend(loc='upper center', ncols=4)


def _draw_sextic(scene: Scene) -> Figure:
    figure = Figure(figsize=(9.5, 3.8), layout='constrained')
    whole, parts = figure.subplots(1, 2, sharex=True)
    f = scene.factors
    _draw_curve(whole, f)
    _draw_polygon(whole, f, 0.0, 1.0, COLORS[0])
    whole.set_title(f'one interval: {variations(f, 0.0, 1.0)} sign changes')
    _draw_curve(parts, f)
    for j, (low, high) in enumerate(isolate(f, 0.0, 1.0)):
        _draw_polygon(parts, f, low, high, COLORS[j % 2])
        parts.axvline(high, color='#bbbbbb', linewidth=0.8)
        parts.annotate(
            str(variations(f, low, high)),
            (0.5 * (low + high), 0.03),
            xycoords=('data', 'axes fraction'),
            ha='center',
            color=COLORS[j % 2],
        )
    parts.set_title('split until each part has at most one sign change (numbers)')
    return figure


def _draw_curve(axes: Any, f: Factors) -> None:
    tau = np.linspace(0.0, 1.0, 801)
    unit = np.abs(values(f, tau)).max()
    axes.axhline(0.0, color=INK, linewidth=0.8)
    axes.plot(tau, values(f, tau) / unit, color=INK, linewidth=1.6, label='S(τ)')
    for root in roots(f):
        feasible = evaluate(f, float(root)).re < 0.0
        axes.plot(
            root, 0.0, 'o', color=INK, markerfacecolor=INK if feasible else 'white', zorder=5
        )
    # A cube-root scale shows small values too, and preserves signs.
    axes.set_yscale('function', functions=(np.cbrt, _cube))
    axes.set(xlabel='τ', ylabel='S, on a scale of cube roots', ylim=(-1.3, 1.3), yticks=[0.0])


def _cube(y: Array) -> Array:
    return y**3


def _draw_polygon(axes: Any, f: Factors, low: float, high: float, color: str) -> None:
    unit = np.abs(values(f, np.linspace(0.0, 1.0, 801))).max()
    points = np.array(coefficients(f, low, high)) / unit
    axes.plot(np.linspace(low, high, 7), points, '.-', color=color, linewidth=0.9, markersize=5)


def variations(f: Factors, low: float, high: float) -> int:
    """Count the sign changes among the Bernstein coefficients of an interval."""
    signs = np.sign(coefficients(f, low, high))
    signs = signs[signs != 0.0]
    return int(np.sum(signs[:-1] != signs[1:]))


def isolate(f: Factors, low: float, high: float) -> list[tuple[float, float]]:
    """Halve until no part has more than one sign change (the kernel splits nearer to a root)."""
    if variations(f, low, high) <= 1:
        return [(low, high)]
    middle = 0.5 * (low + high)
    return isolate(f, low, middle) + isolate(f, middle, high)


if __name__ == '__main__':
    raise SystemExit(main())
