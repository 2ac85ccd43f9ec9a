# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""The start of a node: its kernels are loaded at once, or compiled while the node answers."""

from __future__ import annotations

from collections.abc import Callable
import threading
from typing import Any

from p4pfr_ros.core.jit import others_interpret
from p4pfr_ros.kernels.processes import are_compiled, compile_all
from rclpy.clock import Clock, ClockType
from rclpy.node import Node

_PERIOD_S = 0.1


class KernelStart:
    """
    Loads the kernels of a node before the constructor returns, if they are stored.

    Otherwise they are compiled in other processes, and then loaded by a thread. Until then
    ``pending`` says so, and the thread of the node interprets all kernels.

    Parameters
    ----------
    node
        The node; it logs 'ready' when the kernels are there.
    warm_up
        Calls all kernels.

    """

    def __init__(self, node: Node, warm_up: Callable[[], None]) -> None:
        self._node, self._warm_up = node, warm_up
        self._share = 0.0
        self._problem = ''
        self._thread: threading.Thread | None = None
        if are_compiled():
            warm_up()
            return
        node.get_logger().info('compiling the kernels, once on this machine')
        self._thread = threading.Thread(target=self._compile, daemon=True)
        self._thread.start()

    @property
    def pending(self) -> str:
        """What the node waits for, such as 'compiling kernels, 40 %'; empty if for nothing."""
        if self._thread is None:
            return ''
        if self._thread.is_alive():
            return f'compiling kernels, {100.0 * self._share:.0f} %'
        self._thread = None
        return ''

    def when_ready(self, log_ready: Callable[[], object]) -> None:
        """Call a function of the node when the kernels are there, at once or later."""
        if not self.pending:
            log_ready()
            return

        def poll() -> None:
            if not self.pending:
                self._node.destroy_timer(timer)
                if self._problem:
                    self._node.get_logger().warning(self._problem)
                log_ready()

        clock = Clock(clock_type=ClockType.STEADY_TIME)
        timer: Any = self._node.create_timer(_PERIOD_S, poll, clock=clock)

    def _compile(self) -> None:
        with others_interpret():
            try:
                compile_all(self._report)
            except (OSError, RuntimeError) as error:
                self._problem = f'the node itself has to compile the kernels: {error}'
            self._warm_up()

    def _report(self, share: float) -> None:
        self._share = share
