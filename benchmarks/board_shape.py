# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""
Why the standard deviation after one photograph is too small: the board is not as specified.

    P4PFR_DATA=FOLDER python -m benchmarks.board_shape

OpenCV's calibration with free board points (Strobl and Hirzinger 2011) estimates where they are
on the real board. Self-calibration then runs with the nominal and with the estimated points.
"""

from __future__ import annotations

import argparse
import os
from pathlib import Path

import cv2
import numpy as np
from p4pfr_ros import SelfCalibration
from p4pfr_ros.core.geometry import Array
from p4pfr_ros.files.boards import load_board

from .convergence import BOARD, corners_of, NO_DATA, read_photos

# The last corner of the first row: OpenCV holds it fixed, which determines the scale.
_FIXED_POINT = 8


def main(arguments: list[str] | None = None) -> int:
    """Run the benchmark and print the results."""
    parser = argparse.ArgumentParser(
        prog='python -m benchmarks.board_shape', description=__doc__.split('\n\n')[0]
    )
    parser.parse_args(arguments)
    if 'P4PFR_DATA' not in os.environ:
        parser.error(NO_DATA)
    board = load_board(BOARD)
    photos = read_photos(Path(os.environ['P4PFR_DATA']))
    corners_px = [corners_of(photo, board) for photo in photos.values()]
    height, width = next(iter(photos.values())).shape[:2]
    nominal = np.pad(board.points, ((0, 0), (0, 1))).astype(np.float32)
    views = [corners.astype(np.float32) for corners in corners_px]
    fixed_rms, *_ = cv2.calibrateCamera([nominal] * len(views), views, (width, height), None, None)
    free_rms, *_, points = cv2.calibrateCameraRO(
        [nominal] * len(views), views, (width, height), _FIXED_POINT, None, None
    )
    estimated = np.asarray(points, dtype=np.float64).reshape(-1, 3)
    moved_mm = 1e3 * np.abs(estimated - nominal)
    print(f'OpenCV: rms {fixed_rms:.3f} px; with free board points {free_rms:.3f} px;')
    print(f'  points up to {moved_mm[:, :2].max():.2f} mm from nominal along the board')
    print(f'  and {moved_mm[:, 2].max():.2f} mm out of its plane')
    _calibrate('nominal board', corners_px, board.points, (width, height))
    _calibrate('estimated points, flat', corners_px, estimated[:, :2], (width, height))
    return 0


def _calibrate(name: str, views: list[Array], points: Array, size: tuple[int, int]) -> None:
    calibration = SelfCalibration(size)
    history = []
    for corners in views:
        calibration.update(corners, points)
        if calibration.fused is not None:
            fused = calibration.fused
            history.append(f'{fused.camera.focal_px:.1f} ± {fused.focal_sigma_px:.1f}')
    rms = calibration.fused.rms_px if calibration.fused else np.nan
    print(f'{name}: f {history[0]}, {history[1]}, ... {history[-1]} px; rms {rms:.3f} px')


if __name__ == '__main__':
    raise SystemExit(main())
