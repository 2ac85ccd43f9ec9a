# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""The generated parts of the pages of our nodes."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path

from p4pfr_ros.ros.camera_simulator import CameraSimulator
from p4pfr_ros.ros.dashboard_node import DashboardNode
from p4pfr_ros.ros.detector_node import DetectorNode
from p4pfr_ros.ros.lifecycle_pose_node import LifecyclePoseNode
from p4pfr_ros.ros.parameters.dashboard_options import DashboardNodeOptions
from p4pfr_ros.ros.parameters.image_node_options import CameraSimulatorOptions, DetectorNodeOptions
from p4pfr_ros.ros.parameters.pose_options import PoseNodeOptions
from p4pfr_ros.ros.pose_node import PoseNode

from .descriptions import (
    CAMERA_SIMULATOR,
    DASHBOARD_NODE,
    DETECTOR_NODE,
    LIFECYCLE_POSE_NODE,
    OPTIONAL_OF_POSE_NODE,
    POSE_NODE,
)
from .interfaces import endpoints_of
from .tables import interface, parameters

BOARD = Path(__file__).parents[2] / 'config' / 'boards' / 'chessboard_9x6_25mm.yaml'


def pose_node() -> dict[str, str]:
    """Return the generated parts of the page of pose_node, by name."""
    given = {'board_file': str(BOARD), 'set_camera_info_service': 'set_camera_info'}
    endpoints = endpoints_of(PoseNode, given)
    managed = endpoints_of(_active_pose_node, given)
    assert endpoints <= managed, f'only pose_node has {endpoints - managed}'
    names = {endpoint.name for endpoint in endpoints}
    endpoints |= {optional for optional in OPTIONAL_OF_POSE_NODE if optional.name not in names}
    return {
        'interface': interface('pose_node', endpoints, POSE_NODE),
        'lifecycle': interface('lifecycle_pose_node', managed - endpoints, LIFECYCLE_POSE_NODE),
        'parameters': parameters(PoseNodeOptions()),
    }


def detector_node() -> dict[str, str]:
    """Return the generated parts of the page of detector_node, by name."""
    given = {'board_file': str(BOARD)}
    endpoints = endpoints_of(DetectorNode, given)
    endpoints |= endpoints_of(DetectorNode, {**given, 'image.transport': 'compressed'})
    return {
        'interface': interface('detector_node', endpoints, DETECTOR_NODE),
        'parameters': parameters(DetectorNodeOptions()),
    }


def camera_simulator() -> dict[str, str]:
    """Return the generated parts of the page of camera_simulator, by name."""
    endpoints = endpoints_of(CameraSimulator, {'board_file': str(BOARD)})
    return {
        'interface': interface('camera_simulator', endpoints, CAMERA_SIMULATOR),
        'parameters': parameters(CameraSimulatorOptions()),
    }


def dashboard_node() -> dict[str, str]:
    """Return the generated parts of the page of dashboard_node, by name."""
    given = {
        'board_file': str(BOARD),
        'port': '0',
        'set_camera_info_service': 'set_camera_info',
    }
    endpoints = endpoints_of(DashboardNode, given)
    endpoints |= endpoints_of(DashboardNode, {**given, 'image.transport': 'compressed'})
    return {
        'interface': interface('dashboard_node', endpoints, DASHBOARD_NODE),
        'parameters': parameters(DashboardNodeOptions()),
    }


PAGES: Mapping[str, Callable[[], dict[str, str]]] = {
    'pose_node.md': pose_node,
    'detector_node.md': detector_node,
    'camera_simulator.md': camera_simulator,
    'dashboard_node.md': dashboard_node,
}


def _active_pose_node() -> LifecyclePoseNode:
    node = LifecyclePoseNode()
    node.trigger_configure()
    node.trigger_activate()
    return node
