# Copyright 2026 p4pfr_ros maintainers
#
# Licensed under the Apache License, Version 2.0 (the "License");
# you may not use this file except in compliance with the License.
# You may obtain a copy of the License at
#
#     http://www.apache.org/licenses/LICENSE-2.0
#
# Unless required by applicable law or agreed to in writing, software
# distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied.
# See the License for the specific language governing permissions and
# limitations under the License.

"""lifecycle_pose_node: pose_node, with a lifecycle that somebody else manages."""

from __future__ import annotations

from collections.abc import Sequence

from p4pfr_ros.files import ConfigError
from rclpy.lifecycle import LifecycleNode, LifecycleState, TransitionCallbackReturn

from .options import PoseNodeOptions
from .parameters import Parameters
from .pose_work import PoseWork
from .spin import run

_DONE, _REFUSED = TransitionCallbackReturn.SUCCESS, TransitionCallbackReturn.FAILURE


class LifecyclePoseNode(LifecycleNode):  # type: ignore[misc]
    """
    pose_node's work, made, begun, paused and taken down on request.

    Parameters are there from the beginning. Configuring reads the files that they name, makes
    publishers and services and compiles the kernels; between activating and deactivating the
    node listens; cleaning up forgets what was found and not saved.
    """

    def __init__(self) -> None:
        super().__init__('lifecycle_pose_node')
        self._config = Parameters(self, PoseNodeOptions())
        self._work: PoseWork | None = None
        self.get_logger().info('ready to be configured')

    def on_configure(self, _: LifecycleState) -> TransitionCallbackReturn:
        """Get ready; refused, with a line in the log, where a file is wrong."""
        try:
            self._work = PoseWork(self, self._config)
        except ConfigError as error:
            self.get_logger().error(f'not configured: {error}')
            return _REFUSED
        return _DONE

    def on_activate(self, _: LifecycleState) -> TransitionCallbackReturn:
        """Begin to listen."""
        assert self._work is not None
        self._work.start()
        return _DONE

    def on_deactivate(self, _: LifecycleState) -> TransitionCallbackReturn:
        """Listen no more."""
        assert self._work is not None
        self._work.stop()
        return _DONE

    def on_cleanup(self, _: LifecycleState) -> TransitionCallbackReturn:
        """Take everything down."""
        self._take_down()
        return _DONE

    def on_shutdown(self, _: LifecycleState) -> TransitionCallbackReturn:
        """Take everything down, whatever there is."""
        self._take_down()
        return _DONE

    def on_error(self, _: LifecycleState) -> TransitionCallbackReturn:
        """Take down what an unexpected error has left; the node may be configured again."""
        self._take_down()
        return _DONE

    def _take_down(self) -> None:
        if self._work is not None:
            self._work.close()
            self._work = None


def main(args: Sequence[str] | None = None) -> None:
    """Run lifecycle_pose_node until SIGINT or SIGTERM."""
    run(LifecyclePoseNode, args)


if __name__ == '__main__':
    main()
