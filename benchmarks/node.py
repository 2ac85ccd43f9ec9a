# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""
pose_node under load, over DDS: latency, highest message rate, memory.

    python -m benchmarks.node [--points N ...] [--rates HZ ...] [--markdown FILE] [--help]
    python -m benchmarks.node --chain

Three processes: pose_node, an echo node for comparison, and this one, which sends and receives.
With --chain, the latency from image to pose instead: camera driver, detector_node, pose_node.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator
from contextlib import contextmanager, ExitStack
import os
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import p4pfr_ros.ros  # noqa: F401  (sets the path of the ament index)
import rclpy
from rclpy.executors import SingleThreadedExecutor
from rich.console import Console

from .node_chain import CHAIN_NOTE, chain_table
from .node_load import DEPTH, LoadGenerator, Run
from .node_process import MeasuredProcess
from .node_report import LATENCY_HEADER, NOTE, RATE_HEADER
from .node_views import IMAGE_SIZE, MARKER_M, POINTS, Views, views_of
from .tables import Measured, page_of, Row, table_of

RATES_HZ = (30, 200, 1000)
LADDER_HZ = (500, 750, 1000, 1250, 1500, 2000, 2500, 3000, 4000)
LADDER_POINTS = 24
_MIN_RATE = 0.97  # share of the nominal rate; below it, the sender is the bottleneck

ECHO = 'echo'
SELF_CALIBRATE, PER_FRAME = 'self_calibrate', 'per_frame'
_WARM_UP, _WARM_UP_HZ = 2000, 250.0
_MIN_MESSAGES = 150  # per case and rate
_ROUNDS = 5  # each round runs all cases of a rate, so that disturbances affect all of them

_WIDTH = 170
_TITLE = 'pose_node under load, measured'
_COMMAND = 'python -m benchmarks.node'


def main(arguments: list[str] | None = None) -> int:
    """Run the benchmark and print the tables."""
    options = _options(arguments)
    os.environ['ROS_AUTOMATIC_DISCOVERY_RANGE'] = 'LOCALHOST'
    console = Console()
    console.width = max(console.width, _WIDTH)
    rclpy.init()
    try:
        if options.chain:
            tables: list[Measured] = [chain_table(console, options.seconds)]
            notes = [CHAIN_NOTE]
        else:
            tables, notes = _measured(console, options)
    finally:
        rclpy.try_shutdown()
    for title, header, rows in tables:
        console.print(table_of(title, header, rows))
    console.print(*notes, sep='\n', soft_wrap=True)
    if options.markdown:
        command = f'{_COMMAND} --chain' if options.chain else _COMMAND
        options.markdown.write_text(page_of(_TITLE, command, tables, notes), encoding='utf-8')
    return 0


def _options(arguments: list[str] | None) -> argparse.Namespace:
    parser = argparse.ArgumentParser(
        prog='python -m benchmarks.node', description=__doc__.split('\n\n')[0]
    )
    parser.add_argument(
        '--seconds', type=float, default=5.0, help='seconds per cell; default: %(default)s'
    )
    parser.add_argument(
        '--messages',
        type=int,
        default=100_000,
        help='messages in the memory test; default: %(default)s',
    )
    parser.add_argument(
        '--points', type=int, nargs='+', choices=POINTS, default=POINTS, help='board sizes'
    )
    parser.add_argument(
        '--rates', type=int, nargs='+', metavar='HZ', default=RATES_HZ, help='message rates'
    )
    parser.add_argument('--latency-only', action='store_true', help='skip highest rate and memory')
    parser.add_argument(
        '--chain', action='store_true', help='measure the chain from image to pose instead'
    )
    parser.add_argument(
        '--markdown', type=Path, metavar='FILE', help='also write the tables to FILE'
    )
    return parser.parse_args(arguments)


def _measured(console: Console, options: argparse.Namespace) -> tuple[list[Measured], list[str]]:
    """Run all measurements; return the tables and the notes below them."""
    latencies: list[Row] = []
    tables: list[Measured] = [('Latency', LATENCY_HEADER, latencies)]
    notes = [NOTE]
    for points in options.points:
        with _loads(views_of(points)) as (views, loads):
            latencies += _latencies(console, views, loads, options)
            if points == LADDER_POINTS and not options.latency_only:
                rates = _highest_rates(console, views, loads, options.seconds)
                tables.append((f'Highest rate, {LADDER_POINTS} points', RATE_HEADER, rates))
                notes.insert(0, _memory(views, loads[SELF_CALIBRATE], options.messages))
    return tables, notes


@contextmanager
def _loads(views: Views) -> Iterator[tuple[Views, dict[str, LoadGenerator]]]:
    """Start and warm up the echo node and a pose_node per mode; idle nodes cost nothing."""
    with ExitStack() as stack:
        folder = Path(stack.enter_context(TemporaryDirectory(prefix='p4pfr_bench_')))
        peer = rclpy.create_node('bench')
        stack.callback(peer.destroy_node)
        executor = SingleThreadedExecutor()
        executor.add_node(peer)
        loads = {}
        for name in (ECHO, SELF_CALIBRATE, PER_FRAME):
            namespace = f'/bench_{os.getpid()}/{name}'
            process = stack.enter_context(_start(name, namespace, folder / name))
            loads[name] = LoadGenerator(peer, executor, process, namespace, views)
        for load in loads.values():
            load.process.wait_until_ready()
            load.wait_until_connected(views.jumping[0])
            load.at_rate(views.jumping, _WARM_UP_HZ, _WARM_UP)
        yield views, loads


def _start(name: str, namespace: str, log: Path) -> MeasuredProcess:
    parameters: dict[str, Any] = {
        f'qos_overrides.{namespace}/{topic}.depth': DEPTH
        for topic in (
            'corners.subscription',
            'correspondences.subscription',
            'pose_node/pose_with_covariance.publisher',
        )
    }
    for topic in ('corners', 'correspondences'):
        parameters[f'qos_overrides.{namespace}/{topic}.subscription.reliability'] = 'reliable'
    if name == ECHO:
        return MeasuredProcess('benchmarks.node_echo', namespace, parameters, log)
    parameters |= {
        'intrinsics.mode': name,
        'image.width_px': IMAGE_SIZE[0],
        'image.height_px': IMAGE_SIZE[1],
        'marker.size_m': MARKER_M,
    }
    return MeasuredProcess('p4pfr_ros.ros.pose_node', namespace, parameters, log)


def _latencies(
    console: Console, views: Views, loads: dict[str, LoadGenerator], options: argparse.Namespace
) -> Iterator[Row]:
    """Measure each mode and the echo node at each rate, alternating between them."""
    cases = [
        (ECHO, 'moving', views.moving),
        (SELF_CALIBRATE, 'jumping', views.jumping),
        (SELF_CALIBRATE, 'moving', views.moving),
        (SELF_CALIBRATE, 'static', views.static),
        (PER_FRAME, 'moving', views.moving),
    ]
    for rate_hz in options.rates:
        count = max(_MIN_MESSAGES, round(rate_hz * options.seconds)) // _ROUNDS
        rounds = [
            [loads[mode].at_rate(messages, rate_hz, count) for mode, _, messages in cases]
            for _ in range(_ROUNDS)
        ]
        echo, *runs = (Run.pooled(of_case) for of_case in zip(*rounds, strict=True))
        for (mode, board, _), run in zip(cases[1:], runs, strict=True):
            row = (str(views.points), str(rate_hz), mode, board, *_compared(run, echo))
            console.print(*row)
            yield row


def _compared(run: Run, echo: Run) -> Row:
    node_ms, echo_ms = ([r.quantile_ms(share) for share in (0.5, 0.99)] for r in (run, echo))
    added_ms = [a - b for a, b in zip(node_ms, echo_ms, strict=True)]
    numbers = [f'{value:.2f}' for value in (*node_ms, *echo_ms, *added_ms)]
    return (*numbers, str(run.lost), f'{run.processor_ms:.2f}', f'{echo.processor_ms:.2f}')


def _highest_rates(
    console: Console, views: Views, loads: dict[str, LoadGenerator], seconds: float
) -> list[Row]:
    rows = []
    for name, load in loads.items():
        best: Run | None = None
        for rate_hz in LADDER_HZ:
            run = load.at_rate(views.moving, rate_hz, round(rate_hz * seconds))
            console.print(name, rate_hz, f'{run.rate_hz:.0f}', run.lost)
            if run.lost or run.rate_hz < _MIN_RATE * rate_hz:
                break
            best = run
        rows.append((name, *_at_best(best)))
    return rows


def _at_best(run: Run | None) -> Row:
    if run is None:
        return (f'below {LADDER_HZ[0]}', '', '', '')
    p50, p99 = (f'{run.quantile_ms(share):.2f}' for share in (0.5, 0.99))
    return (f'{run.rate_hz:.0f}', p50, p99, f'{100.0 * run.processor_s / run.sending_s:.0f}')


def _memory(views: Views, load: LoadGenerator, count: int) -> str:
    """Report the memory of the node before and after the given number of messages."""
    before = load.process.memory_mib
    run = load.closed_loop(views.jumping, count)
    after = load.process.memory_mib
    return (
        f'Memory of pose_node in mode {SELF_CALIBRATE}, {views.points} points: {before:.1f} MiB '
        f'after warm-up, {after:.1f} MiB after {count:,} further messages, sent as fast as poses '
        f'came back: {run.rate_hz:.0f} per second, {run.lost} lost.'
    )


if __name__ == '__main__':
    raise SystemExit(main())
