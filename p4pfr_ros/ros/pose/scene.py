# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""Where the board is, for tools that draw: ``~/markers`` and /tf."""

from __future__ import annotations

from p4pfr_ros import PoseEstimate
from rclpy.node import Node
from visualization_msgs.msg import MarkerArray

from .seen_board import SeenBoard
from .transforms import Transforms
from ..conversions.markers import markers_msg
from ..parameters.pose_options import PoseNodeOptions
from ..runtime.endpoints import Endpoints, is_heard


class Scene:
    """
    Shows answers.

    Parameters
    ----------
    node
        Whose /tf it is.
    endpoints
        Makes and takes down.

    """

    def __init__(self, node: Node, endpoints: Endpoints) -> None:
        self._node, self._endpoints = node, endpoints
        self._markers = endpoints.advertise(MarkerArray, '~/markers')
        self._transforms: Transforms | None = None

    def is_heard(self, options: PoseNodeOptions) -> bool:
        """Return whether anybody looks; of /tf that is taken for granted."""
        return options.publish_tf or is_heard(self._markers)

    def show(self, board: SeenBoard, estimate: PoseEstimate, options: PoseNodeOptions) -> None:
        """Show an estimate, or take the board away where it has no model."""
        if is_heard(self._markers):
            self._markers.publish(_markers(board, estimate, options))
        model, seen = estimate.model, estimate.observable
        if options.publish_tf and model is not None and seen.direction and seen.distance:
            if self._transforms is None:
                self._transforms = Transforms(self._node, self._endpoints)
            board_frame = board.target.frame(options.board_frame)
            self._transforms.send(
                board.header, board_frame, model.camera_from_board, options.invert_tf
            )


def _markers(board: SeenBoard, estimate: PoseEstimate, options: PoseNodeOptions) -> MarkerArray:
    target = board.target
    return markers_msg(
        board.header,
        target.frame(options.board_frame),
        estimate,
        board.points,
        board.image_points,
        board.frame.size,
        sheet_size_m=None if target.board is None else target.board.sheet_size_m,
        full_scale_px=options.robust.threshold_px,
    )
