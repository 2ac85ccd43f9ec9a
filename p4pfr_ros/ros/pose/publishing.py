# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""Where pose_node's answers go: poses, camera, markers and /tf."""

from __future__ import annotations

from p4pfr_ros import PoseEstimate
from p4pfr_ros.core.cameras.camera_info import CameraInfoModel
from rclpy.node import Node

from .outputs import CameraOutputs, PoseOutputs
from .scene import Scene
from .seen_board import SeenBoard
from .self_calibrating import Known
from .targets import Target, Targets
from ..parameters.intrinsics_options import PER_FRAME
from ..parameters.pose_options import PoseNodeOptions
from ..runtime.endpoints import Endpoints


class Publishing:
    """
    All topics of answers.

    Parameters
    ----------
    node
        Whose topics they are.
    endpoints
        Makes and takes down.
    targets
        Whose poses are published.

    """

    def __init__(self, node: Node, endpoints: Endpoints, targets: Targets) -> None:
        self._node = node
        self._poses = {p: PoseOutputs(endpoints, p) for p in sorted(targets.prefixes)}
        self._cameras = CameraOutputs(endpoints)
        self._scene = Scene(node, endpoints)
        self._told_by = ''

    def is_heard(self, target: Target, options: PoseNodeOptions) -> bool:
        """Return whether anybody would hear an answer about a board."""
        return (
            self._poses[target.prefix].is_heard()
            or self._cameras.is_heard()
            or self._scene.is_heard(options)
        )

    def show(self, board: SeenBoard, estimate: PoseEstimate, options: PoseNodeOptions) -> None:
        """Publish what a view shows."""
        # The poses first: somebody may be steering by them.
        self._poses[board.target.prefix].publish(board.header, estimate)
        self._scene.show(board, estimate, options)

    def tell(
        self, board: SeenBoard, camera: Known | None, options: PoseNodeOptions
    ) -> CameraInfoModel | None:
        """Publish the camera that is in use, where that is news; return its published model."""
        mode = options.intrinsics.mode
        # A camera of one frame is worth the fit of a model only if somebody waits for it.
        if camera is not None and (mode != PER_FRAME or self._cameras.is_heard()):
            self._told_by = mode
            again = mode == PER_FRAME
            return self._cameras.tell(board.header, board.frame, camera, again=again)
        # A view that does not tell its camera takes back nothing that the one before it told.
        if mode != PER_FRAME or self._told_by != PER_FRAME:
            self._cameras.take_back(board.header.stamp)
        return None

    def forget(self) -> None:
        """Take back the camera that was told."""
        self._cameras.take_back(self._node.get_clock().now().to_msg())
