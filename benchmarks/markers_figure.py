# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""
Draws docs/markers.png: the message that pose_node publishes on ~/markers.

    python -m benchmarks.markers_figure [--output docs]
"""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

import matplotlib as mpl
from matplotlib.figure import Figure
import numpy as np
from p4pfr_ros import DivisionCamera, estimate_pose, Pose
from p4pfr_ros.core.geometry import Array
from p4pfr_ros.report.figure_style import STYLE
from p4pfr_ros.ros.conversions import Correspondences
from p4pfr_ros.ros.conversions.markers import markers_msg
from std_msgs.msg import Header
from visualization_msgs.msg import Marker, MarkerArray

_DOCS = Path(__file__).parent.parent / 'docs'
_SIZE = (640, 480)
_CAMERA = DivisionCamera(330.0, (319.5, 239.5), -0.25)
_FACING = Pose(np.diag([1.0, -1.0, -1.0]), np.array([0.05, 0.0, 0.32]))
_ROTATION_RAD = [0.35, -0.5, 0.15]
_BACKGROUND = '#303030'  # RViz's default


def main(arguments: list[str] | None = None) -> int:
    """Draw the figure."""
    parser = argparse.ArgumentParser(
        prog='python -m benchmarks.markers_figure', description=__doc__.split('\n\n')[0]
    )
    parser.add_argument(
        '--output', type=Path, default=_DOCS, metavar='FOLDER', help='default: docs'
    )
    folder = parser.parse_args(arguments).output
    with mpl.rc_context(STYLE):
        figure = draw(view())
        figure.savefig(folder / 'markers.png', dpi=120, facecolor=_BACKGROUND)
    return 0


def view() -> MarkerArray:
    """Make the markers of one noisy view with two outliers."""
    x, y = np.meshgrid(np.linspace(-0.1, 0.1, 9), np.linspace(-0.0625, 0.0625, 6))
    board = np.stack([x.ravel(), y.ravel()], axis=1)
    pose = _FACING @ Pose.from_rotation_vector(_ROTATION_RAD, np.zeros(3))
    image = _CAMERA.project(pose.transform(np.pad(board, ((0, 0), (0, 1)))))
    image += np.random.default_rng(2).normal(0.0, 0.5, image.shape)
    image[[12, 40]] += 15.0
    points = Correspondences(image, board, np.arange(len(board)))
    estimate = estimate_pose(image, board, image_size=_SIZE)
    return markers_msg(Header(), 'board', estimate, points, image, _SIZE)


def draw(msg: MarkerArray) -> Figure:
    """Draw each marker as RViz would, in the camera frame, seen from behind the camera."""
    figure = Figure(figsize=(6.0, 4.2))
    axes: Any = figure.add_axes((0.0, 0.0, 1.0, 1.0), projection='3d')
    axes.set_axis_off()
    axes.set_facecolor(_BACKGROUND)
    for marker in msg.markers:
        # In matplotlib z is up; in the optical frame y is down and z forward.
        x, y, z = in_camera(marker).T
        _draw_marker(axes, marker, np.stack([x, z, -y], axis=1))
    for name, (low, high) in {'x': (-0.2, 0.2), 'y': (-0.03, 0.37), 'z': (-0.2, 0.2)}.items():
        axes.set(**{f'{name}lim': (low, high)})
    axes.set_box_aspect((1.0, 1.0, 1.0), zoom=1.75)
    axes.view_init(elev=28.0, azim=-68.0)
    return figure


def in_camera(marker: Marker) -> Array:
    """Return the points (N, 3) of a marker in the frame of its header."""
    q, p = marker.pose.orientation, marker.pose.position
    pose = Pose.from_quaternion_xyzw([q.x, q.y, q.z, q.w], [p.x, p.y, p.z])
    return pose.transform([(point.x, point.y, point.z) for point in marker.points])


def _draw_marker(axes: Any, marker: Marker, points: Array) -> None:
    color = _rgba(marker.color)
    if marker.type == Marker.LINE_LIST:
        for piece in points.reshape(-1, 2, 3):
            axes.plot(*piece.T, color=color, linewidth=1.0)
    elif marker.type == Marker.LINE_STRIP:
        axes.plot(*points.T, color=color, linewidth=1.5)
    elif marker.type == Marker.ARROW:
        axes.quiver(*points[0], *(points[1] - points[0]), color=color, linewidth=2.5)
    elif marker.type == Marker.SPHERE_LIST:
        axes.scatter(*points.T, color=[_rgba(c) for c in marker.colors], s=26.0, depthshade=False)
    elif marker.type == Marker.CUBE_LIST:
        axes.scatter(*points.T, color=color, s=45.0, marker='s', depthshade=False)


def _rgba(color: Any) -> tuple[float, float, float, float]:
    return color.r, color.g, color.b, color.a


if __name__ == '__main__':
    raise SystemExit(main())
