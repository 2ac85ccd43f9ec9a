# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""Other poses that explain a view as well, as a PoseArray."""

from __future__ import annotations

from collections.abc import Iterable

from geometry_msgs.msg import PoseArray
from p4pfr_ros.core.geometry import Pose
from std_msgs.msg import Header

from .poses import bare_pose_msg


def pose_array_msg(header: Header, poses: Iterable[Pose]) -> PoseArray:
    """Make a PoseArray; without poses it says that there are none."""
    return PoseArray(header=header, poses=[bare_pose_msg(pose) for pose in poses])
