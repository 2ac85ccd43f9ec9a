# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""Sends views to a node at a given rate, and measures the latency of the poses."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
import time
from typing import Any

from geometry_msgs.msg import PoseWithCovarianceStamped
import numpy as np
from p4pfr_ros.core.geometry import Array
from rclpy.executors import Executor
from rclpy.node import Node
from rclpy.qos import QoSProfile

from .node_process import MeasuredProcess
from .node_views import Views

# QoS depth, reliable on both sides: if more messages than this are waiting, some are lost.
DEPTH = 100

_TIMEOUT_S = 20.0
_IDLE_S = 1.0  # without a reply: outstanding replies are lost
_IN_FLIGHT = 8
_NS = 1_000_000_000


@dataclass(frozen=True, slots=True)
class Run:
    """
    The result of sending a series of messages.

    latencies_ms of the replies; number of messages sent; duration of sending; CPU time of the
    node.
    """

    latencies_ms: Array
    sent: int
    sending_s: float
    processor_s: float

    @classmethod
    def pooled(cls, runs: Sequence[Run]) -> Run:
        """Combine several runs into one."""
        return cls(
            np.concatenate([run.latencies_ms for run in runs]),
            sum(run.sent for run in runs),
            sum(run.sending_s for run in runs),
            sum(run.processor_s for run in runs),
        )

    @property
    def lost(self) -> int:
        """The number of messages without a reply."""
        return self.sent - len(self.latencies_ms)

    @property
    def processor_ms(self) -> float:
        """The CPU time of the node per reply."""
        return (
            1e3 * self.processor_s / len(self.latencies_ms) if len(self.latencies_ms) else np.nan
        )

    @property
    def rate_hz(self) -> float:
        """The achieved rate, messages per second; lower than nominal if the sender is late."""
        return self.sent / self.sending_s

    def quantile_ms(self, share: float) -> float:
        """Return a quantile of the latency; NaN without replies."""
        return float(np.quantile(self.latencies_ms, share)) if len(self.latencies_ms) else np.nan


class LoadGenerator:
    """
    Sends messages to one node and receives its replies, in one thread.

    A message is stamped with the steady clock when it is sent; its reply has the same stamp.

    Parameters
    ----------
    peer
        The node that sends and receives.
    executor
        The executor of peer; it is spun only here.
    process
        The process of the node under test.
    namespace
        The namespace of the node under test; its name is pose_node.
    views
        The messages to send.

    """

    def __init__(
        self,
        peer: Node,
        executor: Executor,
        process: MeasuredProcess,
        namespace: str,
        views: Views,
    ) -> None:
        self.process, self._executor = process, executor
        self._latencies_ms: list[float] = []
        self._publisher = peer.create_publisher(
            views.message_type, f'{namespace}/{views.topic}', QoSProfile(depth=DEPTH)
        )
        peer.create_subscription(
            PoseWithCovarianceStamped,
            f'{namespace}/pose_node/pose_with_covariance',
            self._on_pose,
            QoSProfile(depth=DEPTH),
        )

    def wait_until_connected(self, message: Any) -> None:
        """Send a message repeatedly until a reply arrives."""
        ends_s = time.monotonic() + _TIMEOUT_S
        self._latencies_ms = []
        while not self._latencies_ms:
            if time.monotonic() > ends_s:
                raise RuntimeError('no reply from the node')
            self._send(message)
            self._receive(0.2)
        self._drain(-1)

    def at_rate(self, messages: Sequence[Any], rate_hz: float, count: int) -> Run:
        """Send count messages at a constant rate, cycling through the given ones."""
        self._latencies_ms = []
        before_s, start_s = self.process.processor_s, time.monotonic()
        for i in range(count):
            due_s = start_s + i / rate_hz
            while (left_s := due_s - time.monotonic()) > 0.0:
                self._executor.spin_once(timeout_sec=left_s)
            self._send(messages[i % len(messages)])
        sending_s = time.monotonic() - start_s
        self._drain(count)
        return self._run(count, sending_s, before_s)

    def closed_loop(self, messages: Sequence[Any], count: int) -> Run:
        """Send count messages as fast as replies arrive, with a few in flight."""
        self._latencies_ms = []
        before_s, start_s = self.process.processor_s, time.monotonic()
        for i in range(count):
            last_reply_s = time.monotonic()
            while i - len(self._latencies_ms) >= _IN_FLIGHT:
                before = len(self._latencies_ms)
                self._executor.spin_once(timeout_sec=_IDLE_S)
                if len(self._latencies_ms) > before:
                    last_reply_s = time.monotonic()
                elif time.monotonic() - last_reply_s > _TIMEOUT_S:
                    raise RuntimeError(f'no more replies after {i} messages')
            self._send(messages[i % len(messages)])
        sending_s = time.monotonic() - start_s
        self._drain(count)
        return self._run(count, sending_s, before_s)

    def _run(self, count: int, sending_s: float, before_s: float) -> Run:
        busy_s = self.process.processor_s - before_s
        return Run(np.array(self._latencies_ms), count, sending_s, busy_s)

    def _send(self, message: Any) -> None:
        stamp = message.header.stamp
        stamp.sec, stamp.nanosec = divmod(time.monotonic_ns(), _NS)
        self._publisher.publish(message)

    def _on_pose(self, msg: PoseWithCovarianceStamped) -> None:
        stamp = msg.header.stamp
        sent_ns = _NS * stamp.sec + stamp.nanosec
        self._latencies_ms.append(1e-6 * (time.monotonic_ns() - sent_ns))

    def _receive(self, duration_s: float) -> None:
        ends_s = time.monotonic() + duration_s
        while (left_s := ends_s - time.monotonic()) > 0.0:
            self._executor.spin_once(timeout_sec=left_s)

    def _drain(self, count: int) -> None:
        """Receive until count replies have arrived, or no more arrive."""
        before = -1
        while len(self._latencies_ms) != count and len(self._latencies_ms) > before:
            before = len(self._latencies_ms)
            self._receive(_IDLE_S)
