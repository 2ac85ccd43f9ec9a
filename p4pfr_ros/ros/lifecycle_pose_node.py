# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""lifecycle_pose_node: pose_node, with a lifecycle that somebody else manages."""

from __future__ import annotations

from collections.abc import Callable, Sequence
import traceback
from typing import Any

from p4pfr_ros.files.yaml_fields import ConfigError
from rclpy.lifecycle import LifecycleNode, LifecycleState, TransitionCallbackReturn

from .parameters.declare import Parameters
from .parameters.image_node_options import PoseNodeOptions
from .pose.pipeline import PoseWork
from .runtime.overrides import warn_of_unknown_overrides
from .runtime.spin import run

_DONE, _REFUSED = TransitionCallbackReturn.SUCCESS, TransitionCallbackReturn.FAILURE


class LifecyclePoseNode(LifecycleNode):  # type: ignore[misc]
    """
    pose_node's work, made, begun, paused and taken down on request.

    Parameters are there from the beginning. Configuring reads the files that they name, makes
    publishers and services and compiles the kernels; between activating and deactivating the
    node listens; cleaning up forgets what was found and not saved.

    Parameters
    ----------
    **options
        As rclpy's Node takes them.

    """

    def __init__(self, **options: Any) -> None:
        super().__init__('lifecycle_pose_node', **options)
        self._config = Parameters(self, PoseNodeOptions())
        self._work: PoseWork | None = None
        self._has_listened = False
        self.get_logger().info('ready to be configured')

    def on_configure(self, _: LifecycleState) -> TransitionCallbackReturn:
        """Get ready; refused, with a line in the log, where a file is wrong."""
        return self._make('configured', self._configure)

    def on_activate(self, _: LifecycleState) -> TransitionCallbackReturn:
        """Begin to listen; refused, with a line in the log, where an override is wrong."""
        return self._make('activated', self._activate)

    def on_deactivate(self, _: LifecycleState) -> TransitionCallbackReturn:
        """Listen no more."""
        assert self._work is not None
        return self._make('deactivated', self._work.stop)

    def on_cleanup(self, _: LifecycleState) -> TransitionCallbackReturn:
        """Take everything down."""
        return self._make('cleaned up', self._take_down)

    def on_shutdown(self, _: LifecycleState) -> TransitionCallbackReturn:
        """Take everything down, whatever there is."""
        return self._make('shut down', self._take_down)

    def on_error(self, _: LifecycleState) -> TransitionCallbackReturn:
        """Take down what an unexpected error has left; the node may be configured again."""
        return self._make('recovered', self._take_down)

    def _make(self, what: str, transition: Callable[[], None]) -> TransitionCallbackReturn:
        """Make a transition; what the user has configured wrongly refuses it."""
        try:
            transition()
        except ConfigError as error:
            self.get_logger().error(f'not {what}: {error}')
            return _REFUSED
        except Exception:
            # rclpy goes on to on_error, without a word of what has happened.
            self.get_logger().error(f'not {what}: {traceback.format_exc()}')
            raise
        return _DONE

    def _configure(self) -> None:
        self._work = PoseWork(self, self._config)

    def _activate(self) -> None:
        assert self._work is not None
        try:
            self._work.start()
        except Exception:
            self._work.stop()
            raise
        if not self._has_listened:
            # Now it has had all of its endpoints.
            warn_of_unknown_overrides(self)
        self._has_listened = True

    def _take_down(self) -> None:
        if self._work is not None:
            self._work.close()
            self._work = None

    # A private method of rclpy's, as Python spells its name outside; no other is touched. Of a
    # transition that the state does not have it makes an exception that nobody catches: the
    # node's end, and a caller that waits for ever. That is rclpy's issue 1209, mended by its pull
    # request 1319; to be removed with the last supported release without it (Jazzy's 7.1 is one).
    def _LifecycleNodeMixin__change_state(self, transition_id: int) -> TransitionCallbackReturn:
        there_are = {there[0]: there[1] for there in self._state_machine.available_transitions}
        if transition_id not in there_are:
            state = self._state_machine.current_state[1]
            expected = ', '.join(f'{number} ({label})' for number, label in there_are.items())
            self.get_logger().warning(
                f'transition refused: expected one of the state {state}: '
                f'{expected or "none"}, got {transition_id}'
            )
            return _REFUSED
        return super()._LifecycleNodeMixin__change_state(transition_id)


def main(args: Sequence[str] | None = None) -> None:
    """Run lifecycle_pose_node until SIGINT or SIGTERM."""
    run(LifecyclePoseNode, args, complete=False)


if __name__ == '__main__':
    main()
