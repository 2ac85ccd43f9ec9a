# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""
The chain from image to pose, over DDS: camera driver, detector_node, pose_node, a process each.

This module stands apart from ``node``, which measures pose_node alone: it has other processes.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import ExitStack
import os
from pathlib import Path
from tempfile import TemporaryDirectory
import time

from geometry_msgs.msg import PoseWithCovarianceStamped
import numpy as np
from p4pfr_ros.core.geometry import Array
import rclpy
from rclpy.executors import SingleThreadedExecutor
from rclpy.qos import QoSProfile
from rich.console import Console

from .node_process import MeasuredProcess
from .tables import Measured, Row

RATE_HZ = 30.0
CHAIN_NOTE = (
    'Latency from publishing an image (mono8, reliable, depth 10) to receiving '
    'pose_with_covariance, in four processes: camera driver with images rendered beforehand, '
    'detector_node, pose_node (self_calibrate), receiver. CPU ms: CPU time of a node per pose. '
    f'Cameras per core: at {RATE_HZ:.0f} images per second, for both nodes together.'
)
_HEADER = (
    'board',
    'image',
    'images/s',
    'p50 ms',
    'p99 ms',
    'lost',
    'detector CPU ms',
    'pose CPU ms',
    'cameras per core',
)
_BOARDS = {
    'chessboard 9x6': '{type: chessboard, columns: 9, rows: 6, square_mm: 25}',
    'tag': '{type: marker, id: 0, size_mm: 150, dictionary: DICT_APRILTAG_36h11}',
}
_SIZES = ((640, 480), (1280, 960))
_WARM_UP_S, _TIMEOUT_S = 10.0, 120.0
_NS = 1_000_000_000


def chain_table(console: Console, seconds: float) -> Measured:
    """Measure the chain with each board and image size."""
    rows = []
    for name, board in _BOARDS.items():
        for size in _SIZES:
            row = (name, f'{size[0]}x{size[1]}', *_measured(board, size, seconds))
            console.print(*row)
            rows.append(row)
    return 'Chain from image to pose', _HEADER, rows


def _measured(board: str, size: tuple[int, int], seconds: float) -> Row:
    with ExitStack() as stack:
        folder = Path(stack.enter_context(TemporaryDirectory(prefix='p4pfr_chain_')))
        board_file = folder / 'board.yaml'
        board_file.write_text(f'boards:\n  board: {board}\n')
        namespace = f'/chain_{os.getpid()}_{time.monotonic_ns()}'
        receiver = _Receiver(namespace)
        stack.callback(receiver.close)
        nodes = [
            stack.enter_context(process)
            for process in _processes(namespace, board_file, size, folder)
        ]
        for node in nodes:
            node.wait_until_ready()
        receiver.wait_for_poses()
        receiver.receive(_WARM_UP_S)
        before_s = [node.processor_s for node in nodes]
        receiver.receive(seconds)
        poses = len(receiver.latencies_ms)
        detector_ms, pose_ms = (
            1e3 * (node.processor_s - start_s) / poses
            for node, start_s in zip(nodes[:2], before_s, strict=False)
        )
    return (
        f'{RATE_HZ:.0f}',
        *(f'{np.quantile(receiver.latencies_ms, share):.1f}' for share in (0.5, 0.99)),
        str(receiver.lost),
        f'{detector_ms:.1f}',
        f'{pose_ms:.1f}',
        f'{1e3 / RATE_HZ / (detector_ms + pose_ms):.1f}',
    )


def _processes(
    namespace: str, board_file: Path, size: tuple[int, int], folder: Path
) -> Iterator[MeasuredProcess]:
    """Yield detector_node, pose_node and the camera."""
    width, height = size
    for module, settings in (
        ('p4pfr_ros.ros.detector_node', {'board_file': board_file}),
        ('p4pfr_ros.ros.pose_node', {'image.width_px': width, 'image.height_px': height}),
        (
            'benchmarks.node_camera',
            {'board_file': board_file, 'width_px': width, 'height_px': height, 'rate_hz': RATE_HZ},
        ),
    ):
        yield MeasuredProcess(module, namespace, settings, folder / module.rpartition('.')[2])


class _Receiver:
    """Receives poses; ``latencies_ms`` are those of the last ``receive``."""

    def __init__(self, namespace: str) -> None:
        self._node = rclpy.create_node('receiver', namespace=namespace)
        self._executor = SingleThreadedExecutor()
        self._executor.add_node(self._node)
        self._stamps_ns: list[int] = []
        self._latencies_ms: list[float] = []
        self._node.create_subscription(
            PoseWithCovarianceStamped,
            'pose_node/pose_with_covariance',
            self._on_pose,
            QoSProfile(depth=100),
        )

    @property
    def latencies_ms(self) -> Array:
        return np.array(self._latencies_ms)

    @property
    def lost(self) -> int:
        """The number of images without a pose between the first and the last one."""
        span_s = 1e-9 * (self._stamps_ns[-1] - self._stamps_ns[0])
        return round(span_s * RATE_HZ) + 1 - len(self._stamps_ns)

    def wait_for_poses(self) -> None:
        ends_s = time.monotonic() + _TIMEOUT_S
        while not self._stamps_ns:
            if time.monotonic() > ends_s:
                raise RuntimeError('no pose arrives')
            self._executor.spin_once(timeout_sec=0.1)

    def receive(self, duration_s: float) -> None:
        self._stamps_ns, self._latencies_ms = [], []
        ends_s = time.monotonic() + duration_s
        while (left_s := ends_s - time.monotonic()) > 0.0:
            self._executor.spin_once(timeout_sec=left_s)

    def close(self) -> None:
        self._executor.shutdown()
        self._node.destroy_node()

    def _on_pose(self, msg: PoseWithCovarianceStamped) -> None:
        now_ns = time.monotonic_ns()
        stamp_ns = _NS * msg.header.stamp.sec + msg.header.stamp.nanosec
        self._stamps_ns.append(stamp_ns)
        self._latencies_ms.append(1e-6 * (now_ns - stamp_ns))
