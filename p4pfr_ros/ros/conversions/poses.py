# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""
``Pose`` <-> PoseStamped, PoseWithCovarianceStamped and TransformStamped.

The pose is that of the board in the optical frame that the header names: x right, y down,
z forward, metres.
"""

from __future__ import annotations

from geometry_msgs.msg import Pose as PoseMsg
from geometry_msgs.msg import (
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

# What the picture does not determine gets this variance: a standard deviation of 1 km, of 1000
# rad. ROS has no mark for 'unknown' (-1 and 0 mean different things to different readers), and a
# filter that is given a variance this large rightly learns nothing from the number.
UNDETERMINED_VARIANCE = 1e6


def pose_msg(header: Header, camera_from_board: Pose) -> PoseStamped:
    """Make a PoseStamped."""
    return PoseStamped(header=header, pose=bare_pose_msg(camera_from_board))


def pose_from_msg(msg: PoseStamped) -> Pose:
    """Take the pose of our own PoseStamped; a quaternion of zeros is a ``ValueError``."""
    q, p = msg.pose.orientation, msg.pose.position
    return Pose.from_quaternion_xyzw([q.x, q.y, q.z, q.w], [p.x, p.y, p.z])


def pose_with_covariance_msg(
    header: Header, camera_from_board: Pose, covariance: Array
) -> PoseWithCovarianceStamped:
    """
    Make a PoseWithCovarianceStamped.

    ``covariance`` is (6, 6) in ROS order: x, y, z, then rotation about the fixed axes x, y, z of
    the header's frame. An entry that is not finite is not determined by the picture:
    ``UNDETERMINED_VARIANCE`` on the diagonal, 0 beside it.
    """
    msg = PoseWithCovarianceStamped(header=header)
    msg.pose.pose = bare_pose_msg(camera_from_board)
    msg.pose.covariance = _published(covariance).ravel()
    return msg


def transform_msg(
    header: Header, child_frame: str, camera_from_board: Pose, inverse: bool = False
) -> TransformStamped:
    """
    Make a TransformStamped from the header's frame, the parent, to the board's frame, the child.

    inverse: the board's frame is the parent, and the header's the child. A frame has one parent
    in /tf, so that is for a camera which has none, or one board that several cameras see.
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
    known = np.isfinite(variance) & (variance <= UNDETERMINED_VARIANCE)
    # A whole row and column goes at once: what is left is still positive semidefinite.
    published = np.where(np.outer(known, known), covariance, 0.0)
    published[~known, ~known] = UNDETERMINED_VARIANCE
    finite: Array = np.where(np.isfinite(published), published, 0.0)
    return finite
