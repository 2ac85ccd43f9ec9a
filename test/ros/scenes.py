# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""Synthetic views with known camera and pose, as messages."""

from builtin_interfaces.msg import Time
from geometry_msgs.msg import Point32, PolygonStamped
import numpy as np
from p4pfr_ros import DivisionCamera, Pose
from p4pfr_ros.ros.conversions import cloud_msg
from sensor_msgs.msg import CameraInfo
from std_msgs.msg import Header

SIZE = (640, 480)
CAMERA = DivisionCamera(520.0, (319.5, 239.5), -0.2)
FACING = Pose(np.diag([1.0, -1.0, -1.0]), np.array([0.03, -0.02, 0.45]))
CAMERA_FROM_BOARD = FACING @ Pose.from_rotation_vector([0.5, 0.3, 0.2], np.zeros(3))
GRID = np.stack(np.meshgrid(np.linspace(-0.1, 0.1, 6), np.linspace(-0.08, 0.08, 5)), -1).reshape(
    -1, 2
)
MARKER_M = 0.12
ARUCO = MARKER_M * np.array([[-0.5, 0.5], [0.5, 0.5], [0.5, -0.5], [-0.5, -0.5]])


def header(second, frame_id='a_camera'):
    """Make a header."""
    return Header(stamp=Time(sec=second, nanosec=123456789), frame_id=frame_id)


def project(board_points, pose=CAMERA_FROM_BOARD, camera=CAMERA):
    """Project (N, 2) points of the board to (N, 2) px."""
    return camera.project(pose.transform(np.pad(board_points, ((0, 0), (0, 1)))))


def board_cloud(second, frame_id='a_camera', pose=CAMERA_FROM_BOARD, camera=CAMERA):
    """Make the correspondences of a board of 30 points, without noise."""
    image_points = project(GRID, pose, camera)
    return cloud_msg(header(second, frame_id), image_points, GRID, np.arange(len(GRID)))


def polygon(second, image_points, frame_id='a_camera'):
    """Make the corners of a marker."""
    msg = PolygonStamped(header=header(second, frame_id))
    msg.polygon.points = [Point32(x=float(x), y=float(y), z=0.0) for x, y in image_points]
    return msg


def camera_info(size=SIZE):
    """Make the camera_info of an uncalibrated camera."""
    return CameraInfo(header=header(0), width=size[0], height=size[1])
