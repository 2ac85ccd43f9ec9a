# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""PointCloud2 to correspondences and back."""

from array import array

import numpy as np
from p4pfr_ros.ros.conversions import cloud_msg, correspondences_from_cloud
from p4pfr_ros.ros.runtime.rejections import Rejected
import pytest
import scenes
from sensor_msgs.msg import PointCloud2, PointField

RNG = np.random.default_rng(5)
IMAGE, BOARD = RNG.uniform(0, 640, (12, 2)), RNG.uniform(-0.2, 0.2, (12, 2))
IDS = RNG.permutation(12)


def test_a_cloud_keeps_its_correspondences_bit_for_bit():
    """Round trip without rounding."""
    points = correspondences_from_cloud(cloud_msg(scenes.header(1), IMAGE, BOARD, IDS))
    np.testing.assert_array_equal(points.image_points, IMAGE)
    np.testing.assert_array_equal(points.board_points, BOARD)
    np.testing.assert_array_equal(points.ids, IDS)


@pytest.mark.parametrize('shape', [(1, 12), (3, 4)], ids=['in a row', 'organised'])
@pytest.mark.parametrize('row_padding', [0, 7])
@pytest.mark.parametrize('point_padding', [0, 5])
@pytest.mark.parametrize('order', '<>')
@pytest.mark.parametrize('size', [4, 8])
def test_any_layout_of_a_cloud_is_read(size, order, point_padding, row_padding, shape):
    """Any field order, offsets, padding, byte order and shape."""
    names = ['board_y', 'id', 'u', 'board_x', 'v']
    formats = ['u1' if n == 'id' else f'{order}f{size}' for n in names]
    offsets = [3 + i * (size + 2) for i in range(5)]
    step = offsets[-1] + size + point_padding
    layout = np.dtype({'names': names, 'formats': formats, 'offsets': offsets, 'itemsize': step})
    rows = np.zeros(shape, layout)
    for name, values in zip(
        ['u', 'v', 'board_x', 'board_y', 'id'], [*IMAGE.T, *BOARD.T, IDS], strict=False
    ):
        rows[name] = values.reshape(shape)
    data = b''.join(row.tobytes() + b'\xff' * row_padding for row in rows)
    msg = PointCloud2(height=shape[0], width=shape[1], is_dense=True, is_bigendian=order == '>')
    msg.point_step, msg.row_step = step, shape[1] * step + row_padding
    kinds = {4: PointField.FLOAT32, 8: PointField.FLOAT64}
    msg.fields = [
        PointField(name=n, offset=o, count=1, datatype=2 if n == 'id' else kinds[size])
        for n, o in zip(names, offsets, strict=True)
    ]
    msg.data = array('B', data)
    points = correspondences_from_cloud(msg)
    exact = {'rtol': 0, 'atol': 0} if size == 8 else {'rtol': 1e-7}
    np.testing.assert_allclose(points.image_points, IMAGE, **exact)
    np.testing.assert_allclose(points.board_points, BOARD, **exact)
    np.testing.assert_array_equal(points.ids, IDS)


def test_the_id_is_optional():
    """Without ids, points are numbered in their order."""
    msg = cloud_msg(scenes.header(1), IMAGE, BOARD, IDS)
    msg.fields = [f for f in msg.fields if f.name != 'id']
    np.testing.assert_array_equal(correspondences_from_cloud(msg).ids, np.arange(12))


@pytest.mark.parametrize('board', [0, 3])
def test_the_board_index_is_an_optional_field(board):
    """A single board has no such field."""
    msg = cloud_msg(scenes.header(1), IMAGE, BOARD, IDS, board)
    assert [f.name for f in msg.fields] == ['u', 'v', 'board_x', 'board_y', 'id', 'board']
    points = correspondences_from_cloud(msg)
    assert points.board == board
    np.testing.assert_array_equal(points.image_points, IMAGE)
    np.testing.assert_array_equal(points.ids, IDS)
    alone = cloud_msg(scenes.header(1), IMAGE, BOARD, IDS)
    assert 'board' not in [f.name for f in alone.fields]
    assert correspondences_from_cloud(alone).board is None


def test_a_cloud_has_points_of_one_board():
    """Points that were not detected do not count."""
    clouds = [cloud_msg(scenes.header(1), IMAGE, BOARD, IDS, board) for board in (2, 5)]
    step = clouds[0].point_step
    mixed = clouds[0]
    mixed.data[-step:] = clouds[1].data[-step:]
    rejected = correspondences_from_cloud(mixed)
    assert rejected.cause == 'boards'
    assert rejected.reason.endswith('expected points of one board, got points of boards 2, 5')
    mixed.data[-step : 8 - step] = array('B', np.array([np.nan]).tobytes())
    mixed.is_dense = False
    points = correspondences_from_cloud(mixed)
    assert (points.board, len(points.ids)) == (2, 11)


def test_nan_points_of_a_cloud_that_is_not_dense_are_left_out():
    """With is_dense, NaN is an error."""
    image = IMAGE.copy()
    image[[2, 5]] = np.nan
    msg = cloud_msg(scenes.header(1), image, BOARD, IDS)
    assert correspondences_from_cloud(msg).cause == 'not_finite'
    msg.is_dense = False
    points = correspondences_from_cloud(msg)
    np.testing.assert_array_equal(points.ids, np.delete(IDS, [2, 5]))
    np.testing.assert_array_equal(points.image_points, np.delete(IMAGE, [2, 5], axis=0))


def _set(**fields):
    def spoil(msg):
        for name, value in fields.items():
            setattr(msg, name, value)

    return spoil


def _field(index, **values):
    def spoil(msg):
        for name, value in values.items():
            setattr(msg.fields[index], name, value)

    return spoil


def _far_away(msg):
    _set(point_step=2**32 - 1)(msg)
    _field(3, offset=2**31)(msg)


@pytest.mark.parametrize(
    ('spoil', 'cause'),
    [
        (_set(fields=[]), 'fields'),
        (_field(0, name='x'), 'fields'),
        (_field(2, datatype=PointField.INT32), 'fields'),
        (_field(2, datatype=0), 'fields'),
        (_field(4, datatype=PointField.FLOAT32), 'fields'),
        (_field(4, datatype=99), 'fields'),
        (_field(5, datatype=PointField.FLOAT64), 'fields'),
        (_field(5, datatype=0), 'fields'),
        (_field(5, offset=37), 'layout'),
        (_field(3, offset=33), 'layout'),
        (_field(3, offset=2**32 - 1), 'layout'),
        (_field(4, offset=37), 'layout'),
        (_set(point_step=0), 'layout'),
        (_set(point_step=2**32 - 1), 'layout'),
        (_far_away, 'layout'),
        (_set(height=2), 'truncated'),
        (_set(height=2, row_step=1), 'layout'),
        (_set(height=2**32 - 1), 'truncated'),
        (_set(width=2**32 - 1), 'truncated'),
        (_set(width=13), 'truncated'),
        (_set(width=3), 'point_count'),
        (_set(width=0), 'point_count'),
        (_set(height=0), 'point_count'),
        (_set(data=[]), 'truncated'),
    ],
)
def test_an_invalid_cloud_is_rejected_with_cause_and_reason(spoil, cause):
    """The reason is a sentence that names the topic."""
    msg = cloud_msg(scenes.header(1), IMAGE, BOARD, IDS, board=1)
    spoil(msg)
    rejected = correspondences_from_cloud(msg)
    assert isinstance(rejected, Rejected)
    assert rejected.cause == cause
    assert rejected.reason.startswith('correspondences: ')


def test_fuzzed_clouds_never_raise():
    """1000 clouds with random fields are converted or rejected."""
    rng = np.random.default_rng(11)
    numbers = [0, 1, 3, 7, 8, 9, 12, 16, 32, 36, 39, 40, 100, 480, 2**31, 2**32 - 1]
    converted = 0
    for _ in range(1000):
        msg = cloud_msg(scenes.header(1), IMAGE, BOARD, IDS, board=1)
        for name in rng.choice(['height', 'width', 'point_step', 'row_step'], 1):
            setattr(msg, name, int(rng.choice(numbers)))
        field = msg.fields[rng.integers(6)]
        field.offset, field.datatype = int(rng.choice(numbers)), int(rng.integers(0, 10))
        msg.is_bigendian, msg.is_dense = bool(rng.integers(2)), bool(rng.integers(2))
        msg.data = msg.data[: int(rng.choice([0, 1, 40, 479, 480, 480, 480]))]
        converted += not isinstance(correspondences_from_cloud(msg), Rejected)
    assert 0 < converted < 1000
