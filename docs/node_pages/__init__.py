# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""The made parts of the pages on our nodes: which node has which."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path

from p4pfr_ros.ros.camera_simulator import CameraSimulator
from p4pfr_ros.ros.detector_node import DetectorNode
from p4pfr_ros.ros.lifecycle_pose_node import LifecyclePoseNode
from p4pfr_ros.ros.parameters.image_node_options import (
    CameraSimulatorOptions,
    DetectorNodeOptions,
    PoseNodeOptions,
)
from p4pfr_ros.ros.pose_node import PoseNode

from .interfaces import endpoints_of
from .tables import interface, parameters
from .words import (
    CAMERA_SIMULATOR,
    DETECTOR_NODE,
    LIFECYCLE_POSE_NODE,
    OPTIONAL_OF_POSE_NODE,
    POSE_NODE,
)

BOARD = Path(__file__).parents[2] / 'config' / 'boards' / 'chessboard_9x6_25mm.yaml'


def pose_node() -> dict[str, str]:
    """Return the parts of the page on pose_node, by name."""
    given = {'board_file': str(BOARD), 'set_camera_info_service': 'set_camera_info'}
    found = endpoints_of(PoseNode, given)
    managed = endpoints_of(_active_pose_node, given)
    assert found <= managed, f'only pose_node has {found - managed}'
    there = {endpoint.name for endpoint in found}
    found |= {optional for optional in OPTIONAL_OF_POSE_NODE if optional.name not in there}
    return {
        'interface': interface('pose_node', found, POSE_NODE),
        'lifecycle': interface('lifecycle_pose_node', managed - found, LIFECYCLE_POSE_NODE),
        'parameters': parameters(PoseNodeOptions()),
    }


def detector_node() -> dict[str, str]:
    """Return the parts of the page on detector_node, by name."""
    given = {'board_file': str(BOARD)}
    found = endpoints_of(DetectorNode, given)
    found |= endpoints_of(DetectorNode, {**given, 'image.transport': 'compressed'})
    return {
        'interface': interface('detector_node', found, DETECTOR_NODE),
        'parameters': parameters(DetectorNodeOptions()),
    }


def camera_simulator() -> dict[str, str]:
    """Return the parts of the page on camera_simulator, by name."""
    found = endpoints_of(CameraSimulator, {'board_file': str(BOARD)})
    return {
        'interface': interface('camera_simulator', found, CAMERA_SIMULATOR),
        'parameters': parameters(CameraSimulatorOptions()),
    }


PAGES: Mapping[str, Callable[[], dict[str, str]]] = {
    'pose_node.md': pose_node,
    'detector_node.md': detector_node,
    'camera_simulator.md': camera_simulator,
}


def _active_pose_node() -> LifecyclePoseNode:
    node = LifecyclePoseNode()
    node.trigger_configure()
    node.trigger_activate()
    return node
