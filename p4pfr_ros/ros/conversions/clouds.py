# SPDX-License-Identifier: Apache-2.0
"""
Correspondences <-> PointCloud2.

The fields ``u`` and ``v`` are pixels of the picture as it was sent, ``board_x`` and ``board_y``
metres in the board's frame, ``id`` (optional) says which point of the board it is. Any order,
offsets and padding, both byte orders, organised or not. In a cloud with ``is_dense`` = false a
point with a coordinate that is not finite is one that was not seen, and is left out.
"""

from __future__ import annotations

from array import array

import numpy as np
from numpy.typing import NDArray
from p4pfr_ros.core.geometry import Array, Ints
from sensor_msgs.msg import PointCloud2, PointField
from std_msgs.msg import Header

from .points import checked, Correspondences
from ..rejections import Rejected

_COORDINATES = ('u', 'v', 'board_x', 'board_y')
_FLOATS = {PointField.FLOAT32: 'f4', PointField.FLOAT64: 'f8'}
_INTEGERS = {
    PointField.INT8: 'i1',
    PointField.UINT8: 'u1',
    PointField.INT16: 'i2',
    PointField.UINT16: 'u2',
    PointField.INT32: 'i4',
    PointField.UINT32: 'u4',
}

_TYPES = _FLOATS | _INTEGERS

# Double precision for all: u = 4000 in single precision is rounded by 1e-4 px.
_OUT = {
    'u': PointField.FLOAT64,
    'v': PointField.FLOAT64,
    'board_x': PointField.FLOAT64,
    'board_y': PointField.FLOAT64,
    'id': PointField.INT32,
}


def correspondences_from_cloud(msg: PointCloud2) -> Correspondences | Rejected:
    """Take the correspondences of a board out of a cloud."""
    wrong = _wrong_layout(msg)
    if wrong is not None:
        return wrong
    fields = {field.name: field for field in msg.fields}
    u, v, x, y = (_column(msg, fields[name]) for name in _COORDINATES)
    points = np.stack([u, v, x, y], axis=1).astype(np.float64)
    ids = np.arange(len(points))
    if 'id' in fields:
        ids = _column(msg, fields['id']).astype(np.int64)
    if not msg.is_dense:
        seen = np.isfinite(points).all(axis=1)
        points, ids = points[seen], ids[seen]
    return checked(points[:, :2], points[:, 2:], ids, 'correspondences')


def cloud_msg(header: Header, image_points: Array, board_points: Array, ids: Ints) -> PointCloud2:
    """Make a cloud of N points: pixels (N, 2), metres (N, 2) and their ids (N,)."""
    layout = np.dtype([(name, '<' + _TYPES[datatype]) for name, datatype in _OUT.items()])
    rows = np.empty(len(ids), dtype=layout)
    rows['u'], rows['v'] = image_points.T
    rows['board_x'], rows['board_y'] = board_points.T
    rows['id'] = ids
    msg = PointCloud2(header=header, height=1, width=len(rows), is_dense=True)
    offset = 0
    for name, datatype in _OUT.items():
        msg.fields.append(PointField(name=name, offset=offset, datatype=datatype, count=1))
        offset += layout[name].itemsize
    msg.point_step = layout.itemsize
    msg.row_step = layout.itemsize * len(rows)
    msg.data = array('B', rows.tobytes())
    return msg


def _wrong_layout(msg: PointCloud2) -> Rejected | None:
    """Say what keeps the fields from being read, if anything does."""
    fields = {field.name: field for field in msg.fields}
    for name in _COORDINATES:
        if name not in fields or fields[name].datatype not in _FLOATS:
            got = ', '.join(fields) or 'none'
            return Rejected(
                'fields',
                f'correspondences: expected the fields u, v, board_x, board_y (float32 or '
                f'float64), got {got}' + (f'; {name} is no float' if name in fields else ''),
            )
    if 'id' in fields and fields['id'].datatype not in _INTEGERS:
        return Rejected('fields', 'correspondences: expected integers in the field id')
    for name in (*_COORDINATES, 'id'):
        if name in fields and _end(fields[name]) > msg.point_step:
            return Rejected(
                'layout',
                f'correspondences: the field {name} ends at byte {_end(fields[name])}, '
                f'beyond point_step = {msg.point_step}',
            )
    if msg.row_step < msg.width * msg.point_step and msg.height > 1:
        return Rejected(
            'layout',
            f'correspondences: row_step = {msg.row_step} is less than width * point_step = '
            f'{msg.width * msg.point_step}',
        )
    return _truncated(msg)


def _truncated(msg: PointCloud2) -> Rejected | None:
    # The padding after the last row may be missing; its points may not.
    needed = (msg.height - 1) * msg.row_step + msg.width * msg.point_step
    if msg.height == 0 or len(msg.data) >= needed:
        return None
    return Rejected('truncated', f'correspondences: {needed} bytes expected, {len(msg.data)} came')


def _end(field: PointField) -> int:
    size = np.dtype(_TYPES[field.datatype]).itemsize
    return int(field.offset) + size


def _column(msg: PointCloud2, field: PointField) -> NDArray[np.generic]:
    """Read one field of all points, row by row; the layout has been checked."""
    if msg.height * msg.width == 0:
        return np.empty(0)
    order = '>' if msg.is_bigendian else '<'
    column: NDArray[np.generic] = np.ndarray(
        (msg.height, msg.width),
        dtype=order + _TYPES[field.datatype],
        buffer=msg.data,
        offset=field.offset,
        strides=(msg.row_step, msg.point_step),
    )
    return column.ravel()
