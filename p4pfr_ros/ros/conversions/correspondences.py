# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""
Correspondences of a board <-> PointCloud2, and those of a marker <- PolygonStamped.

In a cloud, the fields ``u`` and ``v`` are pixels of the image as it was sent, ``board_x`` and
``board_y`` metres in the board frame, ``id`` (optional) is the index of the board point, and
``board`` (optional, the same for all points) the index of the board in the board file. Any order,
offsets and padding of the fields, either byte order, organised clouds or not. If ``is_dense`` is
false, points with a coordinate that is not finite were not detected and are left out.
"""

from __future__ import annotations

from array import array
from dataclasses import dataclass
import functools

from geometry_msgs.msg import PolygonStamped
import numpy as np
from numpy.typing import NDArray
from p4pfr_ros.boards.conventions import CORNER_ORDERS
from p4pfr_ros.core.geometry import Array, Ints
from p4pfr_ros.files.printable import printable
from sensor_msgs.msg import PointCloud2, PointField
from std_msgs.msg import Header

from ..runtime.rejections import Rejected

# px or m: larger than any image or board, and small enough for squares and cubes.
_LARGEST_COORDINATE = 1e7

# More than any board has. This many points already take some 0.1 s, and the calibration keeps
# up to 40 views of them by default.
_MAX_POINTS = 10_000

# Characters of the names of a cloud's fields in the log.
_MAX_LISTED = 80

_COORDINATES = ('u', 'v', 'board_x', 'board_y')
_INDICES = ('id', 'board')
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

# NumPy holds the size of an item in an int32.
_MAX_POINT_STEP = 2**31 - 1

# Double precision: a float32 rounds u = 4000 by 1e-4 px.
_OUT = {
    'u': PointField.FLOAT64,
    'v': PointField.FLOAT64,
    'board_x': PointField.FLOAT64,
    'board_y': PointField.FLOAT64,
    'id': PointField.INT32,
}
_NO_BOARDS = np.empty(0, dtype=np.int64)
_OUT_WITH_BOARD = _OUT | {'board': PointField.UINT32}


@dataclass(frozen=True, slots=True, eq=False)
class Correspondences:
    """
    Points of a board with their pixels in one image; at least four, all finite.

    Parameters
    ----------
    image_points : (N, 2) array
        Pixels of the image as it was sent; pixel centres are integers.
    board_points : (N, 2) array
        Metres, in the board frame: x right, y up.
    ids : (N,) array of int
        Indices of the board points.
    board
        Index of the board in the board file; None if the message does not contain it.

    """

    image_points: Array
    board_points: Array
    ids: Ints
    board: int | None = None


def correspondences_from_polygon(
    msg: PolygonStamped, size_m: float, corner_order: str, pixel_center_px: float = 0.0
) -> Correspondences | Rejected:
    """
    Read the four corners of a marker.

    Parameters
    ----------
    msg
        The corners; x and y are pixels.
    size_m
        Side of the marker: outer edge of its black border.
    corner_order
        One of ``CORNER_ORDERS``.
    pixel_center_px
        Coordinate of the centre of the first pixel in the message.

    """
    corners = msg.polygon.points
    if len(corners) != 4:
        return Rejected('point_count', f'corners: expected 4 points, got {len(corners)}')
    if not size_m > 0.0:
        return Rejected('marker_size', 'corners: set the parameter marker.size_m (metres)')
    image_points = np.array([(corner.x, corner.y) for corner in corners]) - pixel_center_px
    board_points = size_m * np.array(CORNER_ORDERS[corner_order])
    return checked(image_points, board_points, np.arange(4), 'corners')


def correspondences_from_cloud(msg: PointCloud2) -> Correspondences | Rejected:
    """Read the correspondences of one board."""
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
    has_ids, has_boards = (name in (layout.names or ()) for name in _INDICES)
    ids = rows['id'].astype(np.int64) if has_ids else np.arange(len(rows))
    boards = rows['board'].astype(np.int64) if has_boards else _NO_BOARDS
    if not msg.is_dense:
        detected = np.isfinite(points).all(axis=1)
        points, ids = points[detected], ids[detected]
        boards = boards[detected] if boards.size else boards
    if boards.size and (boards != boards[0]).any():
        got = ', '.join(str(board) for board in np.unique(boards)[:4])
        return Rejected(
            'boards', f'correspondences: expected points of one board, got points of boards {got}'
        )
    board = int(boards[0]) if boards.size else None
    return checked(points[:, :2], points[:, 2:], ids, 'correspondences', board)


def cloud_msg(
    header: Header, image_points: Array, board_points: Array, ids: Ints, board: int | None = None
) -> PointCloud2:
    """
    Make a cloud of N points: pixels (N, 2), metres (N, 2) and their ids (N,).

    ``board`` is the index of the board in the board file; with None the cloud has no such field.
    """
    fields = _OUT if board is None else _OUT_WITH_BOARD
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


def checked(
    image_points: Array,
    board_points: Array,
    ids: Ints,
    topic: str,
    board: int | None = None,
) -> Correspondences | Rejected:
    """Return the correspondences, or why they are invalid."""
    if len(image_points) < 4:
        return Rejected(
            'point_count', f'{topic}: expected at least 4 points, got {len(image_points)}'
        )
    if len(image_points) > _MAX_POINTS:
        return Rejected(
            'point_count',
            f'{topic}: expected at most {_MAX_POINTS} points, got {len(image_points)}',
        )
    wrong = wrong_coordinates(image_points, topic) or wrong_coordinates(board_points, topic)
    return wrong or Correspondences(image_points, board_points, ids, board)


def wrong_coordinates(points: Array, topic: str) -> Rejected | None:
    """Return why (N, 2) pixels or metres are invalid; None if they are valid."""
    if not np.isfinite(points).all():
        return Rejected('not_finite', f'{topic}: a coordinate is not finite')
    if np.abs(points).max() > _LARGEST_COORDINATE:
        return Rejected('out_of_range', f'{topic}: a coordinate is beyond 1e7 (px, m)')
    return None


# A sender does not change its fields from message to message.
@functools.lru_cache(maxsize=16)
def _layout(
    given: tuple[tuple[str, int, int], ...], point_step: int, is_bigendian: bool
) -> np.dtype[np.void] | Rejected:
    """Return the layout of our fields within a point, or why they cannot be read."""
    fields = {name: (offset, datatype) for name, offset, datatype in given}
    for name in _COORDINATES:
        if name not in fields or fields[name][1] not in _FLOATS:
            got = printable(', '.join(fields), _MAX_LISTED) or 'none'
            return Rejected(
                'fields',
                f'correspondences: expected the fields u, v, board_x, board_y (float32 or '
                f'float64), got {got}' + (f'; {name} is not a float' if name in fields else ''),
            )
    for name in _INDICES:
        if name in fields and fields[name][1] not in _INTEGERS:
            return Rejected('fields', f'correspondences: expected integers in the field {name}')
    if point_step > _MAX_POINT_STEP:
        return Rejected(
            'layout',
            f'correspondences: expected point_step up to {_MAX_POINT_STEP}, got {point_step}',
        )
    ours = [name for name in (*_COORDINATES, *_INDICES) if name in fields]
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
    """Return why row_step or the size of the data is invalid; None if both are valid."""
    if msg.row_step < msg.width * msg.point_step and msg.height > 1:
        return Rejected(
            'layout',
            f'correspondences: row_step = {msg.row_step} is less than width * point_step = '
            f'{msg.width * msg.point_step}',
        )
    # The padding after the last row may be missing.
    needed = (msg.height - 1) * msg.row_step + msg.width * msg.point_step
    if msg.height == 0 or len(msg.data) >= needed:
        return None
    return Rejected(
        'truncated', f'correspondences: expected {needed} bytes of data, got {len(msg.data)}'
    )


def _rows(msg: PointCloud2, layout: np.dtype[np.void]) -> NDArray[np.void]:
    """Return the points, row by row; layout and steps must have been checked."""
    if msg.height * msg.width == 0:
        return np.empty(0, layout)
    rows: NDArray[np.void] = np.ndarray(
        (msg.height, msg.width),
        dtype=layout,
        buffer=msg.data,
        strides=(msg.row_step, msg.point_step),
    )
    return rows.ravel()
