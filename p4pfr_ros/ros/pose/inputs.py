# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""The topics that tell pose_node where a camera sees boards."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from typing import Any

from geometry_msgs.msg import PolygonStamped
from sensor_msgs.msg import PointCloud2
from std_msgs.msg import Header

from .targets import MARKER, Target, Targets
from ..conversions import (
    Correspondences,
    correspondences_from_cloud,
    correspondences_from_detections,
    correspondences_from_polygon,
    detection_array_type,
)
from ..parameters.declare import Parameters
from ..parameters.pose_options import PoseNodeOptions
from ..runtime.endpoints import Endpoints
from ..runtime.rejections import Rejected

# A target and where it was seen, or why a message does not say that.
Found = tuple[Target, Correspondences] | Rejected


class Inputs:
    """
    Turns messages into what was seen.

    Parameters
    ----------
    targets
        What can be seen.
    config
        The node's parameters.
    answer
        Takes the header of a message, and all that was seen in its picture.

    """

    def __init__(
        self,
        targets: Targets,
        config: Parameters[PoseNodeOptions],
        answer: Callable[[Header, Iterable[Found]], None],
    ) -> None:
        self._targets, self._config, self._answer = targets, config, answer

    def subscribe(self, endpoints: Endpoints) -> None:
        """Listen to all topics; to ``detections`` where apriltag_msgs and boards are there."""
        endpoints.subscribe(PolygonStamped, 'corners', self.on_corners)
        endpoints.subscribe(PointCloud2, 'correspondences', self.on_correspondences)
        detections = detection_array_type()
        if detections is not None and self._targets.boards:
            endpoints.subscribe(detections, 'detections', self.on_detections)

    def on_corners(self, msg: PolygonStamped) -> None:
        """Take the corners of a marker that no file knows of."""
        marker = self._config.options.marker
        points = correspondences_from_polygon(
            msg, marker.size_m, marker.corner_order, marker.pixel_center_px
        )
        self._answer(msg.header, [points if isinstance(points, Rejected) else (MARKER, points)])

    def on_correspondences(self, msg: PointCloud2) -> None:
        """Take the points of one board."""
        self._answer(msg.header, [self._found(correspondences_from_cloud(msg))])

    def on_detections(self, msg: Any) -> None:
        """Take the tags of an AprilTagDetectionArray, and sort them by their boards."""
        detections = self._config.options.detections
        found = correspondences_from_detections(
            msg, self._targets.boards, detections.corner_order, detections.pixel_center_px
        )
        self._answer(msg.header, [self._found(points) for points in found])

    def _found(self, points: Correspondences | Rejected) -> Found:
        if isinstance(points, Rejected):
            return points
        target = self._targets.at(points.board)
        return target if isinstance(target, Rejected) else (target, points)
