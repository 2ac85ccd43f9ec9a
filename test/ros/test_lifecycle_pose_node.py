# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""lifecycle_pose_node over DDS: its behaviour in each state."""

from geometry_msgs.msg import PoseStamped
from lifecycle_msgs.msg import Transition
from lifecycle_msgs.srv import ChangeState, GetState
from p4pfr_ros.ros.conversions import pose_from_msg
from pose_node_client import assert_close, set_parameters
import pytest
import scenes
from sensor_msgs.msg import PointCloud2

pytestmark = pytest.mark.dds

NAME = 'lifecycle_pose_node'
BOARD = 'boards: {gate: {type: chessboard, columns: 9, rows: 6, square_m: 0.025}}\n'


class Manager:
    """A manager of the node."""

    def __init__(self, peer, **parameters):
        self.peer = peer
        self.poses = peer.subscribe(PoseStamped, f'{NAME}/pose')
        self.cloud = peer.publisher(PointCloud2, 'correspondences')
        self.node = peer.start(NAME, parameters=parameters)

    def change(self, transition):
        """Request a transition; return whether it succeeded."""
        request = {'transition': Transition(id=transition)}
        return self.peer.call(ChangeState, f'{NAME}/change_state', **request).success

    def state(self):
        """Return the label of the node's state."""
        return self.peer.call(GetState, f'{NAME}/get_state').current_state.label

    def is_subscribed(self):
        """Return whether the node subscribes."""
        return self.cloud.get_subscription_count() > 0

    def pose(self):
        """Publish points until a pose arrives; return it."""
        self.poses.clear()
        msg = scenes.board_cloud(1)
        self.peer.until(lambda: self.poses, meanwhile=lambda: self.cloud.publish(msg))
        return pose_from_msg(self.poses[-1])


def test_it_subscribes_while_it_is_active(peer):
    """Through all states and back."""
    override = {f'qos_overrides.{peer.namespace}/correspondences.subscription.depth': 9}
    manager = Manager(peer, **{'image.width_px': 640, 'image.height_px': 480} | override)
    assert manager.state() == 'unconfigured'
    assert not manager.change(Transition.TRANSITION_ACTIVATE)
    assert manager.change(Transition.TRANSITION_CONFIGURE)
    assert manager.state() == 'inactive'
    assert not manager.is_subscribed()
    for _ in range(2):
        assert manager.change(Transition.TRANSITION_ACTIVATE)
        assert_close(manager.pose(), scenes.CAMERA_FROM_BOARD)
        assert manager.change(Transition.TRANSITION_DEACTIVATE)
        peer.until(lambda: not manager.is_subscribed())
    assert manager.change(Transition.TRANSITION_CLEANUP)
    peer.until(lambda: peer.node.count_publishers(f'{peer.namespace}/{NAME}/pose') == 0)
    assert manager.change(Transition.TRANSITION_CONFIGURE)
    assert manager.change(Transition.TRANSITION_ACTIVATE)
    assert_close(manager.pose(), scenes.CAMERA_FROM_BOARD)
    assert not manager.change(Transition.TRANSITION_CLEANUP)
    assert manager.change(Transition.TRANSITION_ACTIVE_SHUTDOWN)
    assert manager.state() == 'finalized'
    assert manager.node.stop() == 0
    assert 'Traceback' not in manager.node.output
    assert 'unknown parameter' not in manager.node.output


def test_an_invalid_file_keeps_it_unconfigured(peer, tmp_path):
    """It logs the reason, and can be configured after the file was corrected."""
    path = tmp_path / 'board.yaml'
    path.write_text(BOARD.replace('columns', 'colums'))
    manager = Manager(peer, board_file=path)
    assert not manager.change(Transition.TRANSITION_CONFIGURE)
    assert manager.state() == 'unconfigured'
    assert f'not configured: {path}: boards.gate.colums: ' in manager.node.output
    set_parameters(peer, {'enabled': False}, node=NAME)
    path.write_text(BOARD)
    assert manager.change(Transition.TRANSITION_CONFIGURE)
    assert manager.state() == 'inactive'


def test_a_wrong_path_is_corrected_by_parameter(peer, tmp_path):
    """While the node is unconfigured; then the paths are read-only until cleanup."""
    right, wrong = tmp_path / 'board.yaml', tmp_path / 'bord.yaml'
    right.write_text(BOARD)
    manager = Manager(peer, board_file=wrong)
    assert not manager.change(Transition.TRANSITION_CONFIGURE)
    assert f'not configured: {wrong}: ' in manager.node.output
    set_parameters(peer, {'board_file': str(right), 'camera_name': 'front'}, node=NAME)
    assert manager.change(Transition.TRANSITION_CONFIGURE)
    reason = set_parameters(peer, {'board_file': str(wrong)}, node=NAME, rejected=True)
    assert reason == 'board_file: read-only once the node is configured, until cleanup'
    assert manager.change(Transition.TRANSITION_CLEANUP)
    set_parameters(peer, {'board_file': str(wrong)}, node=NAME)
    assert not manager.change(Transition.TRANSITION_CONFIGURE)
    assert manager.state() == 'unconfigured'
