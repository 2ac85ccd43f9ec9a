# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""Pictures of a board as a camera sees it, exact to the area of each pixel."""

from __future__ import annotations

import math

import cv2
import numpy as np
from numpy.typing import NDArray
from p4pfr_ros.boards import Board
from p4pfr_ros.core.cameras.division import DivisionCamera
from p4pfr_ros.core.geometry import Array, Pose
from p4pfr_ros.rendering.outlines import Outlines
from p4pfr_ros.rendering.pattern import black_quads, quads
from p4pfr_ros.rendering.rasterizer import coverage


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
    Draw a board as a camera sees it: (h, w) uint8. See `Renderer` for the parameters.

    For many pictures through one camera, a `Renderer` is kept.
    """
    renderer = Renderer(
        camera, image_size, background=background, black=black, white=white, falloff=falloff
    )
    return renderer.render(
        board, camera_from_board, blur_sigma_px=blur_sigma_px, noise_sigma=noise_sigma, seed=seed
    )


class Renderer:
    """
    A camera that takes pictures of boards.

    A pixel is the mean of the scene over its square, which is computed exactly, not sampled; then
    come blur, noise and rounding. Pixel centres are integers.

    Parameters
    ----------
    camera
        The camera. What lies behind its image plane (z ≤ 0) is not shown, even where the lens
        would see it.
    image_size
        Width and height, pixels.
    background
        Grey level around the board: one number, or (h, w) of them.
    black, white
        Grey levels of the print and of the paper.
    falloff
        Part of the light that is lost in the corners of the image, 0 to 1; it grows with the
        square of the distance to the middle.

    Raises
    ------
    ValueError
        A size that is not positive, a grey level or falloff out of its range.

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
        self._outlines = Outlines(camera, (width, height))

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
        Take one picture: (h, w) uint8.

        Parameters
        ----------
        board
            What is seen: its pattern on a white sheet. The sheet's back is blank.
        camera_from_board
            Where it is.
        blur_sigma_px
            Gaussian blur of the lens, pixels.
        noise_sigma
            Gaussian noise of the sensor, grey levels.
        seed
            Of the noise: the same seed, the same picture.

        """
        for name, value in (('blur_sigma_px', blur_sigma_px), ('noise_sigma', noise_sigma)):
            if not 0.0 <= value < math.inf:
                raise ValueError(f'{name} must be ≥ 0, got {value}')
        picture = self._scene(board, camera_from_board)
        if blur_sigma_px > 0.0:
            picture = cv2.GaussianBlur(
                picture, (0, 0), blur_sigma_px, borderType=cv2.BORDER_REPLICATE
            )
        if noise_sigma > 0.0:
            noise = np.random.default_rng(seed).standard_normal(picture.shape, dtype=np.float32)
            picture = picture + np.float32(noise_sigma) * noise
        return np.rint(np.clip(picture, 0.0, 255.0)).astype(np.uint8)

    def _scene(self, board: Board, camera_from_board: Pose) -> NDArray[np.float32]:
        width_m, height_m = board.sheet_size_m
        sheet = 0.5 * np.array([[-width_m, -height_m, width_m, height_m]])
        paper = self._coverage(quads(sheet), camera_from_board)
        scene = self._background + np.abs(paper) * (self._white - self._background)
        # The camera is before the board where the board's z axis points towards it.
        if camera_from_board.rotation[:, 2] @ camera_from_board.translation < 0.0:
            ink = self._coverage(black_quads(board), camera_from_board)
            scene = scene - ink * (self._white - self._black)
        if self._light is not None:
            scene = scene * self._light
        return scene.astype(np.float32)

    def _coverage(self, shapes: Array, camera_from_board: Pose) -> Array:
        """Return how much of each pixel shapes (N, 4, 2) of the board cover."""
        return coverage(self._outlines.edges(shapes, camera_from_board), self.image_size)


def _checked_size(image_size: tuple[int, int]) -> tuple[int, int]:
    width, height = int(image_size[0]), int(image_size[1])
    if width < 1 or height < 1:
        raise ValueError(f'image_size must be positive (width, height), got {image_size}')
    return width, height


def _light(width: int, height: int, falloff: float) -> Array:
    x = (np.arange(width) - 0.5 * (width - 1)) / (0.5 * width)
    y = (np.arange(height) - 0.5 * (height - 1)) / (0.5 * height)
    light: Array = 1.0 - 0.5 * falloff * (x**2 + y[:, None] ** 2)
    return light
