# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""The life of a node's process, from the command line to a clean end."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextlib import suppress
import signal
from types import FrameType

from p4pfr_ros.files.yaml_fields import ConfigError
import rclpy
from rclpy.executors import ExternalShutdownException, SingleThreadedExecutor
from rclpy.node import Node

from .overrides import warn_of_unknown_overrides

# After which a signal that came at a bad moment is tried again.
_AGAIN_S = 0.02


def run(
    make_node: Callable[[], Node], args: Sequence[str] | None = None, *, complete: bool = True
) -> None:
    """
    Make a node and spin it until SIGINT or SIGTERM, which are a clean end: exit status 0.

    What the user has configured wrongly (``ConfigError``) is said in one line: exit status 1.
    A node that is ``complete`` has all its endpoints when it is made, so overrides of other ones
    are warned of.
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
        # A signal also closes ROS under whatever is being done with it.
        if not interrupt.came:
            raise
    finally:
        if node is not None:
            node.destroy_node()
        # rclpy's handler of the signal may be shutting down this very moment.
        with suppress(RuntimeError):
            rclpy.try_shutdown()


def _init(args: Sequence[str] | None) -> None:
    try:
        rclpy.init(args=args)
    except Exception as error:  # rclpy's own class for it is not public
        raise ConfigError(f'ROS arguments: {" ".join(str(error).split())}') from None


class _Interrupt:
    """
    Handles SIGINT and SIGTERM: inside its ``with`` block they raise SystemExit.

    rclpy's own handlers, which come with init(), wake up whoever waits and shut ROS down, and
    then call this one. Without the exception the executor could go back to waiting between
    those two, for ever; and a node in the making may be compiling its kernels, which takes longer
    than a launch file waits. Starting and shutting down ROS themselves are not interrupted.
    """

    def __init__(self) -> None:
        self.came = False
        self._raises = False
        for number in (signal.SIGINT, signal.SIGTERM, signal.SIGALRM):
            signal.signal(number, self._handle)

    def __enter__(self) -> None:
        if self.came:
            raise SystemExit
        self._raises = True

    def __exit__(self, *_: object) -> None:
        self._raises = False
        signal.setitimer(signal.ITIMER_REAL, 0.0)

    def _handle(self, _: int, frame: FrameType | None) -> None:
        self.came = True
        if not self._raises:
            return
        if _in_compiler(frame):
            signal.setitimer(signal.ITIMER_REAL, _AGAIN_S)
            return
        # Not KeyboardInterrupt: Python remembers one that has passed through exec(), as there is
        # in Numba, and ends with the status of a killed process though it was caught.
        raise SystemExit


def _in_compiler(frame: FrameType | None) -> bool:
    """Return whether LLVM is at work: in its callbacks an exception is printed and lost."""
    while frame is not None:
        if frame.f_globals.get('__name__', '').startswith('llvmlite.'):
            return True
        frame = frame.f_back
    return False
