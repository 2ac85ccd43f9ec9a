# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""
Images of a board through a camera, with exact area coverage of each pixel.

This module stands alone: it holds the public functions; ``pattern`` has the shapes to draw and
``rasterizer`` their pixel coverage.
"""

from __future__ import annotations

import math

import cv2
import numpy as np
from numpy.typing import NDArray
from p4pfr_ros.boards import Board
from p4pfr_ros.core.cameras.division import DivisionCamera
from p4pfr_ros.core.geometry import Array, Pose
from p4pfr_ros.rendering.pattern import black_shapes, quads
from p4pfr_ros.rendering.rasterizer import coverage

# A curved edge is approximated by chords with at most this error.
_CHORD_ERROR_PX = 2e-3
_MAX_BISECTIONS = 16
# Near plane: the board is clipped at this fraction of its distance from the camera.
_NEAR = 1e-3


def render(
    board: Board,
    camera: DivisionCamera,
    camera_from_board: Pose,
    image_size: tuple[int, int],
    *,
    background: float | Array = 110.0,
    black: float = 25.0,
    white: float = 220.0,
    falloff: float = 0.0,
    blur_sigma_px: float = 0.0,
    noise_sigma: float = 0.0,
    seed: int = 0,
) -> NDArray[np.uint8]:
    """
    Render a board as a camera sees it: (h, w) uint8. See `Renderer` for the parameters.

    For many images through one camera, create a `Renderer` once.
    """
    renderer = Renderer(
        camera, image_size, background=background, black=black, white=white, falloff=falloff
    )
    return renderer.render(
        board, camera_from_board, blur_sigma_px=blur_sigma_px, noise_sigma=noise_sigma, seed=seed
    )


class Renderer:
    """
    A simulated camera for images of boards.

    A pixel is the mean of the scene over its area, computed exactly, without sampling; blur, noise
    and rounding follow. Pixel centres are integers.

    Parameters
    ----------
    camera
        The camera. Everything behind its image plane (z ≤ 0) is clipped, even where the lens
        would see it.
    image_size
        Width and height, pixels.
    background
        Grey level around the board: a number, or an array (h, w).
    black, white
        Grey levels of the print and of the paper.
    falloff
        Fraction of the light lost in the corners of the image, 0 to 1; it grows with the square
        of the distance to the centre.

    Raises
    ------
    ValueError
        A size that is not positive, or a grey level or falloff out of range.

    """

    def __init__(
        self,
        camera: DivisionCamera,
        image_size: tuple[int, int],
        *,
        background: float | Array = 110.0,
        black: float = 25.0,
        white: float = 220.0,
        falloff: float = 0.0,
    ) -> None:
        width, height = _checked_size(image_size)
        self.camera = camera
        self.image_size = width, height
        levels = np.asarray(background, dtype=np.float64)
        if levels.shape not in ((), (height, width)):
            raise ValueError(
                f'background must be a number or {(height, width)}, got {levels.shape}'
            )
        for name, level in (('background', levels), ('black', black), ('white', white)):
            if not ((np.asarray(level) >= 0.0) & (np.asarray(level) <= 255.0)).all():
                raise ValueError(f'{name} must be within 0 to 255, got {level}')
        if not 0.0 <= falloff <= 1.0:
            raise ValueError(f'falloff must be within 0 to 1, got {falloff}')
        self._background, self._black, self._white = levels, black, white
        self._light = _light(width, height, falloff) if falloff > 0.0 else None
        self._edge_px = _edge_of_view_px(camera, width, height)

    def render(
        self,
        board: Board,
        camera_from_board: Pose,
        *,
        blur_sigma_px: float = 0.0,
        noise_sigma: float = 0.0,
        seed: int = 0,
    ) -> NDArray[np.uint8]:
        """
        Render one image: (h, w) uint8.

        Parameters
        ----------
        board
            The board: its pattern on a white sheet. The back of the sheet is blank.
        camera_from_board
            Pose of the board.
        blur_sigma_px
            Gaussian blur of the lens, pixels.
        noise_sigma
            Gaussian noise of the sensor, grey levels.
        seed
            Seed of the noise.

        """
        for name, value in (('blur_sigma_px', blur_sigma_px), ('noise_sigma', noise_sigma)):
            if not 0.0 <= value < math.inf:
                raise ValueError(f'{name} must be ≥ 0, got {value}')
        image = self._scene(board, camera_from_board)
        if blur_sigma_px > 0.0:
            image = cv2.GaussianBlur(image, (0, 0), blur_sigma_px, borderType=cv2.BORDER_REPLICATE)
        if noise_sigma > 0.0:
            noise = np.random.default_rng(seed).standard_normal(image.shape, dtype=np.float32)
            image = image + np.float32(noise_sigma) * noise
        return np.rint(np.clip(image, 0.0, 255.0)).astype(np.uint8)

    def _scene(self, board: Board, camera_from_board: Pose) -> NDArray[np.float32]:
        width_m, height_m = board.sheet_size_m
        sheet = 0.5 * np.array([[-width_m, -height_m, width_m, height_m]])
        paper = self._coverage(quads(sheet), camera_from_board)
        # An inverted board is printed white on black; 'any' is rendered black on white.
        inverted = board.inverted is True
        sheet_level = self._black if inverted else self._white
        ink_level = self._white if inverted else self._black
        scene = self._background + np.abs(paper) * (sheet_level - self._background)
        # The camera sees the printed side if the board's z axis points towards it.
        if camera_from_board.rotation[:, 2] @ camera_from_board.translation < 0.0:
            ink = self._coverage(black_shapes(board), camera_from_board)
            scene = scene + ink * (ink_level - sheet_level)
        if self._light is not None:
            scene = scene * self._light
        return scene.astype(np.float32)

    def _coverage(self, shapes: Array, camera_from_board: Pose) -> Array:
        """Return the fraction (h, w) of each pixel that polygons (N, n, 2) of the board cover."""
        return coverage(self._edges(shapes, camera_from_board), self.image_size)

    def _edges(self, shapes: Array, camera_from_board: Pose) -> Array:
        """
        Return the edges (M, 4) of the projected polygons: x0, y0, x1, y1 px.

        Polygons (N, n, 2) are corners in metres in the board frame, clockwise. Seen from the
        front, they are clockwise in the image too.
        """
        points = camera_from_board.transform(np.pad(shapes, ((0, 0), (0, 0), (0, 1))))
        near = _NEAR * float(np.linalg.norm(camera_from_board.translation))
        in_front = (points[..., 2] >= near).all(axis=1)
        whole = _sides(points[in_front])
        clipped = [_sides(_clip(polygon, near)[None]) for polygon in points[~in_front]]
        return self._chords(np.concatenate([whole, *clipped]))

    def _chords(self, sides: Array) -> Array:
        """Project straight sides (N, 2, 3) in the camera frame to chords (M, 4) in the image."""
        chords = []
        for bisections_left in range(_MAX_BISECTIONS, -1, -1):
            ends = self._project(sides)
            middle = sides.mean(axis=1)
            bent = _distance_to_chord(self._project(middle), ends) > _CHORD_ERROR_PX
            if not bisections_left:
                bent[:] = False
            chords.append(ends[~bent].reshape(-1, 4))
            if not bent.any():
                break
            first = np.stack([sides[bent, 0], middle[bent]], axis=1)
            second = np.stack([middle[bent], sides[bent, 1]], axis=1)
            sides = np.concatenate([first, second])
        return np.concatenate(chords)

    def _project(self, points: Array) -> Array:
        """Project points; those outside the lens's view move to its edge, in their direction."""
        pixels = self.camera.project(points)
        invisible = ~np.isfinite(pixels).all(axis=-1)
        if invisible.any():
            xy = points[invisible, :2]
            direction = xy / np.maximum(np.linalg.norm(xy, axis=1, keepdims=True), 1e-300)
            pixels[invisible] = self.camera.center_px + self._edge_px * direction
        return pixels


def _checked_size(image_size: tuple[int, int]) -> tuple[int, int]:
    width, height = int(image_size[0]), int(image_size[1])
    if width < 1 or height < 1:
        raise ValueError(f'image_size must be positive (width, height), got {image_size}')
    return width, height


def _light(width: int, height: int, falloff: float) -> Array:
    """Return the relative illumination (h, w)."""
    x = (np.arange(width) - 0.5 * (width - 1)) / (0.5 * width)
    y = (np.arange(height) - 0.5 * (height - 1)) / (0.5 * height)
    light: Array = 1.0 - 0.5 * falloff * (x**2 + y[:, None] ** 2)
    return light


def _edge_of_view_px(camera: DivisionCamera, width: int, height: int) -> float:
    """Return the radius at which rays stop turning outwards, or one well outside the image."""
    corners = np.array([[0, 0], [width, 0], [0, height], [width, height]]) - camera.center_px
    outside = 2.0 * float(np.linalg.norm(corners, axis=1).max())
    radii = np.linspace(0.0, outside, 2048)
    rays = camera.unproject(np.stack([radii, np.zeros_like(radii)], axis=1) + camera.center_px)
    folds = np.diff(np.arctan2(rays[:, 0], rays[:, 2])) <= 0.0
    return float(radii[np.argmax(folds)]) if folds.any() else outside


def _sides(polygons: Array) -> Array:
    """Return the sides (N * n, 2, 3) of polygons (N, n, 3)."""
    return np.stack([polygons, np.roll(polygons, -1, axis=1)], axis=2).reshape(-1, 2, 3)


def _clip(polygon: Array, near: float) -> Array:
    """Clip a polygon (n, 3) to z ≥ near (Sutherland-Hodgman): (m, 3)."""
    clipped = []
    for a, b in zip(polygon, np.roll(polygon, -1, axis=0), strict=True):
        if a[2] >= near:
            clipped.append(a)
        if (a[2] >= near) != (b[2] >= near):
            clipped.append(a + (near - a[2]) / (b[2] - a[2]) * (b - a))
    return np.array(clipped).reshape(-1, 3)


def _distance_to_chord(points: Array, ends: Array) -> Array:
    """Return the distances (N,) of points (N, 2) from the lines through ends (N, 2, 2)."""
    along = ends[:, 1] - ends[:, 0]
    offset = points - ends[:, 0]
    length = np.maximum(np.linalg.norm(along, axis=1), 1e-12)
    distance: Array = np.abs(along[:, 0] * offset[:, 1] - along[:, 1] * offset[:, 0]) / length
    return distance
