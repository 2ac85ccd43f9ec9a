# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""Invalid messages; the same seed gives the same messages."""

from array import array
import struct

import numpy as np
from p4pfr_ros.ros.conversions import cloud_msg
import scenes
from sensor_msgs.msg import PointField

_NUMBERS = [0, 1, 2, 3, 4, 7, 8, 9, 12, 16, 29, 30, 31, 32, 36, 39, 40, 41, 80, 1080, 1200]
_NUMBERS += [2**31 - 1, 2**31, 2**32 - 1]
_NAMES = ['u', 'v', 'board_x', 'board_y', 'id', 'board', 'x', '', 'intensity', 'é' * 60]

_FORMATS = {1: 'b', 2: 'B', 3: 'h', 4: 'H', 5: 'i', 6: 'I', 7: 'f', 8: 'd'}


def fuzzed_cloud(rng, header):
    """Make a valid cloud of the 30 board points and apply one to four random changes."""
    image_points, count = scenes.project(scenes.GRID), len(scenes.GRID)
    board = None if rng.integers(2) else 0
    msg = cloud_msg(header, image_points, scenes.GRID, np.arange(count), board)
    changes = [_shape, _field_numbers, _field_names, _data, _bytes, _flags]
    for _ in range(rng.integers(1, 5)):
        changes[rng.integers(len(changes))](rng, msg)
    return msg


_SIZES = [0, 1, 2, 3, 32, 640, 480, 65535, 65536, 2**31 - 1, 2**31, 2**32 - 1]
_REALS = [0.0, 1.0, -1.0, 520.0, 319.5, 1e-300, 1e-5, 1e6, 1e300, np.nan, np.inf, -np.inf]
_MODELS = ['plumb_bob', 'rational_polynomial', 'equidistant', 'division', 'fisheye', '']


def fuzzed_camera_info(rng):
    """Make a camera_info with up to four random changes; every second one is calibrated."""
    msg = scenes.camera_info()
    numbers = [(msg, name) for name in ('width', 'height', 'binning_x', 'binning_y')]
    numbers += [(msg.roi, name) for name in ('x_offset', 'y_offset', 'width', 'height')]
    for _ in range(rng.integers(5)):
        where, name = numbers[rng.integers(len(numbers))]
        setattr(where, name, int(rng.choice(_SIZES)))
    if rng.integers(2):
        k = np.array([520.0, 0.0, 319.5, 0.0, 520.0, 239.5, 0.0, 0.0, 1.0])
        k[rng.integers(9, size=rng.integers(3))] = rng.choice(_REALS)
        msg.k, msg.distortion_model = k, str(rng.choice(_MODELS))
        d = 0.01 * rng.standard_normal(rng.choice([0, 1, 4, 5, 8, 14, 100]))
        d[rng.random(len(d)) < 0.1] = rng.choice(_REALS)
        msg.d = d.tolist()
    return msg


def fuzzed_polygon(rng, second):
    """Make corners of a marker: noisy, permuted, collinear, coincident, or not four."""
    good = scenes.project(scenes.ARUCO)
    corners = [
        good + rng.normal(0.0, rng.choice([0.3, 30.0]), (4, 2)),
        rng.permutation(good),
        good[0] + np.outer(np.arange(4), [30.0, 20.0]),
        np.repeat(good[:1], 4, axis=0) + 1e-3 * rng.integers(2) * rng.normal(size=(4, 2)),
        good[[0, 0, 2, 3]],
        rng.uniform(-5.0, 700.0, (4, 2)),
        good * rng.choice([1e-9, 1e9, np.nan, np.inf]),
        np.repeat(good, 2, axis=0)[: rng.integers(9)],
    ]
    return scenes.polygon(second, corners[rng.integers(len(corners))])


def _shape(rng, msg):
    name = ['height', 'width', 'point_step', 'row_step'][rng.integers(4)]
    setattr(msg, name, _number(rng))


def _field_numbers(rng, msg):
    if msg.fields:
        field = msg.fields[rng.integers(len(msg.fields))]
        name = ['offset', 'datatype', 'count'][rng.integers(3)]
        setattr(field, name, int(rng.integers(0, 12)) if name == 'datatype' else _number(rng))


def _field_names(rng, msg):
    fields = list(msg.fields)
    if not fields or rng.integers(3) == 0:
        offset = _number(rng)
        fields.append(PointField(name=_name(rng), offset=offset, datatype=8, count=1))
    elif rng.integers(2):
        fields.pop(rng.integers(len(fields)))
    else:
        fields[rng.integers(len(fields))].name = _name(rng)
    msg.fields = fields


def _data(rng, msg):
    length = int(rng.integers(0, len(msg.data) + 1))
    msg.data = msg.data[:length] if rng.integers(2) else msg.data + msg.data[:length]


def _bytes(rng, msg):
    """Overwrite some bytes with ones, which makes NaN, or with random bytes."""
    if len(msg.data):
        start = int(rng.integers(len(msg.data)))
        end = min(len(msg.data), start + int(rng.integers(1, 64)))
        written = b'\xff' * (end - start) if rng.integers(2) else rng.bytes(end - start)
        msg.data[start:end] = array('B', written)


def _flags(rng, msg):
    msg.is_bigendian, msg.is_dense = bool(rng.integers(2)), bool(rng.integers(2))


def _number(rng):
    return int(_NUMBERS[rng.integers(len(_NUMBERS))])


def _name(rng):
    return _NAMES[rng.integers(len(_NAMES))]


def read_slowly(msg):
    """Return the points (N, 4) u, v, board_x, board_y of a cloud, read number by number."""
    fields = {field.name: field for field in msg.fields}
    order = '>' if msg.is_bigendian else '<'
    data = bytes(msg.data)
    rows = []
    for row in range(msg.height):
        for column in range(msg.width):
            start = row * msg.row_step + column * msg.point_step
            wanted = [fields[name] for name in ('u', 'v', 'board_x', 'board_y')]
            rows.append(
                [
                    struct.unpack_from(order + _FORMATS[f.datatype], data, start + f.offset)[0]
                    for f in wanted
                ]
            )
    points = np.array(rows).reshape(-1, 4)
    return points if msg.is_dense else points[np.isfinite(points).all(axis=1)]
