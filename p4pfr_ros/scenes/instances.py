# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""
Scenes whose answer is known: one generator for tests, benchmarks and demonstrations.

The minimal instances are a marker in front of a 1280x960 camera with f from 300 to 2000 px and
k r² at the image's corner from -0.5 to 0, projected without noise and in double precision.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
import math

import numpy as np
from p4pfr_ros.core.geometry import Array

IMAGE_SIZE = (1280, 960)
_HALF_SIZE_PX = np.array([640.0, 480.0])
_CORNER_RADIUS_PX = 800.0
_SQUARE = np.array([[-0.5, 0.5], [0.5, 0.5], [0.5, -0.5], [-0.5, -0.5]])

# Of the marker in the picture: from barely seen to nearly filling it.
_LOG_MARKER_SIZE_PX = (math.log(60.0), math.log(900.0))

# A sample of four board points in the unit square whose flattest triangle is smaller than this
# is drawn again; the collinear class draws its own.
_MIN_TRIANGLE_AREA = 0.02
_GRID = 2.0**40


@dataclass(frozen=True, slots=True, eq=False)
class Instances:
    """
    n minimal problems and their answers.

    image_points (n, 4, 2) in px relative to the centre, board_points (n, 4, 2) in marker
    sizes, focal_px (n,), k (n,) dimensionless, rotation (n, 3, 3), translation (n, 3).
    """

    image_points: Array
    board_points: Array
    focal_px: Array
    k: Array
    rotation: Array
    translation: Array

    def __len__(self) -> int:
        return len(self.focal_px)


# A placement gets (rng, board, rotation) and says which board point (n, 2) lies on which pixel
# (n, 2), relative to the centre.
Placement = Callable[[np.random.Generator, Array, Array], tuple[Array, Array]]
Board = Callable[[np.random.Generator, int], Array]
Rotation = Callable[[np.random.Generator, int], Array]


def instances(kind: str, n: int, seed: int = 0) -> Instances:
    """
    Draw n instances of a kind, one of ``KINDS``.

    Raises
    ------
    ValueError
        The kind is unknown.

    """
    if kind not in KINDS:
        raise ValueError(f'kind must be one of {sorted(KINDS)}, got {kind!r}')
    rng = np.random.default_rng(seed)
    batches: list[Instances] = []
    while sum(map(len, batches)) < n:
        batches.append(visible(draw(rng, 2 * n + 16, *KINDS[kind])))
    fields = zip(*((getattr(b, f) for f in Instances.__slots__) for b in batches), strict=True)
    return Instances(*(np.concatenate(parts)[:n] for parts in fields))


def draw(
    rng: np.random.Generator, n: int, draw_board: Board, draw_rotation: Rotation, place: Placement
) -> Instances:
    """Draw n boards, cameras and poses; not all are seen whole."""
    low, high = np.log(300.0), np.log(2000.0)
    focal_px = np.exp(rng.uniform(low, high, n))
    k_px = rng.uniform(-0.5, 0.0, n) / _CORNER_RADIUS_PX**2
    board = draw_board(rng, n)
    rotation = draw_rotation(rng, n)
    anchor, pixel = place(rng, board, rotation)
    # The ray through the anchor's pixel, scaled so that the marker has its size in the picture.
    distance = focal_px / np.exp(rng.uniform(*_LOG_MARKER_SIZE_PX, n))
    ray = np.column_stack([pixel, focal_px * (1.0 + k_px * np.sum(pixel**2, axis=1))])
    on_ray = ray / np.linalg.norm(ray, axis=1, keepdims=True) * distance[:, None]
    translation = on_ray - np.einsum('nij,nj->ni', rotation[:, :, :2], anchor)
    image = _project(board, focal_px, k_px, rotation, translation)
    return Instances(image, board, focal_px, k_px * focal_px**2, rotation, translation)


def _project(
    board: Array, focal_px: Array, k_px: Array, rotation: Array, translation: Array
) -> Array:
    points = np.einsum('nij,npj->npi', rotation[:, :, :2], board) + translation[:, None]
    xy = focal_px[:, None, None] * points[..., :2]
    z = points[..., 2:]
    rho2 = np.sum(xy**2, axis=-1, keepdims=True)
    with np.errstate(invalid='ignore'):
        root = np.sqrt(z**2 - 4.0 * k_px[:, None, None] * rho2)
    image: Array = 2.0 * xy / (z + root)
    return image


def visible(drawn: Instances) -> Instances:
    """Keep what the camera sees whole, in front of it."""
    inside = np.all(np.abs(drawn.image_points) <= _HALF_SIZE_PX, axis=(1, 2))
    depth = np.einsum('nj,npj->np', drawn.rotation[:, 2, :2], drawn.board_points)
    seen = inside & np.all(depth + drawn.translation[:, 2:] > 0.0, axis=1)
    return Instances(*(getattr(drawn, f)[seen] for f in Instances.__slots__))


def square(rng: np.random.Generator, n: int) -> Array:
    """Return the unit square's corners, n times (n, 4, 2): clockwise from top left."""
    return np.tile(_SQUARE, (n, 1, 1))


def _patch(rng: np.random.Generator, n: int) -> Array:
    """Four points of the unit square, no three of them nearly on a line."""
    drawn = rng.uniform(-0.5, 0.5, (12 * n, 4, 2))
    areas = [
        0.5 * np.abs(_cross(drawn[:, b] - drawn[:, a], drawn[:, c] - drawn[:, a]))
        for a, b, c in ((0, 1, 2), (0, 1, 3), (0, 2, 3), (1, 2, 3))
    ]
    good = drawn[np.min(areas, axis=0) > _MIN_TRIANGLE_AREA][:n]
    # On a fine grid, so that a board that is moved by 1000 units is the same board to the bit.
    on_grid: Array = np.round(good * _GRID) / _GRID
    return on_grid


def _three_collinear(rng: np.random.Generator, n: int) -> Array:
    board = _patch(rng, n)
    share = rng.uniform(0.3, 0.7, (n, 1))
    board[:, 2] = share * board[:, 0] + (1.0 - share) * board[:, 1]
    return board


def _cross(a: Array, b: Array) -> Array:
    product: Array = a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0]
    return product


def tilted(low_deg: float, high_deg: float, about_side: bool = False) -> Rotation:
    """Turn the board about an axis in its plane by the tilt, then about the optical axis."""

    def draw(rng: np.random.Generator, n: int) -> Array:
        tilt = np.radians(rng.uniform(low_deg, high_deg, n))
        azimuth = rng.uniform(0.0, 2.0 * np.pi, n)
        if about_side:
            azimuth = np.round(azimuth / (np.pi / 2.0)) * (np.pi / 2.0)
        roll = rng.uniform(0.0, 2.0 * np.pi, n)
        # The board faces the camera: its x right, y up, z out of it, against the optical axis.
        facing = np.diag([1.0, -1.0, -1.0])
        turned = _about_z(azimuth) @ _about_x(tilt) @ _about_z(-azimuth)
        rotation: Array = _about_z(roll) @ facing @ turned
        return rotation

    return draw


def _about_z(angle: Array) -> Array:
    c, s, zero, one = np.cos(angle), np.sin(angle), np.zeros_like(angle), np.ones_like(angle)
    return np.stack([c, -s, zero, s, c, zero, zero, zero, one], axis=-1).reshape(-1, 3, 3)


def _about_x(angle: Array) -> Array:
    c, s, zero, one = np.cos(angle), np.sin(angle), np.zeros_like(angle), np.ones_like(angle)
    return np.stack([one, zero, zero, zero, c, -s, zero, s, c], axis=-1).reshape(-1, 3, 3)


def anywhere(rng: np.random.Generator, board: Array, rotation: Array) -> tuple[Array, Array]:
    """Put the board's middle on any pixel."""
    n = len(board)
    return np.zeros((n, 2)), rng.uniform(-_HALF_SIZE_PX, _HALF_SIZE_PX, (n, 2))


def _centred(rng: np.random.Generator, board: Array, rotation: Array) -> tuple[Array, Array]:
    return np.zeros((len(board), 2)), np.zeros((len(board), 2))


def _point_at_centre(
    rng: np.random.Generator, board: Array, rotation: Array
) -> tuple[Array, Array]:
    return board[:, 0], np.zeros((len(board), 2))


def _two_on_a_ray(rng: np.random.Generator, board: Array, rotation: Array) -> tuple[Array, Array]:
    """Put the centre on the line through two points: between them, or beyond."""
    share = rng.uniform(-1.0, 2.0, (len(board), 1))
    return share * board[:, 0] + (1.0 - share) * board[:, 1], np.zeros((len(board), 2))


def _point_above_centre(
    rng: np.random.Generator, board: Array, rotation: Array
) -> tuple[Array, Array]:
    n = len(board)
    pixel = np.column_stack([np.zeros(n), rng.uniform(-480.0, 480.0, n)])
    return board[:, 0], pixel


KINDS: dict[str, tuple[Board, Rotation, Placement]] = {
    'patch': (_patch, tilted(0.0, 70.0), anywhere),
    'square': (square, tilted(0.0, 70.0), anywhere),
    'patch, tilt < 3°': (_patch, tilted(0.0, 3.0), anywhere),
    'square, tilt < 3°': (square, tilted(0.0, 3.0), anywhere),
    'square about its side': (square, tilted(5.0, 70.0, about_side=True), anywhere),
    'a point with x = 0': (_patch, tilted(5.0, 70.0), _point_above_centre),
    'a point at the centre': (_patch, tilted(5.0, 70.0), _point_at_centre),
    'three collinear points': (_three_collinear, tilted(5.0, 70.0), anywhere),
    'square centred on the axis': (square, tilted(5.0, 70.0), _centred),
    'two points on one ray': (_patch, tilted(5.0, 70.0), _two_on_a_ray),
}
