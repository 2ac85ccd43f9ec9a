# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""lifecycle_pose_node: pose_node as a managed node."""

from __future__ import annotations

from collections.abc import Callable, Sequence
import traceback
from typing import Any

from p4pfr_ros.files.yaml_fields import ConfigError
from rclpy.lifecycle import LifecycleNode, LifecycleState, TransitionCallbackReturn

from .parameters.declare import Parameters
from .parameters.pose_options import PoseNodeOptions
from .pose.pipeline import PosePipeline
from .runtime.overrides import warn_of_unknown_overrides
from .runtime.spin import run

_SUCCESS, _FAILURE = TransitionCallbackReturn.SUCCESS, TransitionCallbackReturn.FAILURE


class LifecyclePoseNode(LifecycleNode):  # type: ignore[misc]
    """
    Creates, starts, stops and destroys the pose pipeline on request.

    Parameters are declared at once; those that are read-only in pose_node can be changed while the
    node is unconfigured. Configure loads the files, creates publishers and services and loads
    the kernels; activate subscribes, deactivate unsubscribes; cleanup destroys everything,
    including a calibration that was not saved; ``save_when_calibrated`` saves it before.

    Parameters
    ----------
    **node_options
        Options of rclpy's Node, such as ``parameter_overrides``.

    """

    def __init__(self, **node_options: Any) -> None:
        super().__init__('lifecycle_pose_node', **node_options)
        self._config = Parameters(self, PoseNodeOptions(), managed=True)
        self._pipeline: PosePipeline | None = None
        self._was_activated = False
        self.get_logger().info('ready to be configured')

    def destroy_node(self) -> None:
        """Destroy the pipeline, if there is one, and the node."""
        self._destroy_pipeline()
        super().destroy_node()

    def on_configure(self, _: LifecycleState) -> TransitionCallbackReturn:
        """Create the pipeline; fails with a line in the log if the configuration is invalid."""
        return self._attempt('configured', self._configure)

    def on_activate(self, _: LifecycleState) -> TransitionCallbackReturn:
        """Subscribe; fails with a line in the log if a QoS override is invalid."""
        return self._attempt('activated', self._activate)

    def on_deactivate(self, _: LifecycleState) -> TransitionCallbackReturn:
        """Unsubscribe."""
        assert self._pipeline is not None
        return self._attempt('deactivated', self._pipeline.stop)

    def on_cleanup(self, _: LifecycleState) -> TransitionCallbackReturn:
        """Destroy the pipeline."""
        return self._attempt('cleaned up', self._destroy_pipeline)

    def on_shutdown(self, _: LifecycleState) -> TransitionCallbackReturn:
        """Destroy the pipeline, if there is one."""
        return self._attempt('shut down', self._destroy_pipeline)

    def on_error(self, _: LifecycleState) -> TransitionCallbackReturn:
        """Destroy the pipeline after an unexpected error; the node can be configured again."""
        return self._attempt('recovered', self._destroy_pipeline)

    def _attempt(self, done: str, transition: Callable[[], None]) -> TransitionCallbackReturn:
        """Run a transition; a ``ConfigError`` makes it fail."""
        try:
            transition()
        except ConfigError as error:
            self.get_logger().error(f'not {done}: {error}')
            return _FAILURE
        except Exception:
            # rclpy continues with on_error and does not log the exception.
            self.get_logger().error(f'not {done}: {traceback.format_exc()}')
            raise
        return _SUCCESS

    def _configure(self) -> None:
        self._pipeline = PosePipeline(self, self._config)

    def _activate(self) -> None:
        assert self._pipeline is not None
        try:
            self._pipeline.start()
        except Exception:
            self._pipeline.stop()
            raise
        if not self._was_activated:
            # Only now all endpoints have been created.
            warn_of_unknown_overrides(self)
        self._was_activated = True

    def _destroy_pipeline(self) -> None:
        if self._pipeline is not None:
            self._pipeline.close()
            self._pipeline = None

    # Overrides a private method of rclpy by its mangled name, the only one. For a transition that
    # the current state does not have, rclpy raises an exception that ends the node, and the caller
    # waits forever: rclpy issue 1209, fixed by pull request 1319. Remove this with the last
    # supported release that lacks the fix (Jazzy's 7.1 does).
    def _LifecycleNodeMixin__change_state(self, transition_id: int) -> TransitionCallbackReturn:
        available = {item[0]: item[1] for item in self._state_machine.available_transitions}
        if transition_id not in available:
            state = self._state_machine.current_state[1]
            expected = ', '.join(f'{number} ({label})' for number, label in available.items())
            self.get_logger().warning(
                f'transition rejected: expected a transition of the state {state}: '
                f'{expected or "none"}, got {transition_id}'
            )
            return _FAILURE
        return super()._LifecycleNodeMixin__change_state(transition_id)


def main(args: Sequence[str] | None = None) -> None:
    """Run lifecycle_pose_node until SIGINT or SIGTERM."""
    run(LifecyclePoseNode, args, complete=False)


if __name__ == '__main__':
    main()
