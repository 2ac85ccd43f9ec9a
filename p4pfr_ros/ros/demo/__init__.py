# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""
The demo: a simulated camera, the detector and the pose node, over DDS.

The three nodes are processes, as on a robot. This process subscribes to their topics, compares
the estimates with the truth, stops the nodes, writes demo.png, and fails if an error exceeds its
limit.
"""

from __future__ import annotations

import os
from pathlib import Path
import signal
import socket
from tempfile import TemporaryDirectory
import time

import cv2
import numpy as np
from p4pfr_ros import DivisionCamera
from p4pfr_ros.boards import Board
from p4pfr_ros.detection import Detection
from p4pfr_ros.files.boards import load_board
from p4pfr_ros.files.images import write_image
from p4pfr_ros.files.writing import check_writable
from p4pfr_ros.files.yaml_fields import ConfigError
from p4pfr_ros.kernels.processes import are_compiled, compile_with_progress
from p4pfr_ros.rendering import render
from p4pfr_ros.report.drawing import annotate, straighten
from p4pfr_ros.scenes.board_path import SimulatedPath
import rclpy
from rclpy.signals import SignalHandlerOptions
from rich.console import Console

from .children import Children
from .monitor import Monitor
from .table import Screen
from .views import DemoView, Errors, median_errors, Record
from ..runtime.spin import init_ros

IMAGE_SIZE = (640, 480)
# About 110 degrees along the diagonal, so that the distortion is clearly visible.
CAMERA = DivisionCamera(400.0, (0.5 * (IMAGE_SIZE[0] - 1), 0.5 * (IMAGE_SIZE[1] - 1)), -0.3)
BOARD = """\
boards:
  board: {type: chessboard, columns: 9, rows: 6, square_mm: 25}
"""
RATE_HZ = 15.0
DURATION_S = 20.0
# Time for processes to start, load their kernels and discover each other on a slow machine.
FIRST_VIEW_WITHIN_S = 40.0
MIN_VIEWS = 50
IMAGE_FILE = 'demo.png'
_DISCARD_PORT = 9

# For the median over all views, each estimated from a single image: ten times the measured
# errors; the latency allows for a busy machine.
LIMITS = Errors(position=0.002, rotation_deg=0.03, focal=0.002, k=0.002, rms_px=0.1, latency_s=0.5)


def main(
    duration_s: float = DURATION_S, limits: Errors = LIMITS, min_views: int = MIN_VIEWS
) -> int:
    """
    Run the demo for a time after the first view; return the exit status of the process.

    It fails if the median of an error exceeds its limit, or if there are too few views.
    """
    signal.signal(signal.SIGTERM, signal.default_int_handler)
    console = Console()
    record = Record(CAMERA)
    try:
        problems = _run(console, record, duration_s) or _check(
            console, record.errors, limits, min_views
        )
    except ConfigError as error:
        problems = [str(error)]
    except KeyboardInterrupt:
        console.print('interrupted')
        return 130
    for problem in problems:
        console.print(f'demo failed: {problem}', style='bold red', markup=False, soft_wrap=True)
    return 1 if problems else 0


def _run(console: Console, record: Record, duration_s: float) -> list[str]:
    """Run the nodes for a time and write the image; return the problems."""
    check_writable(Path(IMAGE_FILE))
    existed = Path(IMAGE_FILE).exists()
    check_loopback()
    # A domain of its own, so that no other nodes interfere.
    os.environ['ROS_AUTOMATIC_DISCOVERY_RANGE'] = 'LOCALHOST'
    os.environ['ROS_DOMAIN_ID'] = str(1 + os.getpid() % 100)
    with TemporaryDirectory(prefix='p4pfr_demo_') as folder:
        board_file = Path(folder, 'board.yaml')
        board_file.write_text(BOARD)
        board = load_board(board_file)
        _compile(console, board)
        with Children(Path(folder)) as children:
            _start(console, children, board_file)
            problem = _monitor(console, children, record, duration_s)
    if problem is not None:
        return [problem]
    if record.largest is not None:
        write_demo_image(Path(IMAGE_FILE), record.largest, board)
        replaced = ' (replaces the previous one)' if existed else ''
        console.print(
            f'wrote {IMAGE_FILE}{replaced}: an image with the estimate, and undistorted',
            soft_wrap=True,
        )
    return []


def check_loopback() -> None:
    """
    Check that the loopback interface is up, as nodes on one machine find each other through it.

    Raises
    ------
    ConfigError
        It is down, as in a network namespace or container that nobody has configured.

    """
    try:
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
            probe.sendto(b'', ('127.0.0.1', _DISCARD_PORT))
    except OSError as error:
        raise ConfigError(
            f'no connection to 127.0.0.1 ({error.strerror}), which DDS needs: ip link set lo up'
        ) from None


def _compile(console: Console, board: Board) -> None:
    """Compile all kernels once; otherwise each of the three processes would compile them."""
    console.print('preparing')
    if not are_compiled():
        compile_with_progress()
    render(board, CAMERA, SimulatedPath(board, IMAGE_SIZE, 0).at(0.0, CAMERA), IMAGE_SIZE)


def _start(console: Console, children: Children, board_file: Path) -> None:
    camera = {
        'camera.focal_px': CAMERA.focal_px,
        'camera.k': CAMERA.k,
        'camera.width_px': IMAGE_SIZE[0],
        'camera.height_px': IMAGE_SIZE[1],
    }
    # per_frame: the table shows what a single view determines.
    children.start('pose_node', {'intrinsics.mode': 'per_frame'})
    children.start('detector_node', {'board_file': board_file})
    children.start('camera_simulator', {'board_file': board_file, 'rate_hz': RATE_HZ} | camera)
    console.print('started camera_simulator, detector_node and pose_node')


def _monitor(
    console: Console, children: Children, record: Record, duration_s: float
) -> str | None:
    """Receive views for a time; return why that failed, or None."""
    init_ros(signal_handler_options=SignalHandlerOptions.NO)
    try:
        monitor = Monitor(record)
        with Screen(console, CAMERA) as screen:
            return _spin(monitor, screen, children, record, duration_s)
    finally:
        rclpy.try_shutdown()


def _spin(
    monitor: Monitor, screen: Screen, children: Children, record: Record, duration_s: float
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
            f'no view within {FIRST_VIEW_WITHIN_S:g} s ({monitor.image_count} images received)\n'
            + children.output()
        )
    return None


def _check(console: Console, errors: list[Errors], limits: Errors, min_views: int) -> list[str]:
    """Compare the median errors with their limits; return a line for each that exceeds it."""
    median = median_errors(errors)
    problems = []
    if len(errors) < min_views:
        problems.append(f'{len(errors)} views, expected at least {min_views}')
    for name in Errors.__slots__:
        value, limit = getattr(median, name), getattr(limits, name)
        if not value <= limit:
            problems.append(f'median error of {name} is {value:.4g}, expected at most {limit:g}')
    console.print(
        f'median errors of {len(errors)} views: position {median.position:.3%}, '
        f'rotation {median.rotation_deg:.3f}°, f {median.focal:.3%}, k {median.k:.4f}; '
        f'rms {median.rms_px:.3f} px, image to pose {1e3 * median.latency_s:.1f} ms',
        highlight=False,
        soft_wrap=True,
    )
    return problems


def write_demo_image(path: Path, view: DemoView, board: Board) -> None:
    """
    Draw corners, reprojected board and axes on the image; the undistorted image beside it.

    Raises
    ------
    ConfigError
        The file cannot be written.

    """
    points = view.points
    detection = Detection(points.image_points, points.board_points, points.ids)
    annotated = annotate(view.image, detection, view.estimate, board)
    undistorted = straighten(view.image, view.estimate.camera)
    write_image(path, np.hstack([annotated, cv2.cvtColor(undistorted, cv2.COLOR_GRAY2BGR)]))
