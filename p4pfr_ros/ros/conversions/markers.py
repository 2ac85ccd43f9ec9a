# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""
``PoseEstimate`` -> MarkerArray for RViz and Foxglove.

The namespaces of a board NAME are NAME/outline (amber if the view does not determine the pose),
NAME/axes, NAME/points (id 0: inliers, spheres coloured by residual; id 1: outliers, cubes) and
NAME/field_of_view. The ids never change, so each message replaces the previous one, and an
estimate without a model deletes its markers.

This module stands alone: it has the geometry and colours of the display, which nothing else uses.
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

from .correspondences import Correspondences
from .poses import bare_pose_msg

# A board that is no longer detected disappears.
_LIFETIME = Duration(sec=2)

# x red, y green, z blue, as in RViz.
_AXES = (
    ColorRGBA(r=0.90, g=0.22, b=0.20, a=1.0),
    ColorRGBA(r=0.25, g=0.75, b=0.30, a=1.0),
    ColorRGBA(r=0.25, g=0.45, b=0.95, a=1.0),
)
_OUTLINE = ColorRGBA(r=0.95, g=0.95, b=0.95, a=1.0)
_UNDETERMINED = ColorRGBA(r=0.95, g=0.65, b=0.15, a=0.6)
_FIELD_OF_VIEW = ColorRGBA(r=0.65, g=0.65, b=0.70, a=0.8)
_OUTLIER = ColorRGBA(r=0.95, g=0.10, b=0.45, a=1.0)

# Relative to the longer side of the board.
_LINE_WIDTH = 0.008
_AXIS_LENGTH = 0.5
_SHAFT, _HEAD, _HEAD_LENGTH = 0.025, 0.06, 0.1
_POINT_SIZE = 0.03
_RAY_LENGTH = 1.0

# Line segments per side of the image border, which the lens distorts.
_SEGMENTS = 16

# Ramp of the residuals from 0 to 1: sky blue, yellow, orange-red. The colours are bright on a
# dark background and can be told apart with red-green colour blindness.
_STOPS = (0.0, 0.5, 1.0)
_RED, _GREEN, _BLUE = (0.30, 0.95, 0.90), (0.75, 0.88, 0.35), (0.95, 0.25, 0.10)

# The colours are computed once: making a message for each point costs more than a lookup.
_STEPS = 32


def _ramp() -> tuple[ColorRGBA, ...]:
    shares = np.linspace(0.0, 1.0, _STEPS + 1)
    rgb = np.stack([np.interp(shares, _STOPS, c) for c in (_RED, _GREEN, _BLUE)], axis=1)
    return tuple(ColorRGBA(r=r, g=g, b=b, a=1.0) for r, g, b in rgb.tolist())


_RAMP = _ramp()


def ramp_colors(shares: Array) -> list[ColorRGBA]:
    """Return a colour for each of (N,) shares: 0 is the best; 1, more than 1 and NaN the worst."""
    steps = np.rint(np.clip(np.nan_to_num(shares, nan=1.0), 0.0, 1.0) * _STEPS)
    return [_RAMP[step] for step in steps.astype(int).tolist()]


@dataclass(frozen=True, slots=True)
class _Scene:
    """Properties that all markers of one message share."""

    header: Header
    board_frame: str
    solution: Solution
    side_m: float  # the longer side of the board
    determined: bool  # whether the view determines the pose

    def on_board(self, name: str, number: int, shape: int) -> Marker:
        """Make a marker with points in the board frame."""
        marker = self.in_camera(name, number, shape)
        marker.pose = bare_pose_msg(self.solution.camera_from_board)
        return marker

    def in_camera(self, name: str, number: int, shape: int) -> Marker:
        """Make a marker with points in the optical frame."""
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
    surface_points: Array | None = None,
) -> MarkerArray:
    """
    Make the markers of one estimate, in the header's frame.

    Parameters
    ----------
    header
        Stamp and optical frame of the observation.
    board_frame
        Prefix of the markers' namespaces.
    estimate
        Without a model, the markers of the board are deleted.
    points
        The N observed points.
    image_points_full_px : (N, 2) array
        Their pixels in the full raw image.
    image_size
        Width and height of the full raw image, px.
    sheet_size_m
        Width and height of the printed sheet; None: the outline is the extent of the points.
    full_scale_px
        Residual at the end of the colour ramp.
    surface_points : (N, 3) array
        Where the points are on the real board; None: where its specification has them.

    """
    solution = estimate.model
    if solution is None:
        return MarkerArray(markers=_deletions(header, board_frame))
    low, high = _extent(points.board_points, sheet_size_m)
    determined = estimate.observable.direction and estimate.observable.distance
    scene = _Scene(header, board_frame, solution, float((high - low).max()), determined)
    if surface_points is None:
        surface_points = np.pad(points.board_points, ((0, 0), (0, 1)))
    residuals_px = _residuals_px(solution, surface_points, image_points_full_px)
    return MarkerArray(
        markers=[
            _outline(scene, low, high),
            *_axes(scene),
            *_points(scene, points.board_points, residuals_px, estimate.inliers, full_scale_px),
            _field_of_view(scene, solution.camera, image_size),
        ]
    )


def _extent(board_points: Array, sheet_size_m: tuple[float, float] | None) -> tuple[Array, Array]:
    """Return the corners (2,) of the outline with the smallest and the largest coordinates."""
    if sheet_size_m is None:
        return board_points.min(axis=0), board_points.max(axis=0)
    half: Array = 0.5 * np.array(sheet_size_m)
    return -half, half


def _residuals_px(solution: Solution, surface_points: Array, image_points_px: Array) -> Array:
    """Return the distances (N,) to the reprojections; NaN if a point does not project."""
    in_camera = solution.camera_from_board.transform(surface_points)
    residual_px = image_points_px - solution.camera.project(in_camera)
    distances: Array = np.linalg.norm(residual_px, axis=1)
    return distances


def _outline(scene: _Scene, low: Array, high: Array) -> Marker:
    marker = scene.on_board('outline', 0, Marker.LINE_STRIP)
    marker.scale.x = _LINE_WIDTH * scene.side_m
    marker.color = _OUTLINE if scene.determined else _UNDETERMINED
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
    """Make the lists of inliers and outliers; an empty list is deleted."""
    size_m = _POINT_SIZE * scene.side_m
    inlier_list = scene.on_board('points', 0, Marker.SPHERE_LIST)
    inlier_list.colors = ramp_colors(residuals_px[inliers] / full_scale_px)
    outlier_list = scene.on_board('points', 1, Marker.CUBE_LIST)
    outlier_list.color = _OUTLIER
    for marker, mask in ((inlier_list, inliers), (outlier_list, ~inliers)):
        marker.scale = Vector3(x=size_m, y=size_m, z=size_m)
        marker.points = [Point(x=x, y=y) for x, y in board_points[mask].tolist()]
        if not marker.points:
            marker.action = Marker.DELETE
    return [inlier_list, outlier_list]


def _field_of_view(scene: _Scene, camera: DivisionCamera, image_size: tuple[int, int]) -> Marker:
    """Make the image border as rays of equal length, and lines from the camera to its corners."""
    marker = scene.in_camera('field_of_view', 0, Marker.LINE_LIST)
    marker.scale.x = _LINE_WIDTH * scene.side_m
    marker.color = _FIELD_OF_VIEW
    rays = camera.unproject(_border(image_size))
    # On a sphere, not on a plane: a lens may see beyond 90 degrees from its axis.
    ends = _RAY_LENGTH * scene.side_m * rays / np.linalg.norm(rays, axis=1, keepdims=True)
    border = [Point(x=x, y=y, z=z) for x, y, z in ends.tolist()]
    camera_center = Point()
    for start, end in zip(border, border[1:] + border[:1], strict=True):
        marker.points += [start, end]
    for corner in border[::_SEGMENTS]:
        marker.points += [camera_center, corner]
    return marker


def _border(image_size: tuple[int, int]) -> Array:
    """Return points (4 _SEGMENTS, 2) px along the image border, clockwise from the top left."""
    width, height = image_size
    # Pixel centres are integers: the image ends half a pixel beyond them.
    corners = np.array([[0, 0], [width, 0], [width, height], [0, height]]) - 0.5
    along = np.arange(_SEGMENTS)[:, None] / _SEGMENTS
    sides = zip(corners, np.roll(corners, -1, axis=0), strict=True)
    return np.concatenate([start + along * (end - start) for start, end in sides])


_MARKER_COUNTS = {'outline': 1, 'axes': 3, 'points': 2, 'field_of_view': 1}


def _deletions(header: Header, board_frame: str) -> list[Marker]:
    return [
        _marker(header, board_frame, name, number, Marker.DELETE)
        for name, count in _MARKER_COUNTS.items()
        for number in range(count)
    ]


def _marker(header: Header, board_frame: str, name: str, number: int, action: int) -> Marker:
    return Marker(header=header, ns=f'{board_frame}/{name}', id=number, action=action)
