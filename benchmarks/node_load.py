# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""Sends views to a node at a rate, and measures when the poses come back."""

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

# Reliable, on both sides: what waits for longer than this many messages take is lost.
DEPTH = 100

_PATIENCE_S = 20.0
_SILENCE_S = 1.0  # after which what has not come does not come
_IN_FLIGHT = 8
_NS = 1_000_000_000


@dataclass(frozen=True, slots=True)
class Run:
    """
    What came of some messages.

    latencies_ms of those that were answered; how many were sent, in what time, and how long the
    node kept a processor busy with them.
    """

    latencies_ms: Array
    sent: int
    sending_s: float
    processor_s: float

    @classmethod
    def pooled(cls, runs: Sequence[Run]) -> Run:
        """Make one of several."""
        return cls(
            np.concatenate([run.latencies_ms for run in runs]),
            sum(run.sent for run in runs),
            sum(run.sending_s for run in runs),
            sum(run.processor_s for run in runs),
        )

    @property
    def lost(self) -> int:
        """How many were not answered."""
        return self.sent - len(self.latencies_ms)

    @property
    def processor_ms(self) -> float:
        """The processor's time for an answer."""
        return (
            1e3 * self.processor_s / len(self.latencies_ms) if len(self.latencies_ms) else np.nan
        )

    @property
    def rate_hz(self) -> float:
        """How many were sent per second: a sender may be late."""
        return self.sent / self.sending_s

    def quantile_ms(self, share: float) -> float:
        """Return the latency that a share of the answers was within; NaN: there is none."""
        return float(np.quantile(self.latencies_ms, share)) if len(self.latencies_ms) else np.nan


class Load:
    """
    Talks to one node: sends and listens in one thread.

    A message's stamp is the steady clock's when it is sent, and an answer has its question's.

    Parameters
    ----------
    peer
        The node that talks.
    executor
        Its executor, which is spun here only.
    process
        The one that is talked to.
    namespace
        Its namespace; its name is pose_node.
    views
        What it is sent.

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

    def wait_until_heard(self, message: Any) -> None:
        """Send a message until it is answered."""
        ends_s = time.monotonic() + _PATIENCE_S
        self._latencies_ms = []
        while not self._latencies_ms:
            if time.monotonic() > ends_s:
                raise RuntimeError('the node does not answer')
            self._send(message)
            self._listen(0.2)
        self._drain(-1)

    def at_rate(self, messages: Sequence[Any], rate_hz: float, count: int) -> Run:
        """Send so many messages, the given ones in turn, at a steady rate."""
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

    def one_after_the_other(self, messages: Sequence[Any], count: int) -> Run:
        """Send so many messages as fast as they are answered, a few being on their way."""
        self._latencies_ms = []
        before_s, start_s = self.process.processor_s, time.monotonic()
        for i in range(count):
            heard_s = time.monotonic()
            while i - len(self._latencies_ms) >= _IN_FLIGHT:
                before = len(self._latencies_ms)
                self._executor.spin_once(timeout_sec=_SILENCE_S)
                if len(self._latencies_ms) > before:
                    heard_s = time.monotonic()
                elif time.monotonic() - heard_s > _PATIENCE_S:
                    raise RuntimeError(f'no answers any more after {i} messages')
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

    def _listen(self, duration_s: float) -> None:
        ends_s = time.monotonic() + duration_s
        while (left_s := ends_s - time.monotonic()) > 0.0:
            self._executor.spin_once(timeout_sec=left_s)

    def _drain(self, count: int) -> None:
        """Listen until so many have come, or nothing comes any more."""
        before = -1
        while len(self._latencies_ms) != count and len(self._latencies_ms) > before:
            before = len(self._latencies_ms)
            self._listen(_SILENCE_S)
