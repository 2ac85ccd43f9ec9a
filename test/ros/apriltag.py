# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""The messages of apriltag_msgs, by their published fields; the package need not be installed."""

from dataclasses import dataclass, field
import sys
from types import ModuleType

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
class AprilTagDetectionArray:
    """apriltag_msgs/AprilTagDetectionArray."""

    header: Header = field(default_factory=Header)
    detections: list = field(default_factory=list)


def install(monkeypatch):
    """Make the messages importable as the package apriltag_msgs."""
    package, messages = ModuleType('apriltag_msgs'), ModuleType('apriltag_msgs.msg')
    messages.AprilTagDetectionArray = AprilTagDetectionArray
    monkeypatch.setitem(sys.modules, 'apriltag_msgs', package)
    monkeypatch.setitem(sys.modules, 'apriltag_msgs.msg', messages)


def uninstall(monkeypatch):
    """Make the package apriltag_msgs unavailable."""
    monkeypatch.setitem(sys.modules, 'apriltag_msgs', None)
