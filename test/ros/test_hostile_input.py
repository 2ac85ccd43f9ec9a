# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""What nobody should send: rejected with its cause counted, or answered rightly; never fatal."""

from builtin_interfaces.msg import Time
from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import PolygonStamped, PoseWithCovarianceStamped
import hostile
import numpy as np
from p4pfr_ros import Pose
from p4pfr_ros.ros.conversions import cloud_msg, pose_from_msg
import pytest
import scenes
from sensor_msgs.msg import CameraInfo, PointCloud2
from std_msgs.msg import Header
from talk import assert_close

DEPTH = 500
VIEWS, CLOUDS = 60, 1000

# Of the poses by a camera that some views with a noise of 0.2 px have calibrated.
CLOSE = {'atol_m': 3e-3, 'atol_rad': 0.01}


class Target:
    """A pose_node in its default mode, calibrated, and what it says; no message is lost."""

    def __init__(self, peer):
        self.peer = peer
        self.poses = peer.listen(PoseWithCovarianceStamped, 'pose_node/pose_with_covariance', 5000)
        self._statuses = peer.listen(DiagnosticArray, '/diagnostics')
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

    def good(self):
        """Send a good message; return its stamp's second, different each time."""
        self._second += 1
        self.send(scenes.board_cloud(self._second))
        return self._second

    def values(self):
        """Return the numbers that /diagnostics has after all that was sent."""
        second = self.good()
        self.peer.until(lambda: self.answered(second))
        self._statuses.clear()
        self.peer.until(self._latest)
        return self._latest()

    def rejected(self, values=None):
        """Return how many messages were rejected, by cause; so far as /diagnostics has said."""
        items = (values or self._latest()).items()
        return {k.split('.')[1]: int(v) for k, v in items if k.startswith('rejected.')}

    def answered(self, second):
        """Return whether the good message with that stamp has been answered, and rightly."""
        found = [p for p in self.poses if p.header == scenes.header(second)]
        for answer in found:
            assert_close(pose_from_msg(answer.pose), scenes.CAMERA_FROM_BOARD, **CLOSE)
        return len(found) == 1

    def lives(self):
        """Return whether the process still runs."""
        return self._node.process.poll() is None

    def _latest(self):
        name = f'{self.peer.namespace}/pose_node: pose'[1:]
        ours = [s for array in self._statuses for s in array.status if s.name == name]
        return {v.key: v.value for v in ours[-1].values} if ours else {}


def _views():
    """Look at the board from here and there."""
    rng = np.random.default_rng(0)
    for _ in range(VIEWS):
        turn = Pose.from_rotation_vector(rng.normal(0.0, 0.25, 3), rng.normal(0.0, 0.02, 3))
        seen_px = scenes.seen(scenes.GRID, scenes.CAMERA_FROM_BOARD @ turn)
        seen_px += rng.normal(0.0, 0.2, seen_px.shape)
        yield cloud_msg(scenes.header(2), seen_px, scenes.GRID, np.arange(len(scenes.GRID)))


@pytest.fixture(scope='module')
def target(module_peer):
    """One pose_node for the whole module: it has to survive all of its tests."""
    return Target(module_peer)


def _polygon(count):
    corners = np.vstack([scenes.seen(scenes.ARUCO), [[9.0, 9.0]]])[:count]
    return scenes.polygon(900, corners)


def _cloud_of(count):
    board = np.random.default_rng(0).uniform(-0.1, 0.1, (count, 2))
    return cloud_msg(scenes.header(900), scenes.seen(board), board, np.arange(count))


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
    'a corner that is no number': (scenes.polygon(900, np.full((4, 2), np.nan)), 'not_finite'),
    'a cloud of three points': (_cloud_of(3), 'point_count'),
    'a cloud of a hundred thousand': (_cloud_of(100_000), 'point_count'),
    'a coordinate that is no number': (_with_a_nan(_cloud_of(9)), 'not_finite'),
    'a field that is missing': (_renamed(_cloud_of(9)), 'fields'),
    'a field of integers': (_of_integers(_cloud_of(9)), 'fields'),
    'a picture without a size': (scenes.camera_info((0, 480)), 'camera_info'),
    'a picture of an absurd size': (scenes.camera_info((640, 2**32 - 1)), 'camera_info'),
}


@pytest.mark.dds
def test_each_is_counted_by_its_cause_and_the_good_ones_between_are_answered(target):
    """One bad message, one count; a good one before, between and after, one answer each."""
    before, seconds = target.rejected(target.values()), [target.good()]
    for msg, _ in REJECTED.values():
        target.send(msg)
        seconds.append(target.good())
    causes = [cause for _, cause in REJECTED.values()]
    expected = {c: before.get(c, 0) + causes.count(c) for c in {*before, *causes}}
    assert target.rejected(target.values()) == expected
    assert all(target.answered(second) for second in seconds)
    assert not [p for p in target.poses if p.header.stamp.sec == 900]


@pytest.mark.dds
def test_unusual_layouts_over_the_wire_are_answered_rightly(target):
    """Big-endian, padded, organised and of single precision, all at once."""
    layout = np.dtype(
        {
            'names': ['v', 'u', 'board_y', 'board_x'],
            'formats': ['>f4'] * 4,
            'offsets': [3, 9, 20, 30],
            'itemsize': 41,
        }
    )
    rows = np.zeros((5, 6), layout)
    columns = np.hstack([scenes.seen(scenes.GRID), scenes.GRID]).T.reshape(4, 5, 6)
    rows['u'], rows['v'], rows['board_x'], rows['board_y'] = columns
    msg = scenes.board_cloud(800)
    msg.height, msg.width, msg.point_step, msg.row_step = 5, 6, 41, 6 * 41 + 11
    msg.is_bigendian, msg.is_dense = True, True
    msg.fields = msg.fields[:4]
    for field in msg.fields:
        field.offset, field.datatype = layout.fields[field.name][1], 7
    msg.data = [byte for row in rows for byte in row.tobytes() + b'\xff' * 11]
    target.send(msg)
    target.peer.until(lambda: target.answered(800))


@pytest.mark.dds
@pytest.mark.parametrize('stamp', [(700, 0), (3, 5), (0, 0), (-1, 0), (-(2**31), 2**32 - 1)])
def test_a_stamp_may_be_any(target, stamp):
    """Backwards, before the epoch, or no time at all: the answer has it as it came."""
    header = Header(stamp=Time(sec=stamp[0], nanosec=stamp[1]), frame_id='a_camera')
    msg = scenes.board_cloud(0)
    msg.header = header
    target.send(msg)
    target.peer.until(
        lambda: [p for p in target.poses if p.header == header] or not target.lives()
    )
    assert target.lives()


@pytest.mark.dds
def test_a_picture_that_changes_its_size_and_back(target):
    """Points that cannot be in a picture of the new size are counted; then all is as it was."""
    target.send(scenes.camera_info((320, 240)))
    target.peer.until(
        lambda: 'outside_picture' in target.rejected(),
        meanwhile=lambda: target.send(scenes.board_cloud(901)),
    )
    target.send(scenes.camera_info())
    seconds = [target.good()]
    target.peer.until(
        lambda: target.answered(seconds[-1]), meanwhile=lambda: seconds.append(target.good())
    )


@pytest.mark.dds
def test_a_thousand_fuzzed_clouds_are_each_answered_or_counted(target):
    """None is lost, none is fatal, and every good one among them has its answer."""
    before, rng, seconds = target.values(), np.random.default_rng(9), []
    for i in range(CLOUDS):
        target.send(hostile.fuzzed_cloud(rng, scenes.header(10_000 + i)))
        if i % 50 == 0:
            seconds.append(target.good())
            target.peer.until(lambda: target.answered(seconds[-1]) or not target.lives())
    after = target.values()
    assert int(after['received']) - int(before['received']) == CLOUDS + len(seconds) + 1
    answered = int(after['answered']) - int(before['answered'])
    counts = [sum(target.rejected(values).values()) for values in (before, after)]
    assert 0 < counts[1] - counts[0] < CLOUDS
    assert answered + counts[1] - counts[0] == CLOUDS + len(seconds) + 1
    assert all(target.answered(second) for second in seconds)
