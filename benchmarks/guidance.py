# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""
Views until a camera is calibrated: of a person who follows the live page, and of one who does not.

    python -m benchmarks.guidance [--cameras N]
"""

from __future__ import annotations

import argparse
from collections.abc import Callable
import math

import numpy as np
from p4pfr_ros import CalibrationOptions, CalibrationState, DivisionCamera, Pose, SelfCalibration
from p4pfr_ros.boards import Chessboard
from p4pfr_ros.live.guidance import Guide
from p4pfr_ros.scenes.board_path import SimulatedPath

SIZE = (640, 480)
BOARD = Chessboard(columns=9, rows=6, square_m=0.025)
POINTS = np.pad(BOARD.points, ((0, 0), (0, 1)))
NOISE_PX = 0.3
MOST_VIEWS = 60
# Without guidance the board moves on a path; a view is taken whenever so much time has passed.
PERIOD_S = 1.3
# Of the drawn cameras: focal length in diagonals of the image, and k r² at the corner.
FOCAL, CORNER_BEND = (0.45, 1.6), (-0.5, 0.0)
Mover = Callable[[int, SelfCalibration], Pose]


def draw_camera(rng: np.random.Generator) -> DivisionCamera:
    """Draw a camera, its centre off the middle as in real ones."""
    diagonal_px = math.hypot(*SIZE)
    focal_px = diagonal_px * math.exp(rng.uniform(*np.log(FOCAL)))
    x, y = rng.normal((319.5, 239.5), 0.015 * diagonal_px)
    return DivisionCamera(
        focal_px, (x, y), rng.uniform(*CORNER_BEND) * (2 * focal_px / diagonal_px) ** 2
    )


def views_needed(camera: DivisionCamera, mover: Mover, rng: np.random.Generator) -> int:
    """Return the number of views that are shown until the camera is calibrated."""
    calibration = SelfCalibration(SIZE)
    for i in range(MOST_VIEWS):
        pixels = camera.project(mover(i, calibration).transform(POINTS))
        pixels += rng.normal(0.0, NOISE_PX, pixels.shape)
        # What is outside the image is not seen; a chessboard is seen as a whole, or not at all.
        if not ((pixels > -0.5) & (pixels < np.subtract(SIZE, 0.5))).all():
            continue
        calibration.update(pixels, BOARD.points, i, board=BOARD.name)
        if calibration.state is CalibrationState.CALIBRATED:
            return i + 1
    return MOST_VIEWS


def guided() -> Mover:
    """Return a person who does what the page says."""
    guide = Guide(BOARD, SIZE, CalibrationOptions())
    return lambda _, calibration: (
        guide.next_view(calibration.fused, calibration.views).camera_from_board
    )


def unguided(camera: DivisionCamera, seed: int) -> Mover:
    """Return a person who moves the board about the image, tilted by 15 to 55 degrees."""
    path = SimulatedPath(BOARD, SIZE, seed)
    return lambda i, _: path.at(PERIOD_S * i, camera)


def main() -> None:
    """Print the numbers of views."""
    parser = argparse.ArgumentParser(description=__doc__.strip().split('\n\n')[0])
    parser.add_argument('--cameras', type=int, default=40)
    needed = []
    for seed in range(parser.parse_args().cameras):
        camera = draw_camera(np.random.default_rng(seed))
        movers = guided(), unguided(camera, seed)
        needed.append([views_needed(camera, m, np.random.default_rng(seed)) for m in movers])
    for name, views in zip(('guided', 'unguided'), np.transpose(needed), strict=True):
        median, most = np.median(views), np.quantile(views, 0.9)
        print(
            f'{name}: {median:.0f} views in the median, {most:.0f} in 90 % of {len(views)} cameras'
        )


if __name__ == '__main__':
    main()
