# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""pose_node: corners of a marker or board in, pose and camera out."""

from __future__ import annotations

from collections.abc import Sequence

from rclpy.node import Node

from .parameters.declare import Parameters
from .parameters.image_node_options import PoseNodeOptions
from .pose.pipeline import PoseWork
from .runtime.spin import run


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
