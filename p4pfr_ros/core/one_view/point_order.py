# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""
Which side of the board the camera sees: by the order of the points, and by a pose.

A printed board is opaque, so a view of its back means that the points are in a mirrored order.
Every camera that sees the front keeps the orientation of triangles (counter-clockwise on the
board, y up, stays counter-clockwise as the viewer sees it): for this no camera need be known.

This module stands alone: it is about the points, before and after the estimation.
"""

from __future__ import annotations

import numpy as np

from .ransac import draw_sample, first_state, smallest_triangles
from ..geometry import Array, Pose
from ..jit import jit

# Number of samples of four points, each with four triangles.
_SAMPLES = 16

# The order is mirrored if more than this share of the triangles is; outliers turn half of theirs.
# If fewer are, the search finds the inliers, and the pose decides.
_CLEAR = 0.9


@jit
def is_mirrored(image: Array, board: Array, limit: float) -> bool:
    """
    Return whether the points are clearly in a mirrored order, as the back of the board has them.

    image (N, 2) px, y down; board (N, 2), y up; limit: the squared threshold of inliers, px².
    """
    smallest = smallest_triangles(board, limit)
    state = first_state(0)
    chosen = np.empty(4, dtype=np.int64)
    mirrored = total = 0
    for _ in range(1 if len(image) == 4 else _SAMPLES):
        state = draw_sample(image, board, smallest, state, chosen)
        for i in range(4):
            a, b, c = chosen[i], chosen[(i + 1) % 4], chosen[(i + 2) % 4]
            in_image, on_board = _area(image, a, b, c), _area(board, a, b, c)
            # Noise may turn a smaller triangle.
            if abs(in_image) > smallest[0] and abs(on_board) > smallest[1]:
                total += 1
                mirrored += 1 if (in_image > 0.0) == (on_board > 0.0) else 0
    return mirrored > _CLEAR * total


@jit
def _area(points: Array, a: int, b: int, c: int) -> float:
    """Return twice the signed area of a triangle."""
    area: float = (points[b, 0] - points[a, 0]) * (points[c, 1] - points[a, 1]) - (
        points[b, 1] - points[a, 1]
    ) * (points[c, 0] - points[a, 0])
    return area


def shows_back(camera_from_board: Pose) -> bool:
    """Return whether a camera in this pose sees the back of the board."""
    x, y, z = camera_from_board.rotation[:, 2].tolist()
    tx, ty, tz = camera_from_board.translation.tolist()
    # The board's z axis points out of its front. Any point of its plane may replace the origin.
    return bool(x * tx + y * ty + z * tz > 0.0)


def row_shows_back(row: Array) -> bool:
    """Return the same for a pose as a row (≥ 12,) of the scaled board."""
    xz, yz, zz, x, y, z = row[[2, 5, 8, 9, 10, 11]].tolist()
    return bool(xz * x + yz * y + zz * z > 0.0)
