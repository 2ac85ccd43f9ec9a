# Copyright 2026 p4pfr_ros maintainers
#
# Licensed under the Apache License, Version 2.0 (the "License");
# you may not use this file except in compliance with the License.
# You may obtain a copy of the License at
#
#     http://www.apache.org/licenses/LICENSE-2.0
#
# Unless required by applicable law or agreed to in writing, software
# distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied.
# See the License for the specific language governing permissions and
# limitations under the License.

"""
Correspondences <-> PointCloud2.

The fields ``u`` and ``v`` are pixels of the picture as it was sent, ``board_x`` and ``board_y``
metres in the board's frame, ``id`` (optional) says which point of the board it is, and ``board``
(optional, the same for all points) which board of several: its place in the board file, from 0.
Any order, offsets and padding, both byte orders, organised or not. In a cloud with ``is_dense`` =
false a point with a coordinate that is not finite is one that was not seen, and is left out.
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
_NUMBERS = ('id', 'board')
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
_NO_BOARDS = np.empty(0, dtype=np.int64)
_OUT_OF_SEVERAL = _OUT | {'board': PointField.UINT32}


def correspondences_from_cloud(msg: PointCloud2) -> Correspondences | Rejected:
    """Take the correspondences of a board out of a cloud."""
    wrong = _wrong_layout(msg)
    if wrong is not None:
        return wrong
    fields = {field.name: field for field in msg.fields}
    points = np.empty((msg.height * msg.width, 4))
    for i, name in enumerate(_COORDINATES):
        points[:, i] = _column(msg, fields[name])
    ids, boards = np.arange(len(points)), _NO_BOARDS
    if 'id' in fields:
        ids = _column(msg, fields['id']).astype(np.int64)
    if 'board' in fields:
        boards = _column(msg, fields['board']).astype(np.int64)
    if not msg.is_dense:
        seen = np.isfinite(points).all(axis=1)
        points, ids = points[seen], ids[seen]
        boards = boards[seen] if boards.size else boards
    if boards.size and (boards != boards[0]).any():
        got = ', '.join(str(board) for board in np.unique(boards)[:4])
        return Rejected(
            'boards', f'correspondences: expected one board in a cloud, got the boards {got}'
        )
    board = int(boards[0]) if boards.size else None
    return checked(points[:, :2], points[:, 2:], ids, 'correspondences', board)


def cloud_msg(
    header: Header, image_points: Array, board_points: Array, ids: Ints, board: int | None = None
) -> PointCloud2:
    """
    Make a cloud of N points: pixels (N, 2), metres (N, 2) and their ids (N,).

    ``board`` says which board of several it is; of one alone, None, the cloud has no such field.
    """
    fields = _OUT if board is None else _OUT_OF_SEVERAL
    layout = np.dtype([(name, '<' + _TYPES[datatype]) for name, datatype in fields.items()])
    rows = np.empty(len(ids), dtype=layout)
    rows['u'], rows['v'] = image_points.T
    rows['board_x'], rows['board_y'] = board_points.T
    rows['id'] = ids
    if board is not None:
        rows['board'] = board
    msg = PointCloud2(header=header, height=1, width=len(rows), is_dense=True)
    offset = 0
    for name, datatype in fields.items():
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
    for name in _NUMBERS:
        if name in fields and fields[name].datatype not in _INTEGERS:
            return Rejected('fields', f'correspondences: expected integers in the field {name}')
    for name in (*_COORDINATES, *_NUMBERS):
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
