# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""
Images for the benchmark of detection: rendered boards with their true corners, and no boards.

This module stands apart from ``detection``, which measures: it makes the images.
"""

from __future__ import annotations

from collections.abc import Iterator
import os
from pathlib import Path
from typing import NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray
from p4pfr_ros import DivisionCamera, Pose
from p4pfr_ros.boards import AprilGrid, Board, Charuco, Chessboard, CircleGrid, Marker, MarkerGrid
from p4pfr_ros.core.geometry import Array
from p4pfr_ros.rendering import Renderer

Grey = NDArray[np.uint8]

SIZES = ((640, 480), (1280, 960), (1920, 1080), (3840, 2160))

BOARDS: dict[str, Board] = {
    'chessboard 9x6': Chessboard(columns=9, rows=6, square_m=0.025),
    'ArUco': Marker(id=7, size_m=0.12, dictionary='DICT_6X6_250'),
    'AprilTag': Marker(id=7, size_m=0.12, dictionary='DICT_APRILTAG_36h11'),
    'AprilTag grid 6x6': MarkerGrid(
        columns=6, rows=6, marker_m=0.03, separation_m=0.009, dictionary='DICT_APRILTAG_36h11'
    ),
    'ChArUco 5x7': Charuco(
        columns=5, rows=7, square_m=0.035, marker_m=0.026, dictionary='DICT_4X4_50'
    ),
    'Kalibr grid 6x6': AprilGrid(columns=6, rows=6, tag_m=0.03, spacing=0.3),
    'circles 7x5': CircleGrid(columns=7, rows=5, spacing_m=0.03, diameter_m=0.018),
    'circles 4x11': CircleGrid(
        columns=4, rows=11, spacing_m=0.02, diameter_m=0.012, asymmetric=True
    ),
}

# Tilt about x and y, roll, distance in widths of the board's sheet, offset in distances.
_VIEWS = (
    ((0.0, 0.0), 0.05, 1.6, (0.02, 0.01)),
    ((0.5, 0.0), -0.1, 1.7, (-0.1, 0.05)),
    ((0.0, -0.6), 0.2, 1.8, (0.1, 0.0)),
    ((0.4, 0.5), 0.4, 2.0, (0.05, -0.1)),
    ((-0.6, 0.3), -0.3, 2.4, (-0.15, -0.05)),
    ((0.2, -0.3), 0.8, 2.4, (0.0, 0.1)),
    ((-0.3, -0.3), 1.5, 3.0, (0.2, 0.1)),
    ((0.1, 0.7), 0.1, 2.2, (0.0, 0.0)),
)
# Rows and columns of a computer screen in the photographs, which shows the board, too.
_SCREEN = slice(190, 410), slice(0, 150)
_BLUR_SIGMA_PX, _NOISE_SIGMA = 0.7, 2.0


class View(NamedTuple):
    """A rendered image of a board, and the true pixels (N, 2) of the board's points."""

    image: Grey
    truth: Array


def views(board: Board, size: tuple[int, int]) -> list[View]:
    """Render a board through a camera with barrel distortion, in several poses."""
    width, height = size
    camera = DivisionCamera(0.8 * width, (0.5 * (width - 1), 0.5 * (height - 1)), -0.1)
    renderer = Renderer(camera, size, falloff=0.3)
    return [
        View(
            renderer.render(
                board, pose, blur_sigma_px=_BLUR_SIGMA_PX, noise_sigma=_NOISE_SIGMA, seed=seed
            ),
            camera.project(pose.transform(np.pad(board.points, ((0, 0), (0, 1))))),
        )
        for seed, pose in enumerate(_poses(board))
    ]


def _poses(board: Board) -> Iterator[Pose]:
    face = Pose(np.diag([1.0, -1.0, -1.0]), np.zeros(3))
    for tilt, roll, widths, offset in _VIEWS:
        distance = widths * max(board.sheet_size_m)
        tilted = Pose.from_rotation_vector(
            (*tilt, 0.0), (*np.multiply(offset, distance), distance)
        )
        yield tilted @ Pose.from_rotation_vector((0.0, 0.0, roll), np.zeros(3)) @ face


def contents(size: tuple[int, int]) -> dict[str, list[Grey]]:
    """Make images without a board: photographs, textures and blocks."""
    rng = np.random.default_rng(5)
    return {
        'photographs': _photographs(size),
        'cloud texture': [_clouds(rng, size) for _ in range(2)],
        'blocks at random': [_rectangles(rng, size) for _ in range(2)],
        'mosaic of blocks': [_mosaic(rng, size, side) for side in (8, 20)],
    }


def hard_contents(size: tuple[int, int]) -> dict[str, list[Grey]]:
    """Make images full of structure, on which a search may lose itself."""
    width, height = size
    rng = np.random.default_rng(5)
    y, x = np.indices((height, width))
    chequer = ((x + y) % 2 * 255).astype(np.uint8)
    grating = _as_levels(127.5 + 100.0 * np.sin(0.7 * x + 0.3 * y))
    return {
        'noise': [rng.integers(0, 256, (height, width), dtype=np.uint8)],
        'blurred noise': [_blurred_noise(rng, size)],
        'grating': [grating],
        'crossed gratings': [_crossed(size, period) for period in (6.0, 11.3)],
        'one-pixel chequerboard': [chequer],
        'Bayer mosaic': [_bayer(_clouds(rng, size))],
    }


def _photographs(size: tuple[int, int]) -> list[Grey]:
    """Return photographs of P4PFR_DATA, the chessboards in them painted over, at a size."""
    folder = os.environ.get('P4PFR_DATA')
    paths = sorted(Path(folder).glob('left*.jpg')) if folder else []
    return [
        cv2.resize(_without_board(path), size, interpolation=cv2.INTER_CUBIC) for path in paths
    ]


def _without_board(path: Path) -> Grey:
    image = np.asarray(cv2.imread(str(path), cv2.IMREAD_GRAYSCALE), dtype=np.uint8)
    found, corners = cv2.findChessboardCorners(image, (9, 6))
    if not found:
        raise ValueError(f'{path}: no chessboard to paint over')
    grid = corners.reshape(6, 9, 2)
    # The board's outline: its corners and one square more on all sides.
    outer = np.stack([2.2 * grid[i, j] - 1.2 * grid[k, m] for i, j, k, m in (
        (0, 0, 1, 1), (0, 8, 1, 7), (5, 8, 4, 7), (5, 0, 4, 1))])  # fmt: skip
    mask = np.zeros_like(image)
    cv2.fillConvexPoly(mask, np.rint(outer).astype(np.int32), 255)
    mask[_SCREEN] = 255
    return np.asarray(cv2.inpaint(image, mask, 3.0, cv2.INPAINT_TELEA), dtype=np.uint8)


def _clouds(rng: np.random.Generator, size: tuple[int, int]) -> Grey:
    """Return noise whose spectrum falls with the frequency, as that of natural images does."""
    width, height = size
    frequency = np.hypot(np.fft.fftfreq(height)[:, None], np.fft.rfftfreq(width))
    spectrum = np.fft.rfft2(rng.standard_normal((height, width))) / np.maximum(frequency, 1e-3)
    texture = np.fft.irfft2(spectrum, (height, width))
    return _as_levels(128.0 + 50.0 * texture / texture.std())


def _rectangles(rng: np.random.Generator, size: tuple[int, int]) -> Grey:
    image = np.full(size[::-1], 128, np.uint8)
    for _ in range(1500):
        x, y = rng.uniform(0.0, 1.0, 2) * size
        sides = rng.uniform(0.01, 0.06, 2) * size[0]
        corners = cv2.boxPoints(((x, y), sides, rng.choice([0.0, rng.uniform(0.0, 90.0)])))
        cv2.fillConvexPoly(image, np.rint(corners).astype(np.int32), int(rng.integers(256)))
    return image


def _mosaic(rng: np.random.Generator, size: tuple[int, int], side: int) -> Grey:
    width, height = size
    levels = rng.integers(0, 256, (height // side + 1, width // side + 1), dtype=np.uint8)
    return np.ascontiguousarray(np.kron(levels, np.ones((side, side), np.uint8))[:height, :width])


def _blurred_noise(rng: np.random.Generator, size: tuple[int, int]) -> Grey:
    noise = cv2.GaussianBlur(rng.standard_normal(size[::-1]), (0, 0), 2.0)
    return _as_levels(128.0 + 60.0 * noise / noise.std())


def _crossed(size: tuple[int, int], period_px: float) -> Grey:
    """Return a plaid: a board without end, and with no colour of its squares."""
    y, x = np.indices(size[::-1])
    waves = np.sin(2.0 * np.pi * x / period_px) * np.sin(2.0 * np.pi * y / period_px)
    return _as_levels(127.5 + 100.0 * waves)


def _bayer(image: Grey) -> Grey:
    """Return the image as a sensor with a colour mosaic sees a scene of strong colours."""
    y, x = np.indices(image.shape)
    gain = np.array([[0.4, 1.0], [1.0, 0.7]])[y % 2, x % 2]
    return _as_levels(gain * image)


def _as_levels(image: Array) -> Grey:
    levels: Grey = np.rint(np.clip(image, 0.0, 255.0)).astype(np.uint8)
    return levels
