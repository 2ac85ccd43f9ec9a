# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""Poses onto /tf, where ``tf2_ros`` is installed."""

from __future__ import annotations

from typing import Any

from p4pfr_ros.core.geometry import Pose
from rclpy.node import Node
from std_msgs.msg import Header

from ..conversions.poses import transform_msg
from ..runtime.endpoints import Endpoints


class Transforms:
    """
    Broadcasts poses of boards on /tf.

    Where ``tf2_ros`` is missing, one line of the node's log says so, and nothing is sent.

    Parameters
    ----------
    node
        Whose /tf it is.
    endpoints
        Takes its publisher down.

    """

    def __init__(self, node: Node, endpoints: Endpoints) -> None:
        self._logger = node.get_logger()
        self._broadcaster = _broadcaster(node)
        if self._broadcaster is not None:
            # A broadcaster has no way to take down the publisher that it has made.
            publisher = self._broadcaster.pub_tf
            endpoints.add(lambda: node.destroy_publisher(publisher))

    def send(
        self, header: Header, child_frame: str, camera_from_board: Pose, inverse: bool = False
    ) -> None:
        """Send a pose; ``inverse`` makes the board's frame the parent of the header's."""
        if self._broadcaster is None:
            return
        if header.frame_id in ('', child_frame):
            # Every listener would complain about every message.
            self._logger.warning(
                f'nothing is published on /tf: expected corners in another frame than '
                f'{child_frame!r}, their header says {header.frame_id!r}',
                once=True,
            )
        else:
            self._broadcaster.sendTransform(
                transform_msg(header, child_frame, camera_from_board, inverse)
            )


def _broadcaster(node: Node) -> Any:
    # Imported here and not above: only who wants /tf pays for it.
    try:
        from tf2_ros import TransformBroadcaster
    except ImportError:
        node.get_logger().warning('tf2_ros is not installed: nothing is published on /tf')
        return None
    return TransformBroadcaster(node)
