# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""
An estimate as markers for RViz and Foxglove.

Of a board named NAME there are the namespaces NAME/outline (amber where the view does not tell
the pose), NAME/axes, NAME/points (id 0: spheres, coloured by residual; id 1: cubes, the outliers)
and NAME/field_of_view. Their ids never change, so each message replaces the one before, and one
without a model removes it.
"""

from __future__ import annotations

from dataclasses import dataclass

from builtin_interfaces.msg import Duration
from geometry_msgs.msg import Point, Vector3
import numpy as np
from p4pfr_ros import DivisionCamera, PoseEstimate, Solution
from p4pfr_ros.core.geometry import Array, Mask
from std_msgs.msg import ColorRGBA, Header
from visualization_msgs.msg import Marker, MarkerArray

from .points import Correspondences
from .poses import bare_pose_msg
from .residual_colors import ramp_colors

# A board that is seen no more leaves the scene.
_LIFETIME = Duration(sec=2)

# Red, green, blue of the axes as everywhere in ROS.
_AXES = (
    ColorRGBA(r=0.90, g=0.22, b=0.20, a=1.0),
    ColorRGBA(r=0.25, g=0.75, b=0.30, a=1.0),
    ColorRGBA(r=0.25, g=0.45, b=0.95, a=1.0),
)
_OUTLINE = ColorRGBA(r=0.95, g=0.95, b=0.95, a=1.0)
_UNSURE = ColorRGBA(r=0.95, g=0.65, b=0.15, a=0.6)
_FIELD_OF_VIEW = ColorRGBA(r=0.65, g=0.65, b=0.70, a=0.8)
_OUTLIER = ColorRGBA(r=0.95, g=0.10, b=0.45, a=1.0)

# In sides of the board.
_LINE_WIDTH = 0.008
_AXIS_LENGTH = 0.5
_SHAFT, _HEAD, _HEAD_LENGTH = 0.025, 0.06, 0.1
_POINT_SIZE = 0.03
_SIGHT_LENGTH = 1.0

# Pieces in which a side of the picture is drawn, as the lens bends it.
_PIECES = 16


@dataclass(frozen=True, slots=True)
class _Scene:
    """What all markers of one message share."""

    header: Header
    board_frame: str
    solution: Solution
    side_m: float  # the longer side of the board
    sure: bool  # whether the view tells the pose

    def on_board(self, name: str, number: int, shape: int) -> Marker:
        """Make a marker whose points are in the board's frame."""
        marker = self.in_camera(name, number, shape)
        marker.pose = bare_pose_msg(self.solution.camera_from_board)
        return marker

    def in_camera(self, name: str, number: int, shape: int) -> Marker:
        """Make a marker whose points are in the optical frame."""
        marker = _marker(self.header, self.board_frame, name, number, Marker.ADD)
        marker.type = shape
        marker.lifetime = _LIFETIME
        return marker


def markers_msg(
    header: Header,
    board_frame: str,
    estimate: PoseEstimate,
    points: Correspondences,
    image_points_full_px: Array,
    image_size: tuple[int, int],
    *,
    sheet_size_m: tuple[float, float] | None = None,
    full_scale_px: float = 2.0,
) -> MarkerArray:
    """
    Make the markers of one estimate, in the header's frame.

    Parameters
    ----------
    header
        Of the corners: their stamp and optical frame.
    board_frame
        Name of the board, and of the markers' namespaces.
    estimate
        Without a model, the board's markers are removed.
    points
        The N points that were looked at.
    image_points_full_px : (N, 2) array
        Where they are in the full raw picture, px.
    image_size
        Width and height of that picture, px: its border is the field of view's.
    sheet_size_m
        Width and height of the printed sheet where they are known; else the outline is that of
        the points.
    full_scale_px
        The residual at the end of the ramp of colours.

    """
    solution = estimate.model
    if solution is None:
        return MarkerArray(markers=_removals(header, board_frame))
    low, high = _extent(points.board_points, sheet_size_m)
    sure = estimate.observable.direction and estimate.observable.distance
    scene = _Scene(header, board_frame, solution, float((high - low).max()), sure)
    residuals_px = _residuals_px(solution, points.board_points, image_points_full_px)
    return MarkerArray(
        markers=[
            _outline(scene, low, high),
            *_axes(scene),
            *_points(scene, points.board_points, residuals_px, estimate.inliers, full_scale_px),
            _field_of_view(scene, solution.camera, image_size),
        ]
    )


def _extent(board_points: Array, sheet_size_m: tuple[float, float] | None) -> tuple[Array, Array]:
    """Return the corners (2,) of the outline with the smallest and largest coordinates."""
    if sheet_size_m is None:
        return board_points.min(axis=0), board_points.max(axis=0)
    half: Array = 0.5 * np.array(sheet_size_m)
    return -half, half


def _residuals_px(solution: Solution, board_points: Array, image_points_px: Array) -> Array:
    """Return the distances (N,) to the reprojections; NaN where the camera sees no point."""
    in_camera = solution.camera_from_board.transform(np.pad(board_points, ((0, 0), (0, 1))))
    away = image_points_px - solution.camera.project(in_camera)
    residuals: Array = np.linalg.norm(away, axis=1)
    return residuals


def _outline(scene: _Scene, low: Array, high: Array) -> Marker:
    marker = scene.on_board('outline', 0, Marker.LINE_STRIP)
    marker.scale.x = _LINE_WIDTH * scene.side_m
    marker.color = _OUTLINE if scene.sure else _UNSURE
    (left, bottom), (right, top) = low.tolist(), high.tolist()
    corners = ((left, top), (right, top), (right, bottom), (left, bottom), (left, top))
    marker.points = [Point(x=x, y=y) for x, y in corners]
    return marker


def _axes(scene: _Scene) -> list[Marker]:
    """Make three arrows: x red, y green, z blue."""
    side_m = scene.side_m
    size = {'x': _SHAFT * side_m, 'y': _HEAD * side_m, 'z': _HEAD_LENGTH * side_m}
    arrows = []
    for number, (axis, color) in enumerate(zip('xyz', _AXES, strict=True)):
        marker = scene.on_board('axes', number, Marker.ARROW)
        marker.scale = Vector3(**size)
        marker.color = color
        marker.points = [Point(), Point(**{axis: _AXIS_LENGTH * side_m})]
        arrows.append(marker)
    return arrows


def _points(
    scene: _Scene, board_points: Array, residuals_px: Array, inliers: Mask, full_scale_px: float
) -> list[Marker]:
    """Make the inliers, coloured, and the outliers; a list without points is removed."""
    size_m = _POINT_SIZE * scene.side_m
    good = scene.on_board('points', 0, Marker.SPHERE_LIST)
    good.colors = ramp_colors(residuals_px[inliers] / full_scale_px)
    bad = scene.on_board('points', 1, Marker.CUBE_LIST)
    bad.color = _OUTLIER
    for marker, chosen in ((good, inliers), (bad, ~inliers)):
        marker.scale = Vector3(x=size_m, y=size_m, z=size_m)
        marker.points = [Point(x=x, y=y) for x, y in board_points[chosen].tolist()]
        if not marker.points:
            marker.action = Marker.DELETE
    return [good, bad]


def _field_of_view(scene: _Scene, camera: DivisionCamera, image_size: tuple[int, int]) -> Marker:
    """Make the border of the picture, as rays of one length, and lines to its corners."""
    marker = scene.in_camera('field_of_view', 0, Marker.LINE_LIST)
    marker.scale.x = _LINE_WIDTH * scene.side_m
    marker.color = _FIELD_OF_VIEW
    rays = camera.unproject(_border(image_size))
    # On a sphere and not on a plane: a lens may see beyond 90 degrees from its axis.
    ends = _SIGHT_LENGTH * scene.side_m * rays / np.linalg.norm(rays, axis=1, keepdims=True)
    border = [Point(x=x, y=y, z=z) for x, y, z in ends.tolist()]
    eye = Point()
    for start, end in zip(border, border[1:] + border[:1], strict=True):
        marker.points += [start, end]
    for corner in border[::_PIECES]:
        marker.points += [eye, corner]
    return marker


def _border(image_size: tuple[int, int]) -> Array:
    """Return points (4 _PIECES, 2) px around the picture, from its top left corner clockwise."""
    width, height = image_size
    # Pixel centres are integers: the picture ends half a pixel further out.
    corners = np.array([[0, 0], [width, 0], [width, height], [0, height]]) - 0.5
    along = np.arange(_PIECES)[:, None] / _PIECES
    sides = zip(corners, np.roll(corners, -1, axis=0), strict=True)
    return np.concatenate([start + along * (end - start) for start, end in sides])


_NUMBERS = {'outline': 1, 'axes': 3, 'points': 2, 'field_of_view': 1}


def _removals(header: Header, board_frame: str) -> list[Marker]:
    return [
        _marker(header, board_frame, name, number, Marker.DELETE)
        for name, count in _NUMBERS.items()
        for number in range(count)
    ]


def _marker(header: Header, board_frame: str, name: str, number: int, action: int) -> Marker:
    return Marker(header=header, ns=f'{board_frame}/{name}', id=number, action=action)
