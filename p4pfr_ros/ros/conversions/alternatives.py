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
