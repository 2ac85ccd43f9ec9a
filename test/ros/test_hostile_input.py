# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""Invalid messages over DDS: rejected and counted, or estimated correctly; never fatal."""

from builtin_interfaces.msg import Time
from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import PolygonStamped, PoseWithCovarianceStamped
import hostile
import numpy as np
from p4pfr_ros import Pose
from p4pfr_ros.ros.conversions import cloud_msg, pose_from_msg
from pose_node_client import assert_close
import pytest
import scenes
from sensor_msgs.msg import CameraInfo, PointCloud2
from std_msgs.msg import Header

DEPTH = 500
VIEWS, CLOUDS = 60, 1000

# Tolerance of poses with a camera that was calibrated from some views with 0.2 px noise.
CLOSE = {'atol_m': 3e-3, 'atol_rad': 0.01}


class CalibratedNode:
    """A calibrated pose_node with reliable topics, and the messages that it publishes."""

    def __init__(self, peer):
        self.peer = peer
        self.poses = peer.subscribe(
            PoseWithCovarianceStamped, 'pose_node/pose_with_covariance', 5000
        )
        self._statuses = peer.subscribe(DiagnosticArray, '/diagnostics')
        self._corners = peer.publisher(PolygonStamped, 'corners', DEPTH)
        self._cloud = peer.publisher(PointCloud2, 'correspondences', DEPTH)
        self._camera_info = peer.publisher(CameraInfo, 'camera_info', DEPTH)
        publishers = (self._corners, self._cloud, self._camera_info)
        parameters = {'marker.size_m': scenes.MARKER_M}
        for publisher in publishers:
            prefix = f'qos_overrides.{publisher.topic_name}.subscription'
            parameters |= {f'{prefix}.reliability': 'reliable', f'{prefix}.depth': DEPTH}
        self._node = peer.start('pose_node', parameters=parameters)
        peer.until(lambda: all(p.get_subscription_count() for p in publishers))
        self._camera_info.publish(scenes.camera_info())
        self._second = 2
        peer.until(lambda: self.poses, meanwhile=lambda: self.send(scenes.board_cloud(1)))
        for view in _views():
            self.send(view)

    def send(self, msg):
        """Publish a message on its topic."""
        publishers = {PolygonStamped: self._corners, PointCloud2: self._cloud}
        publishers.get(type(msg), self._camera_info).publish(msg)

    def send_valid(self):
        """Send a valid message; return the second of its stamp, which is unique."""
        self._second += 1
        self.send(scenes.board_cloud(self._second))
        return self._second

    def values(self):
        """Return the numbers on /diagnostics after all messages were processed."""
        second = self.send_valid()
        self.peer.until(lambda: self.is_estimated(second))
        self._statuses.clear()
        self.peer.until(self._latest)
        return self._latest()

    def rejected(self, values=None):
        """Return the numbers of rejected messages on /diagnostics, by cause."""
        items = (values or self._latest()).items()
        return {k.split('.')[1]: int(v) for k, v in items if k.startswith('rejected.')}

    def is_estimated(self, second):
        """Return whether the pose of the valid message with that stamp arrived; check it."""
        poses = [p for p in self.poses if p.header == scenes.header(second)]
        for pose in poses:
            assert_close(pose_from_msg(pose.pose), scenes.CAMERA_FROM_BOARD, **CLOSE)
        return len(poses) == 1

    def is_running(self):
        """Return whether the process is running."""
        return self._node.process.poll() is None

    def _latest(self):
        name = f'{self.peer.namespace}/pose_node: pose'[1:]
        ours = [s for array in self._statuses for s in array.status if s.name == name]
        return {v.key: v.value for v in ours[-1].values} if ours else {}


def _views():
    """Yield views of the board from different directions."""
    rng = np.random.default_rng(0)
    for _ in range(VIEWS):
        motion = Pose.from_rotation_vector(rng.normal(0.0, 0.25, 3), rng.normal(0.0, 0.02, 3))
        image_points = scenes.project(scenes.GRID, scenes.CAMERA_FROM_BOARD @ motion)
        image_points += rng.normal(0.0, 0.2, image_points.shape)
        yield cloud_msg(scenes.header(2), image_points, scenes.GRID, np.arange(len(scenes.GRID)))


@pytest.fixture(scope='module')
def node(module_peer):
    """One pose_node for the whole module, which must survive all tests."""
    return CalibratedNode(module_peer)


def _polygon(count):
    corners = np.vstack([scenes.project(scenes.ARUCO), [[9.0, 9.0]]])[:count]
    return scenes.polygon(900, corners)


def _cloud_of(count):
    board = np.random.default_rng(0).uniform(-0.1, 0.1, (count, 2))
    return cloud_msg(scenes.header(900), scenes.project(board), board, np.arange(count))


def _with_a_nan(msg):
    msg.data[6], msg.data[7] = 0xF8, 0x7F
    return msg


def _renamed(msg):
    msg.fields[3].name = 'z'
    return msg


def _of_integers(msg):
    msg.fields[0].datatype = 5
    return msg


REJECTED = {
    'no corners': (_polygon(0), 'point_count'),
    'three corners': (_polygon(3), 'point_count'),
    'five corners': (_polygon(5), 'point_count'),
    'a NaN corner': (scenes.polygon(900, np.full((4, 2), np.nan)), 'not_finite'),
    'a cloud of three points': (_cloud_of(3), 'point_count'),
    'a cloud of 100,000 points': (_cloud_of(100_000), 'point_count'),
    'a NaN coordinate': (_with_a_nan(_cloud_of(9)), 'not_finite'),
    'a missing field': (_renamed(_cloud_of(9)), 'fields'),
    'a field of integers': (_of_integers(_cloud_of(9)), 'fields'),
    'an image without a size': (scenes.camera_info((0, 480)), 'camera_info'),
    'an image that is too large': (scenes.camera_info((640, 2**32 - 1)), 'camera_info'),
}


@pytest.mark.dds
def test_invalid_messages_are_counted_by_cause_and_valid_ones_are_estimated(node):
    """A valid message before, between and after them."""
    before, seconds = node.rejected(node.values()), [node.send_valid()]
    for msg, _ in REJECTED.values():
        node.send(msg)
        seconds.append(node.send_valid())
    causes = [cause for _, cause in REJECTED.values()]
    expected = {c: before.get(c, 0) + causes.count(c) for c in {*before, *causes}}
    counted = node.rejected(node.values())
    while counted != expected and sum(counted.values()) < sum(expected.values()):
        counted = node.rejected(node.values())  # messages of other topics may come later
    assert counted == expected
    assert all(node.is_estimated(second) for second in seconds)
    assert not [p for p in node.poses if p.header.stamp.sec == 900]


@pytest.mark.dds
def test_an_unusual_layout_is_estimated(node):
    """Big-endian, padded, organised and single precision."""
    layout = np.dtype(
        {
            'names': ['v', 'u', 'board_y', 'board_x'],
            'formats': ['>f4'] * 4,
            'offsets': [3, 9, 20, 30],
            'itemsize': 41,
        }
    )
    rows = np.zeros((5, 6), layout)
    columns = np.hstack([scenes.project(scenes.GRID), scenes.GRID]).T.reshape(4, 5, 6)
    rows['u'], rows['v'], rows['board_x'], rows['board_y'] = columns
    msg = scenes.board_cloud(800)
    msg.height, msg.width, msg.point_step, msg.row_step = 5, 6, 41, 6 * 41 + 11
    msg.is_bigendian, msg.is_dense = True, True
    msg.fields = msg.fields[:4]
    for field in msg.fields:
        field.offset, field.datatype = layout.fields[field.name][1], 7
    msg.data = [byte for row in rows for byte in row.tobytes() + b'\xff' * 11]
    node.send(msg)
    node.peer.until(lambda: node.is_estimated(800))


@pytest.mark.dds
@pytest.mark.parametrize('stamp', [(700, 0), (3, 5), (0, 0), (-1, 0), (-(2**31), 2**32 - 1)])
def test_any_stamp_is_valid(node, stamp):
    """Backwards, before the epoch, or zero: the pose has the same stamp."""
    header = Header(stamp=Time(sec=stamp[0], nanosec=stamp[1]), frame_id='a_camera')
    msg = scenes.board_cloud(0)
    msg.header = header
    node.send(msg)
    node.peer.until(lambda: [p for p in node.poses if p.header == header] or not node.is_running())
    assert node.is_running()


@pytest.mark.dds
def test_a_temporary_change_of_the_image_size(node):
    """Points outside the smaller image are counted; afterwards poses are estimated again."""
    node.send(scenes.camera_info((320, 240)))
    node.peer.until(
        lambda: 'outside_image' in node.rejected(),
        meanwhile=lambda: node.send(scenes.board_cloud(901)),
    )
    node.send(scenes.camera_info())
    seconds = [node.send_valid()]
    node.peer.until(
        lambda: node.is_estimated(seconds[-1]), meanwhile=lambda: seconds.append(node.send_valid())
    )


@pytest.mark.dds
def test_a_thousand_fuzzed_clouds_are_each_estimated_or_counted(node):
    """None is lost, none is fatal, and every valid one is estimated."""
    before, rng, seconds = node.values(), np.random.default_rng(9), []
    for i in range(CLOUDS):
        node.send(hostile.fuzzed_cloud(rng, scenes.header(10_000 + i)))
        if i % 50 == 0:
            seconds.append(node.send_valid())
            node.peer.until(lambda: node.is_estimated(seconds[-1]) or not node.is_running())
    after = node.values()
    assert int(after['received']) - int(before['received']) == CLOUDS + len(seconds) + 1
    estimated = int(after['answered']) - int(before['answered'])
    counts = [sum(node.rejected(values).values()) for values in (before, after)]
    assert 0 < counts[1] - counts[0] < CLOUDS
    assert estimated + counts[1] - counts[0] == CLOUDS + len(seconds) + 1
    assert all(node.is_estimated(second) for second in seconds)
