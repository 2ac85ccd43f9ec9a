# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""pose_node: corners of a marker or board in, pose and camera out."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from rclpy.node import Node

from .parameters.declare import Parameters
from .parameters.pose_options import PoseNodeOptions
from .pose.pipeline import PosePipeline
from .runtime.spin import run


class PoseNode(Node):  # type: ignore[misc]
    """
    Runs the pose pipeline from start to end; `lifecycle_pose_node` does so on request.

    Parameters
    ----------
    **node_options
        Options of rclpy's Node, such as ``parameter_overrides``.

    """

    def __init__(self, **node_options: Any) -> None:
        super().__init__('pose_node', **node_options)
        self._pipeline = PosePipeline(self, Parameters(self, PoseNodeOptions()))
        self._pipeline.start()
        self._pipeline.when_ready(lambda: self.get_logger().info('ready'))

    def destroy_node(self) -> None:
        """Save the calibration if that is an option, and destroy the node."""
        self._pipeline.close()
        super().destroy_node()


def main(args: Sequence[str] | None = None) -> None:
    """Run pose_node until SIGINT or SIGTERM."""
    run(PoseNode, args)


if __name__ == '__main__':
    main()
