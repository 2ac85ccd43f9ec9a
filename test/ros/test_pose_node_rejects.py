# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""pose_node over DDS: what it rejects, says, counts and survives."""

import numpy as np
from p4pfr_ros.ros.conversions import cloud_msg, pose_from_msg
import pytest
import scenes
from talk import assert_close, Talk

pytestmark = pytest.mark.dds


@pytest.fixture(scope='module')
def talk(module_peer):
    """One pose_node for the whole module: it has to survive all of its tests."""
    parameters = {'marker.size_m': scenes.MARKER_M}
    return Talk(module_peer, parameters=parameters).open()


BAD_POLYGONS = {
    'three points': (scenes.seen(scenes.ARUCO)[:3], 'point_count'),
    'five points': (np.vstack([scenes.seen(scenes.ARUCO), [[9.0, 9.0]]]), 'point_count'),
    'none': (np.empty((0, 2)), 'point_count'),
    'NaN': (np.full((4, 2), np.nan), 'not_finite'),
    'infinity': (np.full((4, 2), np.inf), 'not_finite'),
    'absurd': (np.full((4, 2), 1e30), 'out_of_range'),
    'all in one place': (np.full((4, 2), 100.0), 'no_solution'),
    'outside the picture': (scenes.seen(scenes.ARUCO) + 500.0, 'outside_picture'),
}


@pytest.mark.parametrize('name', BAD_POLYGONS)
def test_bad_corners_are_counted_and_the_next_good_ones_answered(talk, name):
    """Bad corners are rejected by cause; the node lives on."""
    points, cause = BAD_POLYGONS[name]
    _assert_rejected(talk, talk.corners, scenes.polygon(6, points), cause)


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
    # The first coordinate's exponent, all ones.
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
def test_a_bad_cloud_is_counted_and_the_next_good_one_answered(talk, spoil):
    """A bad cloud is rejected by cause; the node lives on."""
    msg = scenes.board_cloud(7)
    spoil(msg)
    _assert_rejected(talk, talk.cloud, msg, BAD_CLOUDS[spoil])


def test_points_on_a_line_are_counted(talk):
    """What the solver has no answer to is counted by the solver's reason."""
    line = np.column_stack([np.linspace(-0.1, 0.1, 8), np.zeros(8)])
    msg = cloud_msg(scenes.header(8), scenes.seen(line), line, np.arange(8))
    _assert_rejected(talk, talk.cloud, msg, 'collinear')


def test_a_cause_that_goes_on_is_said_again_with_its_count(talk):
    """A flood of bad messages makes a line every five seconds, not a line each."""
    for _ in range(20):
        talk.corners.publish(scenes.polygon(11, BAD_POLYGONS['three points'][0]))
    talk.peer.until(
        lambda: any('[point_count: ' in line and _count(line) > 10 for line in talk.lines()),
        meanwhile=lambda: talk.corners.publish(scenes.polygon(11, [])),
    )
    assert len([line for line in talk.lines() if '[point_count: ' in line]) <= 4


def _assert_rejected(talk, publisher, msg, cause):
    publisher.publish(msg)
    talk.peer.until(lambda: any(f'[{cause}: ' in line for line in talk.lines()))
    pose, _, _ = talk.ask(scenes.board_cloud(9))
    assert_close(pose_from_msg(pose), scenes.CAMERA_FROM_BOARD)
    assert not [p for p in talk.poses if p.header.stamp == msg.header.stamp]
    assert talk.node.process.poll() is None


def _count(line):
    return int(line.rsplit(': ', 1)[1].split()[0])
