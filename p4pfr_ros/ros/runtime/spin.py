# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""Runs a node as a process, from the command line to a clean exit."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextlib import suppress
import signal
import sys
from tempfile import TemporaryFile
from types import FrameType
from typing import Any

from p4pfr_ros.files.yaml_fields import ConfigError
import rclpy
from rclpy.executors import ExternalShutdownException, SingleThreadedExecutor
from rclpy.logging import get_logging_directory
from rclpy.node import Node
from rclpy.signals import uninstall_signal_handlers

from .overrides import warn_of_unknown_overrides

# Delay before a signal that could not be handled is retried.
_RETRY_S = 0.02


def run(
    make_node: Callable[[], Node], args: Sequence[str] | None = None, *, complete: bool = True
) -> None:
    """
    Create a node and spin it until SIGINT or SIGTERM, which exit with status 0.

    A ``ConfigError`` is printed as one line; the exit status is 1. A ``complete`` node has all
    its endpoints when it is created, so QoS overrides of other endpoints are warned of.
    """
    interrupt = _Interrupt()
    node: Node | None = None
    try:
        _init(args)
        executor = SingleThreadedExecutor()
        with interrupt:
            node = make_node()
            if complete:
                warn_of_unknown_overrides(node)
            rclpy.spin(node, executor)
    except (SystemExit, ExternalShutdownException):
        pass
    except ConfigError as error:
        raise SystemExit(f'{error}') from None
    except Exception:
        # A signal also shuts ROS down, which makes calls in progress fail.
        if not interrupt.received:
            raise
    finally:
        if node is not None:
            node.destroy_node()
        # rclpy's own signal handler may be shutting down at the same time.
        with suppress(RuntimeError):
            rclpy.try_shutdown()
        # Waits for the thread of rclpy's signal handler, which may crash while the process ends.
        uninstall_signal_handlers()


def _init(args: Sequence[str] | None) -> None:
    try:
        init_ros(args)
    except Exception as error:  # the class of rclpy's exception is not public
        raise ConfigError(f'ROS arguments: {" ".join(str(error).split())}') from None


def init_ros(args: Sequence[str] | None = None, **options: Any) -> None:
    """
    Call ``rclpy.init``, without log files if there is no place for them.

    ROS itself does not start then. A warning says what to do.
    """
    problem = _log_problem()
    if problem:
        print(f'no log files: {problem}. Set ROS_LOG_DIR to a writable folder.', file=sys.stderr)
    no_files = ['--ros-args', '--disable-external-lib-logs'] if problem else []
    rclpy.init(args=[*(sys.argv if args is None else args), *no_files], **options)


def _log_problem() -> str:
    """Return why ROS cannot write log files; an empty text if it can."""
    try:
        folder = get_logging_directory()
    except RuntimeError:
        return 'no home directory'
    try:
        folder.mkdir(parents=True, exist_ok=True)
        with TemporaryFile(dir=folder):
            return ''
    except OSError as error:
        return f'{folder}: {error.strerror}'


class _Interrupt:
    """
    Handles SIGINT and SIGTERM: inside its ``with`` block they raise SystemExit.

    rclpy's own handlers, installed by init(), wake up the executor, shut ROS down and then call
    this one. Without the exception the executor could start to wait again between wake-up and
    shutdown, and never return. Also, a node that is being created may be compiling its kernels,
    which takes longer than a launch file waits before it kills the process. Start and shutdown
    of ROS itself are not interrupted.
    """

    def __init__(self) -> None:
        self.received = False
        self._raises = False
        for number in (signal.SIGINT, signal.SIGTERM, signal.SIGALRM):
            signal.signal(number, self._handle)

    def __enter__(self) -> None:
        if self.received:
            raise SystemExit
        self._raises = True

    def __exit__(self, *_: object) -> None:
        self._raises = False
        signal.setitimer(signal.ITIMER_REAL, 0.0)

    def _handle(self, _: int, frame: FrameType | None) -> None:
        self.received = True
        if not self._raises:
            return
        if _in_compiler(frame):
            signal.setitimer(signal.ITIMER_REAL, _RETRY_S)
            return
        # Not KeyboardInterrupt: if one passes through exec(), which Numba uses, Python exits with
        # the status of a killed process even though the exception was caught.
        raise SystemExit


def _in_compiler(frame: FrameType | None) -> bool:
    """Return whether LLVM is running: an exception in one of its callbacks is printed and lost."""
    while frame is not None:
        if frame.f_globals.get('__name__', '').startswith('llvmlite.'):
            return True
        frame = frame.f_back
    return False
