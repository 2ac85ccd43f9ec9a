# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

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
import functools

import numpy as np
from numpy.typing import NDArray
from p4pfr_ros.core.geometry import Array, Ints
from sensor_msgs.msg import PointCloud2, PointField
from std_msgs.msg import Header

from .points import checked, Correspondences
from ..runtime.rejections import Rejected

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

# Of a point: NumPy counts its bytes in an int.
_MOST_BYTES = 2**31 - 1

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
    fields = tuple((f.name, f.offset, f.datatype) for f in msg.fields)
    layout = _layout(fields, msg.point_step, msg.is_bigendian)
    if isinstance(layout, Rejected):
        return layout
    wrong = _wrong_steps(msg)
    if wrong is not None:
        return wrong
    rows = _rows(msg, layout)
    points = np.empty((len(rows), len(_COORDINATES)))
    for i, name in enumerate(_COORDINATES):
        points[:, i] = rows[name]
    has_ids, has_boards = (name in (layout.names or ()) for name in _NUMBERS)
    ids = rows['id'].astype(np.int64) if has_ids else np.arange(len(rows))
    boards = rows['board'].astype(np.int64) if has_boards else _NO_BOARDS
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


# A sender does not change its fields from message to message.
@functools.lru_cache(maxsize=16)
def _layout(
    given: tuple[tuple[str, int, int], ...], point_step: int, is_bigendian: bool
) -> np.dtype[np.void] | Rejected:
    """Return where in a point our fields are, or what keeps them from being read."""
    fields = {name: (offset, datatype) for name, offset, datatype in given}
    for name in _COORDINATES:
        if name not in fields or fields[name][1] not in _FLOATS:
            got = ', '.join(fields) or 'none'
            return Rejected(
                'fields',
                f'correspondences: expected the fields u, v, board_x, board_y (float32 or '
                f'float64), got {got}' + (f'; {name} is no float' if name in fields else ''),
            )
    for name in _NUMBERS:
        if name in fields and fields[name][1] not in _INTEGERS:
            return Rejected('fields', f'correspondences: expected integers in the field {name}')
    if point_step > _MOST_BYTES:
        return Rejected('layout', f'correspondences: point_step = {point_step} is absurd')
    ours = [name for name in (*_COORDINATES, *_NUMBERS) if name in fields]
    formats = [np.dtype(('>' if is_bigendian else '<') + _TYPES[fields[n][1]]) for n in ours]
    offsets = [fields[name][0] for name in ours]
    for name, offset, kind in zip(ours, offsets, formats, strict=True):
        if offset + kind.itemsize > point_step:
            return Rejected(
                'layout',
                f'correspondences: the field {name} ends at byte {offset + kind.itemsize}, '
                f'beyond point_step = {point_step}',
            )
    return np.dtype({'names': ours, 'formats': formats, 'offsets': offsets})


def _wrong_steps(msg: PointCloud2) -> Rejected | None:
    """Say what is wrong with where the points are, if anything is."""
    if msg.row_step < msg.width * msg.point_step and msg.height > 1:
        return Rejected(
            'layout',
            f'correspondences: row_step = {msg.row_step} is less than width * point_step = '
            f'{msg.width * msg.point_step}',
        )
    # The padding after the last row may be missing; its points may not.
    needed = (msg.height - 1) * msg.row_step + msg.width * msg.point_step
    if msg.height == 0 or len(msg.data) >= needed:
        return None
    return Rejected('truncated', f'correspondences: {needed} bytes expected, {len(msg.data)} came')


def _rows(msg: PointCloud2, layout: np.dtype[np.void]) -> NDArray[np.void]:
    """Look at the points, row by row; layout and steps have been checked."""
    if msg.height * msg.width == 0:
        return np.empty(0, layout)
    rows: NDArray[np.void] = np.ndarray(
        (msg.height, msg.width),
        dtype=layout,
        buffer=msg.data,
        strides=(msg.row_step, msg.point_step),
    )
    return rows.ravel()
