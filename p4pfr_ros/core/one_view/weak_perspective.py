# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""A start for the pose by a known camera: the board as seen from far, whatever the noise."""

from __future__ import annotations

import numpy as np

from ..geometry import Array
from ..minimal.solution import G, H, ROW_SIZE, TRANSLATION

# Rays within such an angle, radians, are one.
_ONE_RAY = 1e-12


def weak_perspective_rows(rays: Array, board: Array) -> Array:
    """
    Return two rows (2, ROW_SIZE), each the other's flip; rays (N, 3), board (N, 2).

    None (0, ROW_SIZE) where the rays are all one, or span more than half of what is around. Four
    noisy points that nearly lie on a line may have no closed form; this one they have.
    """
    sight = rays.mean(axis=0)
    if not (rays @ sight > 0.0).all():
        return np.empty((0, ROW_SIZE))
    to_sight = _turn_to_axis(sight / np.linalg.norm(sight))
    turned = rays @ to_sight.T
    flat = turned[:, :2] / turned[:, 2:]
    # About the mean ray (x, y) ≈ A X + b, where A is 1/Z times R's upper left block: its
    # singular values are 1/Z and cos(tilt)/Z.
    columns = np.column_stack([board, np.ones(len(board))])
    affine = np.linalg.lstsq(columns, flat, rcond=None)[0]
    u, (largest, smallest), v = np.linalg.svd(affine[:2].T)
    if not largest > _ONE_RAY:
        return np.empty((0, ROW_SIZE))
    cosine = min(smallest / largest, 1.0)
    sine = np.sqrt(1.0 - cosine**2)
    rows = np.empty((2, ROW_SIZE))
    for row, sign in zip(rows, (1.0, -1.0), strict=True):
        first = np.vstack([u @ np.diag([1.0, cosine]), [0.0, sign * sine]]) @ v
        rotation = np.column_stack([first, np.cross(first[:, 0], first[:, 1])])
        row[:TRANSLATION] = (to_sight.T @ rotation).ravel()
        row[TRANSLATION:G] = to_sight.T @ [*affine[2], 1.0] / largest
        row[G], row[H] = 1.0, 0.0
    return rows


def _turn_to_axis(direction: Array) -> Array:
    """Return a rotation (3, 3) that takes a unit vector to the z axis."""
    helper = np.eye(3)[int(np.argmin(np.abs(direction)))]
    x = np.cross(helper, direction)
    x /= np.linalg.norm(x)
    turn: Array = np.vstack([x, np.cross(direction, x), direction])
    return turn
