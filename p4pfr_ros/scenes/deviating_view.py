# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""
One synthetic view whose camera, board or points deviate from the model, with ground truth.

The model is a division lens with its centre in the middle of the image, square pixels, a global
shutter, a flat board as specified, and independent noise. `Deviations` says what differs from it.

This module stands alone because only tests and benchmarks use it: they measure what an estimate
is worth where the world leaves the model.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
import math
from typing import Literal

import numpy as np
from p4pfr_ros.core.cameras.camera_info import CameraInfoModel
from p4pfr_ros.core.cameras.division import DivisionCamera
from p4pfr_ros.core.geometry import Array, Mask, Pose
from p4pfr_ros.core.model.observation import image_center_px
from p4pfr_ros.scenes.camera_views import board_grid
from p4pfr_ros.scenes.instances import draw_rotations
from p4pfr_ros.scenes.single_view import add_noise_and_outliers

Size = tuple[int, int]
Range = tuple[float, float]
Lens = Literal['division', 'plumb_bob', 'rational_polynomial', 'equidistant']
Camera = DivisionCamera | CameraInfoModel

# Board points, metres: a marker of 150 mm, and 9x6 points that are 25 mm apart.
MARKER = 0.15 * board_grid(2, 2)
BOARD = 0.2 * board_grid(9, 6)

# Ranges in units of R, half the image's diagonal: focal lengths, and of a division lens k r².
_FOCAL = (300.0 / 800.0, 2000.0 / 800.0)
_CORNER_BEND = (-0.5, 0.0)
# A polynomial lens with a shorter focal length is rarely used: from 103 to 44 degrees.
_POLYNOMIAL_FOCAL = (0.8, 2.5)
_DECENTRING = 0.0007  # standard deviation of p1 and p2
_HALF_FOV_DEG = (30.0, 70.0)  # of an equidistant lens, along the diagonal
_EQUIDISTANT_K1 = (-0.03, 0.03)

# Share of the image's width that the board's larger extent fills.
FILL = (0.15, 0.7)
_BORDER_PX = 3.0  # all points are inside the image by this much, before noise
_PLACEMENT_STEPS = 6


@dataclass(frozen=True, slots=True, kw_only=True)
class Deviations:
    """
    How one view deviates from the model; the defaults do not deviate, but for the noise.

    Parameters
    ----------
    shear
        Rolling shutter: u grows by shear (v - cy).
    aspect
        fy / fx of the pixels; the focal length is the geometric mean of both.
    bow_x_m, bow_y_m
        Height of the board's edge over its middle, along x and along y, metres: a cylinder, or
        with both a paraboloid. The board's plane is the mean of the bowed one.
    stretch
        The board is printed wider along x by this share.
    noise_px
        Standard deviation of x and y of the points.
    outlier_share
        Share of the points that are replaced by points uniform in the image.
    hand
        A hand covers half the board: its points are missing, or wrong, uniform where it is.

    """

    shear: float = 0.0
    aspect: float = 1.0
    bow_x_m: float = 0.0
    bow_y_m: float = 0.0
    stretch: float = 0.0
    noise_px: float = 0.2
    outlier_share: float = 0.0
    hand: Literal['none', 'missing', 'wrong'] = 'none'

    def on_board(self, board_points: Array) -> Array:
        """Return the points (N, 3) of the real board, metres, for nominal ones (N, 2)."""
        middle = 0.5 * (board_points.min(axis=0) + board_points.max(axis=0))
        half_size = 0.5 * np.ptp(board_points, axis=0)
        heights = ((board_points - middle) / half_size) ** 2 @ (self.bow_x_m, self.bow_y_m)
        wide = board_points * (1.0 + self.stretch, 1.0)
        return np.column_stack([wide, heights - heights.mean()])

    def in_image(self, pixels: Array, center_px: tuple[float, float]) -> Array:
        """Return where a camera with this aspect ratio and shear sees pixels (N, 2)."""
        root = math.sqrt(self.aspect)
        offsets = (pixels - center_px) * (1.0 / root, root)
        offsets[:, 0] += self.shear * offsets[:, 1]
        seen: Array = offsets + center_px
        return seen


@dataclass(frozen=True, slots=True, eq=False)
class DeviatingView:
    """
    One view of a board, with its ground truth.

    image_points (N, 2) px; board_points (N, 2): the nominal ones, metres; outlier (N,) bool;
    camera: without the deviations; deviations: those of this view.
    """

    image_points: Array
    board_points: Array
    outlier: Mask
    camera: Camera
    camera_from_board: Pose
    deviations: Deviations

    @property
    def focal_px(self) -> float:
        """The focal length at the centre, px."""
        return float(np.mean(self.camera.focal_px))

    @property
    def k(self) -> float:
        """The distortion of the division model; NaN for other lenses."""
        return self.camera.k if isinstance(self.camera, DivisionCamera) else math.nan


def draw_lens(
    rng: np.random.Generator, image_size: Size, lens: Lens = 'division', center_share: float = 0.0
) -> Camera:
    """
    Draw a camera of an image size (width, height).

    center_share: distance of the centre from the middle of the image, in widths; its direction is
    random.
    """
    angle = rng.uniform(0.0, 2.0 * math.pi)
    x, y = image_center_px(image_size)
    off_px = center_share * image_size[0]
    center_px = x + off_px * math.cos(angle), y + off_px * math.sin(angle)
    corner_px = 0.5 * math.hypot(*image_size)
    if lens == 'division':
        focal = math.exp(rng.uniform(*np.log(_FOCAL)))
        k = rng.uniform(*_CORNER_BEND) * focal**2
        return DivisionCamera(focal * corner_px, center_px, k)
    while True:
        focal, coefficients = _DRAW[lens](rng)
        focal_px = focal * corner_px, focal * corner_px
        camera = CameraInfoModel(lens, coefficients, focal_px, center_px, 0.0, image_size)
        width, height = image_size
        corners = [(0, 0), (width, 0), (0, height), (width, height)]
        if np.isfinite(camera.unproject(np.array(corners, dtype=np.float64))).all():
            return camera


def _plumb_bob(rng: np.random.Generator) -> tuple[float, tuple[float, ...]]:
    """Draw focal length in R and coefficients; the terms are drawn at the image's corner."""
    focal = math.exp(rng.uniform(*np.log(_POLYNOMIAL_FOCAL)))
    corner = 1.0 / focal**2  # |d|² there
    first = rng.uniform(-0.25, 0.05)
    second = -rng.uniform(0.0, 0.4) * first
    p1, p2 = rng.normal(0.0, _DECENTRING, 2)
    return focal, (first / corner, second / corner**2, float(p1), float(p2), 0.0)


def _rational(rng: np.random.Generator) -> tuple[float, tuple[float, ...]]:
    """Draw as `_plumb_bob` does; the denominator bends more, as in fits of wide lenses."""
    focal = math.exp(rng.uniform(*np.log(_POLYNOMIAL_FOCAL)))
    corner = 1.0 / focal**2
    above = rng.uniform(0.0, 0.3)
    below = above + rng.uniform(-0.05, 0.25)
    second = rng.uniform(0.0, 0.1)
    p1, p2 = (float(p) for p in rng.normal(0.0, _DECENTRING, 2))
    rest = (below / corner, second / corner**2, 0.0)
    return focal, (above / corner, 0.0, p1, p2, 0.0, *rest)


def _equidistant(rng: np.random.Generator) -> tuple[float, tuple[float, ...]]:
    corner_rad = math.radians(rng.uniform(*_HALF_FOV_DEG))
    k1 = rng.uniform(*_EQUIDISTANT_K1)
    return 1.0 / (corner_rad * (1.0 + k1 * corner_rad**2)), (k1, 0.0, 0.0, 0.0)


_DRAW: dict[str, Callable[[np.random.Generator], tuple[float, tuple[float, ...]]]] = {
    'plumb_bob': _plumb_bob,
    'rational_polynomial': _rational,
    'equidistant': _equidistant,
}


def draw_deviating_view(
    rng: np.random.Generator,
    camera: Camera,
    image_size: Size,
    board_points: Array,
    deviations: Deviations,
    *,
    tilt_deg: Range = (10.0, 60.0),
    fill: Range = FILL,
) -> DeviatingView:
    """
    Draw a view of board points (N, 2), metres, all of them inside the image.

    tilt_deg: range of the tilt against the image plane; fill: range of the larger extent of the
    points in the image, in widths of the image.
    """
    real = deviations.on_board(board_points)
    while True:
        rotation = draw_rotations(rng, 1, tilt_deg)[0]
        pixel, extent_px = rng.uniform((0, 0), image_size), rng.uniform(*fill) * image_size[0]
        pose = _placed(rotation, pixel, extent_px, real, camera)
        if pose is None:
            continue
        in_camera = pose.transform(real)
        seen = deviations.in_image(camera.project(in_camera), camera.center_px)
        inside = (seen > _BORDER_PX) & (seen < np.subtract(image_size, 1.0 + _BORDER_PX))
        # The printed side faces the camera.
        if inside.all() and (in_camera @ rotation[:, 2] < 0.0).all():
            break
    image, outlier = add_noise_and_outliers(
        rng, seen, deviations.noise_px, deviations.outlier_share, image_size
    )
    shown = np.ones(len(image), dtype=bool)
    if deviations.hand != 'none':
        shown, image, outlier = _covered(rng, deviations, board_points, image, outlier)
    return DeviatingView(
        image[shown], board_points[shown], outlier[shown], camera, pose, deviations
    )


def _placed(
    rotation: Array, pixel: Array, extent_px: float, board: Array, camera: Camera
) -> Pose | None:
    """Return the pose with the board's origin at a pixel and a given extent; None if unseen."""
    ray = camera.unproject(pixel)
    distance = 10.0 * float(np.ptp(board[:, :2], axis=0).max())
    # The extent in the image is nearly proportional to 1 / distance.
    for _ in range(_PLACEMENT_STEPS):
        pixels = camera.project(board @ rotation.T + distance * ray)
        if not np.isfinite(pixels).all():
            return None
        distance *= float(np.ptp(pixels, axis=0).max()) / extent_px
    return Pose(rotation, distance * ray)


def _covered(
    rng: np.random.Generator,
    deviations: Deviations,
    board_points: Array,
    image: Array,
    outlier: Mask,
) -> tuple[Mask, Array, Mask]:
    """Cover one half of the board, on a random side of its middle; return what is shown."""
    angle = rng.uniform(0.0, 2.0 * math.pi)
    across = (board_points - board_points.mean(axis=0)) @ (math.cos(angle), math.sin(angle))
    hidden = across > np.median(across)
    if deviations.hand == 'missing':
        return ~hidden, image, outlier
    low, high = image[hidden].min(axis=0), image[hidden].max(axis=0)
    wrong = rng.uniform(low, high, (int(hidden.sum()), 2))
    image, outlier = image.copy(), outlier | hidden
    image[hidden] = wrong
    return np.ones_like(hidden), image, outlier
