# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""
Minimal problems with ground truth: four points of a marker in a distorted image.

The marker is in front of a 1280x960 camera with f from 300 to 2000 px and k r² at the image
corner from -0.5 to 0, and is projected without noise in double precision.
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
_UNIT_SQUARE = np.array([[-0.5, 0.5], [0.5, 0.5], [0.5, -0.5], [-0.5, -0.5]])

# Range of the marker's size in the image: from barely visible to nearly filling it.
_LOG_MARKER_SIZE_PX = (math.log(60.0), math.log(900.0))

# Four random points in the unit square are rejected if any triangle of them is smaller.
_MIN_TRIANGLE_AREA = 0.02
# Steps per unit of the grid that board coordinates are rounded to.
_GRID = 2.0**40


@dataclass(frozen=True, slots=True, eq=False)
class Instances:
    """
    n minimal problems and their ground truth.

    image_points (n, 4, 2) in px relative to the distortion centre, board_points (n, 4, 2) in
    marker sizes, focal_px (n,), k (n,) dimensionless, rotation (n, 3, 3), translation (n, 3).
    """

    image_points: Array
    board_points: Array
    focal_px: Array
    k: Array
    rotation: Array
    translation: Array

    def __len__(self) -> int:
        return len(self.focal_px)


# From (rng, n): the points (n, 4, 2) of n boards.
DrawBoards = Callable[[np.random.Generator, int], Array]
# From (rng, boards): one point (n, 2) of each board, and the pixel (n, 2), relative to the centre,
# that it projects to.
Place = Callable[[np.random.Generator, Array], tuple[Array, Array]]


@dataclass(frozen=True, slots=True)
class InstanceKind:
    """
    How to draw one kind of instances.

    Parameters
    ----------
    draw_boards
        Draws the board points.
    place
        Chooses the position in the image.
    tilt_deg
        Range of the tilt of the board against the image plane, degrees.
    about_side
        Whether the tilt axis is parallel to a side of the unit square.

    """

    draw_boards: DrawBoards
    place: Place
    tilt_deg: tuple[float, float] = (5.0, 70.0)
    about_side: bool = False


def draw_instances(kind: str, n: int, seed: int = 0) -> Instances:
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
        batches.append(select_visible(draw_batch(rng, 2 * n + 16, KINDS[kind])))
    fields = zip(*((getattr(b, f) for f in Instances.__slots__) for b in batches), strict=True)
    return Instances(*(np.concatenate(parts)[:n] for parts in fields))


def draw_batch(rng: np.random.Generator, n: int, kind: InstanceKind) -> Instances:
    """Draw n boards, cameras and poses; some boards are not entirely inside the image."""
    low, high = np.log(300.0), np.log(2000.0)
    focal_px = np.exp(rng.uniform(low, high, n))
    k_px = rng.uniform(-0.5, 0.0, n) / _CORNER_RADIUS_PX**2
    board = kind.draw_boards(rng, n)
    rotation = draw_rotations(rng, n, kind.tilt_deg, about_side=kind.about_side)
    anchor, pixel = kind.place(rng, board)
    # The anchor lies on the ray through its pixel, at the distance that gives the marker its size.
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


def select_visible(instances: Instances) -> Instances:
    """Return the instances with all points inside the image and in front of the camera."""
    inside = np.all(np.abs(instances.image_points) <= _HALF_SIZE_PX, axis=(1, 2))
    depth = np.einsum('nj,npj->np', instances.rotation[:, 2, :2], instances.board_points)
    visible = inside & np.all(depth + instances.translation[:, 2:] > 0.0, axis=1)
    return Instances(*(getattr(instances, f)[visible] for f in Instances.__slots__))


def unit_squares(rng: np.random.Generator, n: int) -> Array:
    """Return the corners (n, 4, 2) of n unit squares, clockwise from the top left."""
    return np.tile(_UNIT_SQUARE, (n, 1, 1))


def _random_quads(rng: np.random.Generator, n: int) -> Array:
    """Draw four points in the unit square, no three of them nearly collinear."""
    quads = rng.uniform(-0.5, 0.5, (12 * n, 4, 2))
    areas = [
        0.5 * np.abs(_cross(quads[:, b] - quads[:, a], quads[:, c] - quads[:, a]))
        for a, b, c in ((0, 1, 2), (0, 1, 3), (0, 2, 3), (1, 2, 3))
    ]
    good = quads[np.min(areas, axis=0) > _MIN_TRIANGLE_AREA][:n]
    # Rounded to a fine grid, so that moving a board by 1000 units is exact in double precision.
    on_grid: Array = np.round(good * _GRID) / _GRID
    return on_grid


def _quads_with_three_collinear(rng: np.random.Generator, n: int) -> Array:
    board = _random_quads(rng, n)
    share = rng.uniform(0.3, 0.7, (n, 1))
    board[:, 2] = share * board[:, 0] + (1.0 - share) * board[:, 1]
    return board


def _cross(a: Array, b: Array) -> Array:
    product: Array = a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0]
    return product


def draw_rotations(
    rng: np.random.Generator, n: int, tilt_deg: tuple[float, float], *, about_side: bool = False
) -> Array:
    """
    Draw rotations (n, 3, 3) ``camera_from_board`` of boards that face the camera.

    Each is a tilt in the range tilt_deg about a random axis in the board's plane (about_side: a
    multiple of 90° from its x axis), then a random roll about the optical axis.
    """
    tilt = np.radians(rng.uniform(*tilt_deg, n))
    azimuth = rng.uniform(0.0, 2.0 * np.pi, n)
    if about_side:
        azimuth = np.round(azimuth / (np.pi / 2.0)) * (np.pi / 2.0)
    roll = rng.uniform(0.0, 2.0 * np.pi, n)
    # Head-on: the board's x right, y up, z against the optical axis.
    head_on = np.diag([1.0, -1.0, -1.0])
    tilted = _about_z(azimuth) @ _about_x(tilt) @ _about_z(-azimuth)
    rotation: Array = _about_z(roll) @ head_on @ tilted
    return rotation


def _about_z(angle: Array) -> Array:
    c, s, zero, one = np.cos(angle), np.sin(angle), np.zeros_like(angle), np.ones_like(angle)
    return np.stack([c, -s, zero, s, c, zero, zero, zero, one], axis=-1).reshape(-1, 3, 3)


def _about_x(angle: Array) -> Array:
    c, s, zero, one = np.cos(angle), np.sin(angle), np.zeros_like(angle), np.ones_like(angle)
    return np.stack([one, zero, zero, zero, c, -s, zero, s, c], axis=-1).reshape(-1, 3, 3)


def place_anywhere(rng: np.random.Generator, board: Array) -> tuple[Array, Array]:
    """Place the board's origin on a random pixel."""
    n = len(board)
    return np.zeros((n, 2)), rng.uniform(-_HALF_SIZE_PX, _HALF_SIZE_PX, (n, 2))


def _place_at_centre(rng: np.random.Generator, board: Array) -> tuple[Array, Array]:
    return np.zeros((len(board), 2)), np.zeros((len(board), 2))


def _place_point_at_centre(rng: np.random.Generator, board: Array) -> tuple[Array, Array]:
    return board[:, 0], np.zeros((len(board), 2))


def _place_two_on_a_ray(rng: np.random.Generator, board: Array) -> tuple[Array, Array]:
    """Place the centre on the line through two points, between or beyond them."""
    share = rng.uniform(-1.0, 2.0, (len(board), 1))
    return share * board[:, 0] + (1.0 - share) * board[:, 1], np.zeros((len(board), 2))


def _place_point_above_centre(rng: np.random.Generator, board: Array) -> tuple[Array, Array]:
    n = len(board)
    pixel = np.column_stack([np.zeros(n), rng.uniform(-480.0, 480.0, n)])
    return board[:, 0], pixel


KINDS: dict[str, InstanceKind] = {
    'patch': InstanceKind(_random_quads, place_anywhere, (0.0, 70.0)),
    'square': InstanceKind(unit_squares, place_anywhere, (0.0, 70.0)),
    'patch, tilt < 3°': InstanceKind(_random_quads, place_anywhere, (0.0, 3.0)),
    'square, tilt < 3°': InstanceKind(unit_squares, place_anywhere, (0.0, 3.0)),
    'square about its side': InstanceKind(unit_squares, place_anywhere, about_side=True),
    'a point with x = 0': InstanceKind(_random_quads, _place_point_above_centre),
    'a point at the centre': InstanceKind(_random_quads, _place_point_at_centre),
    'three collinear points': InstanceKind(_quads_with_three_collinear, place_anywhere),
    'square centred on the axis': InstanceKind(unit_squares, _place_at_centre),
    'two points on one ray': InstanceKind(_random_quads, _place_two_on_a_ray),
}
