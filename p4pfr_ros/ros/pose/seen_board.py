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

"""A board in a picture, with all that the nodes know of both."""

from __future__ import annotations

from dataclasses import dataclass

from p4pfr_ros.core.geometry import Array
from std_msgs.msg import Header

from .conversions import Correspondences, ImageFrame
from .targets import Target


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
