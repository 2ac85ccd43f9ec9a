# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""Where the outlines of a board's shapes lie in a picture, as the lens bends them."""

from __future__ import annotations

import numpy as np
from p4pfr_ros.core.cameras.division import DivisionCamera
from p4pfr_ros.core.geometry import Array, Pose

# A curved edge is drawn as chords that leave it by less than this.
_CHORD_ERROR_PX = 2e-3
_MOST_HALVINGS = 16
# The board is cut off where it comes nearer to the image plane than this part of its distance.
_NEAREST = 1e-3


class Outlines:
    """
    A camera that sees shapes of four corners on a board as closed polygons.

    Parameters
    ----------
    camera
        The camera. What lies behind its image plane (z ≤ 0) is cut off.
    image_size
        Width and height of its pictures, pixels.

    """

    def __init__(self, camera: DivisionCamera, image_size: tuple[int, int]) -> None:
        self._camera = camera
        self._edge_px = _edge_of_sight_px(camera, *image_size)

    def edges(self, quads: Array, camera_from_board: Pose) -> Array:
        """
        Return the polygons' edges (M, 4): x0, y0, x1, y1 px.

        Quads (N, 4, 2) are corners in metres of the board's frame, clockwise. Seen from the
        front, their outlines turn clockwise in the picture too.
        """
        points = camera_from_board.transform(np.pad(quads, ((0, 0), (0, 0), (0, 1))))
        nearest = _NEAREST * float(np.linalg.norm(camera_from_board.translation))
        before = (points[..., 2] >= nearest).all(axis=1)
        whole = _sides(points[before])
        cut = [_sides(_clip(polygon, nearest)[None]) for polygon in points[~before]]
        sides = np.concatenate([whole, *cut])
        return self._chords(sides)

    def _chords(self, sides: Array) -> Array:
        """Turn straight sides (N, 2, 3) of the camera frame into chords (M, 4) of the image."""
        chords = []
        for halvings_left in range(_MOST_HALVINGS, -1, -1):
            ends = self._project(sides)
            middle = sides.mean(axis=1)
            bent = _distance_to_chord(self._project(middle), ends) > _CHORD_ERROR_PX
            if not halvings_left:
                bent[:] = False
            chords.append(ends[~bent].reshape(-1, 4))
            if not bent.any():
                break
            first = np.stack([sides[bent, 0], middle[bent]], axis=1)
            second = np.stack([middle[bent], sides[bent, 1]], axis=1)
            sides = np.concatenate([first, second])
        return np.concatenate(chords)

    def _project(self, points: Array) -> Array:
        """Project points; one that no pixel sees goes to the edge of sight, on its own side."""
        pixels = self._camera.project(points)
        unseen = ~np.isfinite(pixels).all(axis=-1)
        if unseen.any():
            xy = points[unseen, :2]
            away = xy / np.maximum(np.linalg.norm(xy, axis=1, keepdims=True), 1e-300)
            pixels[unseen] = self._camera.center_px + self._edge_px * away
        return pixels


def _edge_of_sight_px(camera: DivisionCamera, width: int, height: int) -> float:
    """Return the radius where rays stop to turn outwards, or one well outside of the image."""
    corners = np.array([[0, 0], [width, 0], [0, height], [width, height]]) - camera.center_px
    outside = 2.0 * float(np.linalg.norm(corners, axis=1).max())
    radii = np.linspace(0.0, outside, 2048)
    rays = camera.unproject(np.stack([radii, np.zeros_like(radii)], axis=1) + camera.center_px)
    falls = np.diff(np.arctan2(rays[:, 0], rays[:, 2])) <= 0.0
    return float(radii[np.argmax(falls)]) if falls.any() else outside


def _sides(polygons: Array) -> Array:
    """Return the sides (N * n, 2, 3) of polygons (N, n, 3)."""
    return np.stack([polygons, np.roll(polygons, -1, axis=1)], axis=2).reshape(-1, 2, 3)


def _clip(polygon: Array, nearest: float) -> Array:
    """Cut off what of a polygon (n, 3) has z < nearest (Sutherland and Hodgman): (m, 3)."""
    kept = []
    for a, b in zip(polygon, np.roll(polygon, -1, axis=0), strict=True):
        if a[2] >= nearest:
            kept.append(a)
        if (a[2] >= nearest) != (b[2] >= nearest):
            kept.append(a + (nearest - a[2]) / (b[2] - a[2]) * (b - a))
    return np.array(kept).reshape(-1, 3)


def _distance_to_chord(points: Array, ends: Array) -> Array:
    """Return how far points (N, 2) are from the lines through ends (N, 2, 2)."""
    along = ends[:, 1] - ends[:, 0]
    off = points - ends[:, 0]
    length = np.maximum(np.linalg.norm(along, axis=1), 1e-12)
    distance: Array = np.abs(along[:, 0] * off[:, 1] - along[:, 1] * off[:, 0]) / length
    return distance
