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

"""pose_node: corners of a marker or board in, pose and camera out."""

from __future__ import annotations

from collections.abc import Sequence

from rclpy.node import Node

from .options import PoseNodeOptions
from .parameters import Parameters
from .pose_work import PoseWork
from .spin import run


class PoseNode(Node):  # type: ignore[misc]
    """Works from its beginning to its end; `lifecycle_pose_node` does so when it is told to."""

    def __init__(self) -> None:
        super().__init__('pose_node')
        self._work = PoseWork(self, Parameters(self, PoseNodeOptions()))
        self._work.start()
        self.get_logger().info('ready')


def main(args: Sequence[str] | None = None) -> None:
    """Run pose_node until SIGINT or SIGTERM."""
    run(PoseNode, args)


if __name__ == '__main__':
    main()
