# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""pose_node over DDS: rejected messages, their log lines and counts."""

import numpy as np
from p4pfr_ros.ros.conversions import cloud_msg, pose_from_msg
from pose_node_client import assert_close, PoseNodeClient
import pytest
import scenes

pytestmark = pytest.mark.dds


@pytest.fixture(scope='module')
def client(module_peer):
    """One pose_node for the whole module, which must survive all tests."""
    parameters = {'marker.size_m': scenes.MARKER_M}
    return PoseNodeClient(module_peer, parameters=parameters).wait_ready()


BAD_POLYGONS = {
    'three points': (scenes.project(scenes.ARUCO)[:3], 'point_count'),
    'five points': (np.vstack([scenes.project(scenes.ARUCO), [[9.0, 9.0]]]), 'point_count'),
    'none': (np.empty((0, 2)), 'point_count'),
    'NaN': (np.full((4, 2), np.nan), 'not_finite'),
    'infinity': (np.full((4, 2), np.inf), 'not_finite'),
    'too large': (np.full((4, 2), 1e30), 'out_of_range'),
    'coincident': (np.full((4, 2), 100.0), 'no_solution'),
    'mirrored': (scenes.project(scenes.ARUCO)[::-1], 'seen_from_behind'),
    'outside the image': (scenes.project(scenes.ARUCO) + 500.0, 'outside_image'),
}


@pytest.mark.parametrize('name', BAD_POLYGONS)
def test_invalid_corners_are_rejected(client, name):
    """They are counted by cause, and the next valid message is estimated."""
    points, cause = BAD_POLYGONS[name]
    _assert_rejected(client, client.corners, scenes.polygon(6, points), cause)


def _field_missing(msg):
    msg.fields = [f for f in msg.fields if f.name != 'board_y']


def _field_of_integers(msg):
    msg.fields[0].datatype = 5


def _field_beyond(msg):
    msg.fields[1].offset = 1000


def _truncated(msg):
    msg.data = msg.data[:-1]


def _more_points_than_data(msg):
    msg.height = 2**32 - 1


def _rows_too_short(msg):
    msg.height, msg.row_step = 2, 8


def _empty(msg):
    msg.width = msg.row_step = 0
    msg.data = []


def _not_a_number(msg):
    # All bits of the exponent of the first coordinate.
    msg.data[6], msg.data[7] = 0xF8, 0x7F


BAD_CLOUDS = {
    _field_missing: 'fields',
    _field_of_integers: 'fields',
    _field_beyond: 'layout',
    _truncated: 'truncated',
    _more_points_than_data: 'truncated',
    _rows_too_short: 'layout',
    _empty: 'point_count',
    _not_a_number: 'not_finite',
}


@pytest.mark.parametrize('spoil', BAD_CLOUDS, ids=lambda f: f.__name__)
def test_an_invalid_cloud_is_rejected(client, spoil):
    """It is counted by cause, and the next valid message is estimated."""
    msg = scenes.board_cloud(7)
    spoil(msg)
    _assert_rejected(client, client.cloud, msg, BAD_CLOUDS[spoil])


def test_collinear_points_are_rejected(client):
    """The cause is the status of the estimate."""
    line = np.column_stack([np.linspace(-0.1, 0.1, 8), np.zeros(8)])
    msg = cloud_msg(scenes.header(8), scenes.project(line), line, np.arange(8))
    _assert_rejected(client, client.cloud, msg, 'collinear')


def test_a_mirrored_cloud_is_rejected(client):
    """No pose of the back of a printed board is published."""
    mirrored = scenes.GRID * [-1.0, 1.0]
    ids = np.arange(len(mirrored))
    msg = cloud_msg(scenes.header(8), scenes.project(scenes.GRID), mirrored, ids)
    _assert_rejected(client, client.cloud, msg, 'seen_from_behind')


def test_a_repeated_cause_is_logged_again_with_its_count(client):
    """Every five seconds, not for each message."""
    for _ in range(20):
        client.corners.publish(scenes.polygon(11, BAD_POLYGONS['three points'][0]))
    client.peer.until(
        lambda: any('[point_count: ' in line and _count(line) > 10 for line in client.lines()),
        meanwhile=lambda: client.corners.publish(scenes.polygon(11, [])),
    )
    assert len([line for line in client.lines() if '[point_count: ' in line]) <= 4


def _assert_rejected(client, publisher, msg, cause):
    publisher.publish(msg)
    client.peer.until(lambda: any(f'[{cause}: ' in line for line in client.lines()))
    pose, _, _ = client.estimate(scenes.board_cloud(9))
    assert_close(pose_from_msg(pose), scenes.CAMERA_FROM_BOARD)
    assert not [p for p in client.poses if p.header.stamp == msg.header.stamp]
    assert client.node.process.poll() is None


def _count(line):
    return int(line.rsplit(': ', 1)[1].split()[0])
