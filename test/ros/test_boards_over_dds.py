# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""One pose_node with several boards: poses, markers and diagnostics by board name."""

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from geometry_msgs.msg import PoseArray, PoseStamped
import numpy as np
from p4pfr_ros.ros.conversions import cloud_msg, pose_from_msg
from pose_node_client import assert_close, set_parameters
import pytest
import scenes
from sensor_msgs.msg import PointCloud2
from visualization_msgs.msg import MarkerArray

pytestmark = pytest.mark.dds

OK = DiagnosticStatus.OK

BOARDS = """
boards:
  gate: {type: chessboard, columns: 9, rows: 6, square_m: 0.025}
  door: {type: marker, id: 3, size_m: 0.15, dictionary: DICT_APRILTAG_36h11}
"""


def _cloud(board, second):
    """Make the points of the board with an index."""
    ids = np.arange(len(scenes.GRID))
    return cloud_msg(scenes.header(second), scenes.project(scenes.GRID), scenes.GRID, ids, board)


class TwoBoards:
    """A node with two boards, and the messages that it publishes."""

    def __init__(self, peer, folder):
        (folder / 'boards.yaml').write_text(BOARDS)
        self.peer = peer
        self.poses = {
            n: peer.subscribe(PoseStamped, f'pose_node/{n}/pose') for n in ('gate', 'door')
        }
        self.diagnostics = peer.subscribe(DiagnosticArray, '/diagnostics')
        self.cloud = peer.publisher(PointCloud2, 'correspondences')
        self.node = peer.start(
            'pose_node',
            parameters={
                'board_file': folder / 'boards.yaml',
                'board_frame': 'left',
                'camera_name': 'left_camera',
                'image.width_px': scenes.SIZE[0],
                'image.height_px': scenes.SIZE[1],
                'intrinsics.mode': 'per_frame',
            },
        )
        self.pose_of(0, 0)

    def pose_of(self, board, second, name=None):
        """Publish the points of a board until its pose arrives; return it."""
        received = self.poses[name or ('gate', 'door')[board]]
        msg = _cloud(board, second)
        self.peer.until(
            lambda: received and received[-1].header == msg.header,
            meanwhile=lambda: self.cloud.publish(msg),
        )
        return received[-1]

    def status(self, condition):
        """Publish points until the status meets a condition; return status and values."""
        name = f'{self.peer.namespace[1:]}/pose_node: pose'

        def latest():
            statuses = [s for m in self.diagnostics for s in m.status if s.name == name]
            return next((s for s in reversed(statuses) if condition(s)), None)

        msg = _cloud(0, 20)
        self.peer.until(latest, meanwhile=lambda: self.cloud.publish(msg))
        return latest(), {value.key: value.value for value in latest().values}


@pytest.fixture(scope='module')
def two(module_peer, tmp_path_factory):
    """One node for the whole module."""
    return TwoBoards(module_peer, tmp_path_factory.mktemp('boards'))


@pytest.mark.parametrize(('board', 'name'), [(0, 'gate'), (1, 'door')])
def test_each_board_has_its_own_topic(two, board, name):
    """Nothing is published on the topic of the other."""
    other = two.poses['door' if name == 'gate' else 'gate']
    before = len(other)
    pose = two.pose_of(board, 10 + board)
    assert_close(pose_from_msg(pose), scenes.CAMERA_FROM_BOARD)
    assert len(other) == before


def test_a_board_that_is_not_in_the_file_is_rejected_and_counted(two):
    """In the log and on /diagnostics."""
    two.cloud.publish(_cloud(2, 1))
    _, values = two.status(lambda s: 'rejected.unknown_board' in str(s.values))
    assert values['rejected.unknown_board'] == '1'
    assert '[unknown_board: 1 so far]' in two.node.output


def test_diagnostics_describe_the_last_view(two):
    """With the camera's name; a disabled node is OK."""
    status, values = two.status(lambda s: s.level == OK and "'answered'" in str(s.values))
    assert status.hardware_id == 'left_camera'
    assert float(values['focal_px']) == pytest.approx(scenes.CAMERA.focal_px, rel=1e-3)
    assert float(values['inlier_ratio']) == 1.0
    assert 0.0 < float(values['latency_p50_ms']) <= float(values['latency_p99_ms'])
    set_parameters(two.peer, {'enabled': False})
    status, _ = two.status(lambda s: 'disabled' in s.message)
    assert status.level == OK
    set_parameters(two.peer, {'enabled': True})


def test_markers_and_alternatives_are_published(two):
    """Markers in namespaces of the board's frame."""
    markers = two.peer.subscribe(MarkerArray, 'pose_node/markers')
    others = two.peer.subscribe(PoseArray, 'pose_node/gate/alternatives')
    two.peer.until(lambda: markers and others, meanwhile=lambda: two.pose_of(0, 30))
    names = {marker.ns for marker in markers[-1].markers}
    assert names >= {'left/gate/outline', 'left/gate/axes', 'left/gate/points'}
    assert {m.header.frame_id for m in markers[-1].markers} == {'a_camera'}
    assert others[-1].header.frame_id == 'a_camera'


def test_without_tf2_ros_one_line_is_logged(two):
    """Poses are published on the other topics."""
    set_parameters(two.peer, {'publish_tf': True})
    for second in range(40, 43):
        two.pose_of(1, second)
    try:
        import tf2_ros  # noqa: F401
    except ImportError:
        lines = [line for line in two.node.output.splitlines() if 'tf2_ros is not inst' in line]
        assert len(lines) == 1
