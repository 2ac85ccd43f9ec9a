# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""
The whole package at work: a simulated camera, the detector and the pose node over DDS.

Three processes talk to each other as on a robot; this one listens, compares with the truth, ends
them, draws demo.png, and fails when an error is out of bounds.
"""

from __future__ import annotations

import os
from pathlib import Path
import signal
from tempfile import TemporaryDirectory
import time

from p4pfr_ros import DivisionCamera
from p4pfr_ros.boards import Board
from p4pfr_ros.files.boards import load_board
from p4pfr_ros.files.writing import check_writable
from p4pfr_ros.files.yaml_fields import ConfigError
from p4pfr_ros.rendering import render
from p4pfr_ros.scenes.board_path import SimulatedPath
import rclpy
from rclpy.signals import SignalHandlerOptions
from rich.console import Console

from .children import Children
from .monitor import Monitor
from .picture import write_picture
from .table import Screen
from .views import Errors, median_errors, View
from ..runtime.warm_up import warm_up

IMAGE_SIZE = (640, 480)
# About 110 degrees along the diagonal: its bent lines are plain to see.
CAMERA = DivisionCamera(400.0, (0.5 * (IMAGE_SIZE[0] - 1), 0.5 * (IMAGE_SIZE[1] - 1)), -0.3)
BOARD = """\
boards:
  board: {type: chessboard, columns: 9, rows: 6, square_mm: 25}
"""
RATE_HZ = 15.0
DURATION_S = 20.0
# Processes start, load their kernels and find each other within this on a slow machine too.
FIRST_VIEW_WITHIN_S = 40.0
FEWEST_VIEWS = 50
PICTURE = 'demo.png'

# For the median over all views, each estimated from its one picture: ten times what was measured,
# and for the latency what a busy machine may need.
BOUNDS = Errors(position=0.002, rotation_deg=0.03, focal=0.002, k=0.002, rms_px=0.1, latency_s=0.5)


def main(
    duration_s: float = DURATION_S, bounds: Errors = BOUNDS, fewest_views: int = FEWEST_VIEWS
) -> int:
    """
    Run the demo for so long after the first view; return the process's exit status.

    It fails where the median of an error is beyond its bound, or fewer views than that came.
    """
    signal.signal(signal.SIGTERM, signal.default_int_handler)
    console = Console()
    record = _Record()
    try:
        problems = _run(console, record, duration_s) or _judge(
            console, record.errors, bounds, fewest_views
        )
    except ConfigError as error:
        problems = [str(error)]
    except KeyboardInterrupt:
        console.print('interrupted')
        return 130
    for problem in problems:
        console.print(f'demo failed: {problem}', style='bold red', markup=False)
    return 1 if problems else 0


class _Record:
    """The errors of all views, and the view that shows the board largest."""

    def __init__(self) -> None:
        self.errors: list[Errors] = []
        self.last: View | None = None
        self.largest: View | None = None

    def add(self, view: View) -> None:
        self.errors.append(Errors.of(view, CAMERA))
        self.last = view
        if self.largest is None or view.extent_px > self.largest.extent_px:
            self.largest = view


def _run(console: Console, record: _Record, duration_s: float) -> list[str]:
    """Watch the nodes for a while and draw what they saw; return why that failed, if it did."""
    check_writable(Path(PICTURE))
    # Nobody else's nodes are to hear this, nor this to hear theirs.
    os.environ['ROS_AUTOMATIC_DISCOVERY_RANGE'] = 'LOCALHOST'
    os.environ['ROS_DOMAIN_ID'] = str(1 + os.getpid() % 100)
    with TemporaryDirectory(prefix='p4pfr_demo_') as folder:
        board_file = Path(folder, 'board.yaml')
        board_file.write_text(BOARD)
        board = load_board(board_file)
        _compile(console, board)
        with Children(Path(folder)) as children:
            _start(console, children, board_file)
            died = _watch(console, children, record, duration_s)
    if died is not None:
        return [died]
    if record.largest is not None:
        write_picture(Path(PICTURE), record.largest, board)
        console.print(f'{PICTURE}: a picture as seen, and straightened')
    return []


def _compile(console: Console, board: Board) -> None:
    """Compile all kernels once, here: three processes would do it three times."""
    console.print('preparing; the first time, compilation takes some tens of seconds')
    warm_up()
    render(board, CAMERA, SimulatedPath(board, IMAGE_SIZE, 0).at(0.0, CAMERA), IMAGE_SIZE)


def _start(console: Console, children: Children, board_file: Path) -> None:
    camera = {
        'camera.focal_px': CAMERA.focal_px,
        'camera.k': CAMERA.k,
        'camera.width_px': IMAGE_SIZE[0],
        'camera.height_px': IMAGE_SIZE[1],
    }
    # Each view by itself: the table shows what a single one tells.
    children.start('pose_node', {'intrinsics.mode': 'per_frame'})
    children.start('detector_node', {'board_file': board_file})
    children.start('camera_simulator', {'board_file': board_file, 'rate_hz': RATE_HZ} | camera)
    console.print('started camera_simulator, detector_node and pose_node')


def _watch(console: Console, children: Children, record: _Record, duration_s: float) -> str | None:
    """Listen until there is enough; return what is to be said if it cannot be."""
    rclpy.init(signal_handler_options=SignalHandlerOptions.NO)
    try:
        monitor = Monitor(record.add)
        with Screen(console, CAMERA) as screen:
            return _listen(monitor, screen, children, record, duration_s)
    finally:
        rclpy.try_shutdown()


def _listen(
    monitor: Monitor, screen: Screen, children: Children, record: _Record, duration_s: float
) -> str | None:
    ends_s = time.monotonic() + FIRST_VIEW_WITHIN_S
    shown = 0
    while time.monotonic() < ends_s:
        rclpy.spin_once(monitor, timeout_sec=0.1)
        if (dead := children.dead()) is not None:
            return dead
        if record.last is None or len(record.errors) == shown:
            continue
        if shown == 0:
            ends_s = time.monotonic() + duration_s
        shown = len(record.errors)
        screen.show(record.last, record.errors)
    if record.last is None:
        return (
            f'no view within {FIRST_VIEW_WITHIN_S:g} s ({monitor.pictures} pictures came)\n'
            + children.words()
        )
    return None


def _judge(console: Console, errors: list[Errors], bounds: Errors, fewest_views: int) -> list[str]:
    """Hold the median errors against their bounds; return a line for each that is beyond."""
    median = median_errors(errors)
    problems = []
    if len(errors) < fewest_views:
        problems.append(f'{len(errors)} views came, expected at least {fewest_views}')
    for name in Errors.__slots__:
        value, bound = getattr(median, name), getattr(bounds, name)
        if not value <= bound:
            problems.append(f'median error of {name} is {value:.4g}, expected at most {bound:g}')
    console.print(
        f'median errors of {len(errors)} views: position {median.position:.3%}, '
        f'rotation {median.rotation_deg:.3f}°, f {median.focal:.3%}, k {median.k:.4f}; '
        f'rms {median.rms_px:.3f} px, picture to pose {1e3 * median.latency_s:.1f} ms',
        highlight=False,
        soft_wrap=True,
    )
    return problems
