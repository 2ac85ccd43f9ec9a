# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""A board in a picture, with all that the nodes know of both."""

from __future__ import annotations

from dataclasses import dataclass

from p4pfr_ros.core.geometry import Array
from std_msgs.msg import Header

from .targets import Target
from ..conversions import Correspondences, ImageFrame


@dataclass(frozen=True, slots=True, eq=False)
class SeenBoard:
    """
    Where a picture shows a board.

    Parameters
    ----------
    header
        Of the message that told of it: stamp and optical frame.
    frame
        The picture's.
    target
        The board.
    points
        Its points, in pixels of the picture as it was sent.
    image_points : (N, 2) array
        The same in pixels of the full raw picture.

    """

    header: Header
    frame: ImageFrame
    target: Target
    points: Correspondences
    image_points: Array

    @property
    def stamp_ns(self) -> int:
        """When the picture was taken, by its header: any number, also one that no clock shows."""
        stamp = self.header.stamp
        return 1_000_000_000 * int(stamp.sec) + int(stamp.nanosec)
