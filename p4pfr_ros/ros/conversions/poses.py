# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""
``Pose`` <-> PoseStamped, PoseWithCovarianceStamped, PoseArray and TransformStamped.

The pose is camera_from_board, in metres. The camera frame is the optical frame of the header:
x right, y down, z forward.
"""

from __future__ import annotations

from collections.abc import Iterable

from geometry_msgs.msg import Pose as PoseMsg
from geometry_msgs.msg import (
    PoseArray,
    PoseStamped,
    PoseWithCovarianceStamped,
    Quaternion,
    Transform,
    TransformStamped,
    Vector3,
)
import numpy as np
from p4pfr_ros.core.geometry import Array, Pose
from std_msgs.msg import Header

# Variance of a quantity that the view does not determine: a standard deviation of 1 km or
# 1000 rad. ROS has no value for 'unknown' (readers interpret -1 and 0 differently); with a
# variance this large a filter gives the measurement no weight, as it should.
UNDETERMINED_VARIANCE = 1e6


def pose_msg(header: Header, camera_from_board: Pose) -> PoseStamped:
    """Make a PoseStamped."""
    return PoseStamped(header=header, pose=bare_pose_msg(camera_from_board))


def pose_from_msg(msg: PoseStamped) -> Pose:
    """Return the pose of a PoseStamped of ours; a zero quaternion raises ``ValueError``."""
    q, p = msg.pose.orientation, msg.pose.position
    return Pose.from_quaternion_xyzw([q.x, q.y, q.z, q.w], [p.x, p.y, p.z])


def pose_with_covariance_msg(
    header: Header, camera_from_board: Pose, covariance: Array
) -> PoseWithCovarianceStamped:
    """
    Make a PoseWithCovarianceStamped.

    ``covariance`` is (6, 6) in ROS order: x, y, z, then rotation about the fixed axes x, y, z of
    the header's frame. A quantity whose variance is not finite, or larger than
    ``UNDETERMINED_VARIANCE``, is published with that variance and without covariances.
    """
    msg = PoseWithCovarianceStamped(header=header)
    msg.pose.pose = bare_pose_msg(camera_from_board)
    msg.pose.covariance = _published(covariance).ravel()
    return msg


def pose_array_msg(header: Header, poses: Iterable[Pose]) -> PoseArray:
    """Make a PoseArray, possibly empty."""
    return PoseArray(header=header, poses=[bare_pose_msg(pose) for pose in poses])


def transform_msg(
    header: Header, child_frame: str, camera_from_board: Pose, inverse: bool = False
) -> TransformStamped:
    """
    Make a TransformStamped: the header's frame is the parent, ``child_frame`` the board's frame.

    inverse: the board's frame is the parent and the header's frame the child. A frame in /tf has
    only one parent, so use it if the camera has no other, or if several cameras view one board.
    """
    camera_frame = header.frame_id
    parent, child = (child_frame, camera_frame) if inverse else (camera_frame, child_frame)
    pose = camera_from_board.inverse() if inverse else camera_from_board
    x, y, z = pose.translation.tolist()
    qx, qy, qz, qw = pose.quaternion_xyzw().tolist()
    return TransformStamped(
        header=Header(stamp=header.stamp, frame_id=parent),
        child_frame_id=child,
        transform=Transform(
            translation=Vector3(x=x, y=y, z=z), rotation=Quaternion(x=qx, y=qy, z=qz, w=qw)
        ),
    )


def bare_pose_msg(pose: Pose) -> PoseMsg:
    """Make a Pose without a header."""
    msg = PoseMsg()
    msg.position.x, msg.position.y, msg.position.z = pose.translation.tolist()
    q = msg.orientation
    q.x, q.y, q.z, q.w = pose.quaternion_xyzw().tolist()
    return msg


def _published(covariance: Array) -> Array:
    variance = np.diagonal(covariance)
    if variance.max() <= UNDETERMINED_VARIANCE and np.isfinite(covariance).all():
        return covariance
    determined = np.isfinite(variance) & (variance <= UNDETERMINED_VARIANCE)
    # Whole rows and columns are cleared, so the rest stays positive semidefinite.
    published = np.where(np.outer(determined, determined), covariance, 0.0)
    published[~determined, ~determined] = UNDETERMINED_VARIANCE
    finite: Array = np.where(np.isfinite(published), published, 0.0)
    return finite
