# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""
Where the nanoseconds of the minimal solver go: a bar chart of its stages, in a batch.

    python -m benchmarks.minimal_stages [--output FILE]

Each stage is the difference of two runs, with and without it, alternated; medians of CPU time.
"""

from __future__ import annotations

import argparse
import math
from pathlib import Path
import time

import matplotlib as mpl
from matplotlib.figure import Figure
import numpy as np
from p4pfr_ros import solve_p4pfr_batch
from p4pfr_ros.core.geometry import Array, Ints
from p4pfr_ros.core.jit import jit
from p4pfr_ros.core.minimal import lanes
from p4pfr_ros.core.minimal.block import BLOCK, block_work, LANES, put_sample
from p4pfr_ros.core.minimal.four import points_of
from p4pfr_ros.core.minimal.one import UNFOLDED
from p4pfr_ros.core.minimal.solution import MAX_SOLUTIONS, ROW_SIZE
from p4pfr_ros.report.figure_style import STYLE

from .accuracy import CLASSES

_DOCS = Path(__file__).parents[1] / 'docs'
_CLASSES = ('patch', 'square', 'patch, tilt < 3°', 'square, tilt < 3°')
_SEED = 12345
_PROBLEMS = 16 * BLOCK
_ROUNDS = 200
STAGES = (
    'read the points',
    'scale, weights, cone',
    'duals, factors',
    'isolate the roots',
    "Newton's method",
    'pose, residual, write',
    'Python, output arrays',
)


@jit
def _run(image: Array, board: Array, stages: int, rows: Array, count: Ints) -> None:
    """Run the first stages of ``lanes.solve_block`` on whole blocks."""
    block = block_work()
    for start in range(0, len(image), BLOCK):
        for at in range(BLOCK):
            i = start + at
            put_sample(points_of(image[i]), points_of(board[i]), at, block)
            count[at] = 0
        if stages < 2:
            continue
        for g in range(BLOCK // LANES):
            lanes._open_cones(block.groups[g])
        alive = lanes._keep_open(BLOCK, block)
        groups = (alive + LANES - 1) // LANES
        if stages < 3:
            continue
        for g in range(groups):
            lanes._form_sextics(UNFOLDED, block.groups[g])
        if stages < 4:
            continue
        lanes._isolate_roots(alive, block)
        if stages < 5:
            continue
        for g in range(groups):
            lanes._refine_roots(block.groups[g], block.roots[g])
        if stages < 6:
            continue
        for g in range(groups):
            n, source = alive - g * LANES, block.source[g * LANES :]
            lanes._solve_group(block.groups[g], n, source, rows, count, block.one)


def measure(name: str) -> Array:
    """Return the nanoseconds per problem of each of STAGES."""
    rows = np.full((BLOCK, MAX_SOLUTIONS, ROW_SIZE), math.nan)
    count = np.zeros(BLOCK, dtype=np.int64)
    drawn = CLASSES[name].draw(50_000, _SEED)
    times_ns = np.empty((_ROUNDS, len(STAGES)))
    for i in range(-2, _ROUNDS):  # the first two compile and warm up
        # Other problems in each round, to defeat branch prediction.
        at = (np.arange(_PROBLEMS) + i * _PROBLEMS) % len(drawn)
        image, board = drawn.image_points[at], drawn.board_points[at]
        for stage in range(len(STAGES)):
            start = time.process_time_ns()
            if stage == len(STAGES) - 1:
                solve_p4pfr_batch(image, board)
            else:
                _run(image, board, stage + 1, rows, count)
            times_ns[max(i, 0), stage] = (time.process_time_ns() - start) / _PROBLEMS
    cumulative = np.median(times_ns, axis=0)
    return np.diff(cumulative, prepend=0.0)


def draw(stages_ns: dict[str, Array]) -> Figure:
    """Draw the stages of each class as a stacked bar."""
    figure = Figure(figsize=(9.5, 3.4), layout='constrained')
    axes = figure.subplots()
    names = list(stages_ns)
    left = np.zeros(len(names))
    colors = mpl.colormaps['viridis'](np.linspace(0.05, 0.95, len(STAGES)))
    for i, stage in enumerate(STAGES):
        width = np.array([stages_ns[name][i] for name in names])
        bars = axes.barh(names, width, left=left, color=colors[i], label=stage, height=0.62)
        labels = [f'{w:.0f}' if w >= 25.0 else '' for w in width]
        color = 'white' if i < len(STAGES) // 2 + 1 else 'black'
        axes.bar_label(bars, labels, label_type='center', color=color, fontsize=8)
        left += width
    for y, total in enumerate(left):
        axes.annotate(
            f'{total:.0f} ns', (total, y), (4, 0), textcoords='offset points', va='center'
        )
    axes.set_xlabel('ns per problem')
    axes.set_xlim(0.0, 1.13 * left.max())
    axes.invert_yaxis()
    figure.legend(ncols=4, loc='outside lower center', frameon=False, fontsize=9)
    return figure


def main(arguments: list[str] | None = None) -> int:
    """Measure the stages and draw the chart."""
    parser = argparse.ArgumentParser(
        prog='python -m benchmarks.minimal_stages', description=__doc__.split('\n\n')[0]
    )
    parser.add_argument(
        '--output', type=Path, default=_DOCS / 'minimal_stages.png', metavar='FILE'
    )
    output = parser.parse_args(arguments).output
    stages_ns = {name: measure(name) for name in _CLASSES}
    for name, stages in stages_ns.items():
        print(
            name, *(f'{s}: {ns:.0f} ns' for s, ns in zip(STAGES, stages, strict=True)), sep='\n  '
        )
    with mpl.rc_context(STYLE):
        draw(stages_ns).savefig(output, dpi=110)
    return 0


if __name__ == '__main__':
    raise SystemExit(main())
