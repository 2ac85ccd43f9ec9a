# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""The messages of apriltag_msgs and Isaac ROS, by their published fields; neither is needed."""

from dataclasses import dataclass, field
import sys
from types import ModuleType

from geometry_msgs.msg import Point as GeometryPoint
from geometry_msgs.msg import PoseWithCovarianceStamped
import numpy as np
from std_msgs.msg import Header


@dataclass
class Point:
    """apriltag_msgs/Point."""

    x: float = 0.0
    y: float = 0.0


@dataclass
class AprilTagDetection:
    """apriltag_msgs/AprilTagDetection."""

    family: str = ''
    id: int = 0
    hamming: int = 0
    goodness: float = 0.0
    decision_margin: float = 0.0
    centre: Point = field(default_factory=Point)
    corners: list = field(default_factory=lambda: [Point() for _ in range(4)])
    homography: np.ndarray = field(default_factory=lambda: np.zeros(9))


@dataclass
class IsaacDetection:
    """isaac_ros_apriltag_interfaces/AprilTagDetection."""

    family: str = ''
    id: int = 0
    center: GeometryPoint = field(default_factory=GeometryPoint)
    corners: list = field(default_factory=lambda: [GeometryPoint() for _ in range(4)])
    pose: PoseWithCovarianceStamped = field(default_factory=PoseWithCovarianceStamped)


@dataclass
class AprilTagDetectionArray:
    """AprilTagDetectionArray of both packages."""

    header: Header = field(default_factory=Header)
    detections: list = field(default_factory=list)


def isaac_detection(tag, corners):
    """Make a detection of Isaac ROS from corners (4, 2) px, clockwise from the top left."""
    points = [GeometryPoint(x=float(x), y=float(y)) for x, y in corners]
    return IsaacDetection(family='tag36h11', id=tag, corners=points)


def install(monkeypatch, name='apriltag_msgs'):
    """Make the messages importable as this package."""
    package, messages = ModuleType(name), ModuleType(f'{name}.msg')
    messages.AprilTagDetectionArray = AprilTagDetectionArray
    monkeypatch.setitem(sys.modules, name, package)
    monkeypatch.setitem(sys.modules, f'{name}.msg', messages)


def uninstall(monkeypatch, name='apriltag_msgs'):
    """Make this package unavailable."""
    monkeypatch.setitem(sys.modules, name, None)
