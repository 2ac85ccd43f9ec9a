# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""
Why one photograph's standard deviation is too small: the board is not what its file says.

    P4PFR_DATA=FOLDER python -m benchmarks.board_shape

OpenCV's calibration with the board's points released (Strobl and Hirzinger 2011) says where on
the real board they are. With those in place of the nominal ones, self-calibration is run again.
"""

from __future__ import annotations

import os
from pathlib import Path

import cv2
import numpy as np
from p4pfr_ros import SelfCalibration
from p4pfr_ros.core.geometry import Array
from p4pfr_ros.files.boards import load_board

from .convergence import BOARD, corners_of, read_photos

# A corner of the first row at its other end, which stays where it is and holds the scale.
_FIXED_POINT = 8


def main() -> int:
    """Measure and print."""
    board = load_board(BOARD)
    photos = read_photos(Path(os.environ['P4PFR_DATA']))
    corners_px = [corners_of(photo, board) for photo in photos.values()]
    height, width = next(iter(photos.values())).shape[:2]
    nominal = np.pad(board.points, ((0, 0), (0, 1))).astype(np.float32)
    views = [corners.astype(np.float32) for corners in corners_px]
    held, *_ = cv2.calibrateCamera([nominal] * len(views), views, (width, height), None, None)
    released, *_, points = cv2.calibrateCameraRO(
        [nominal] * len(views), views, (width, height), _FIXED_POINT, None, None
    )
    found = np.asarray(points, dtype=np.float64).reshape(-1, 3)
    moved_mm = 1e3 * np.abs(found - nominal)
    print(f'OpenCV: rms {held:.3f} px; with the board released {released:.3f} px,')
    print(f'  points moved by up to {moved_mm[:, :2].max():.2f} mm along the board')
    print(f'  and {moved_mm[:, 2].max():.2f} mm out of it')
    _calibrate('nominal board', corners_px, board.points, (width, height))
    _calibrate('as found, flat', corners_px, found[:, :2], (width, height))
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
