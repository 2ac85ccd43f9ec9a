# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""
Self-calibration of a real camera, photograph by photograph; draws docs/convergence.png.

    P4PFR_DATA=FOLDER python -m benchmarks.convergence [--output FILE]

The folder contains left01.jpg to left14.jpg, OpenCV's photographs of a chessboard. For comparison,
OpenCV calibrates from all of them at once, with the same corners and with its own corners.
"""

from __future__ import annotations

import argparse
from collections.abc import Mapping, Sequence
import os
from pathlib import Path

import cv2
import matplotlib as mpl
from matplotlib.figure import Figure
import numpy as np
from p4pfr_ros import CameraEstimate, EstimateOptions
from p4pfr_ros.boards import Board
from p4pfr_ros.core.geometry import Array
from p4pfr_ros.detection import detect
from p4pfr_ros.files.boards import load_board
from p4pfr_ros.files.image_sources import NamedImage
from p4pfr_ros.files.images import ImageArray, read_image
from p4pfr_ros.report.calibration_run import CalibrationRun, ViewRecord
from p4pfr_ros.report.figure_style import STYLE
from p4pfr_ros.report.plots import draw_history

_ROOT = Path(__file__).parent.parent
BOARD = _ROOT / 'config/boards/chessboard_9x6_25mm.yaml'
NO_DATA = 'set the environment variable P4PFR_DATA to the folder with the photographs'
_FIGURE = _ROOT / 'docs/convergence.png'
_PATTERN = (9, 6)
# Corner refinement as in OpenCV's documentation: half window size, termination criteria.
_WINDOW_PX = (5, 5)
_TERMINATION = (cv2.TERM_CRITERIA_EPS + cv2.TERM_CRITERIA_COUNT, 30, 0.01)

Camera = tuple[float, float, float]  # focal length and centre, pixels


def main(arguments: list[str] | None = None) -> int:
    """Calibrate, print the table, draw the figure."""
    parser = argparse.ArgumentParser(
        prog='python -m benchmarks.convergence',
        description=__doc__.split('\n\n')[0],
        epilog=__doc__.split('\n\n')[2],
    )
    parser.add_argument(
        '--output', type=Path, default=_FIGURE, metavar='FILE', help='figure to write'
    )
    output = parser.parse_args(arguments).output
    if 'P4PFR_DATA' not in os.environ:
        parser.error(NO_DATA)
    board = load_board(BOARD)
    photos = read_photos(Path(os.environ['P4PFR_DATA']))
    steps = converge(photos, board)
    peers = {
        name: opencv(photos, board, [corners(photo) for photo in photos.values()])
        for name, corners in (
            ('OpenCV, same corners', lambda photo: corners_of(photo, board)),
            ('OpenCV, its own corners', _opencv_corners),
        )
    }
    _print_table(steps, peers)
    _draw(steps, peers, output)
    return 0


def read_photos(folder: Path) -> dict[str, ImageArray]:
    """Read the photographs, sorted by name."""
    return {path.name: read_image(path) for path in sorted(folder.glob('left*.jpg'))}


def converge(photos: Mapping[str, ImageArray], board: Board) -> list[ViewRecord]:
    """Calibrate from the photographs, one by one."""
    run = CalibrationRun(board, EstimateOptions())
    for name, photo in photos.items():
        run.add(NamedImage(name, photo))
    return run.records


def opencv(photos: Mapping[str, ImageArray], board: Board, corners_px: Sequence[Array]) -> Camera:
    """Calibrate with OpenCV: all photographs at once, square pixels, five coefficients."""
    height, width = next(iter(photos.values())).shape[:2]
    on_board = np.pad(board.points, ((0, 0), (0, 1))).astype(np.float32)
    _, matrix, *_ = cv2.calibrateCamera(
        [on_board] * len(photos),
        [corners.astype(np.float32) for corners in corners_px],
        (width, height),
        np.eye(3),  # gives the fixed aspect ratio fx / fy
        None,
        flags=cv2.CALIB_FIX_ASPECT_RATIO,
    )
    return float(matrix[0, 0]), float(matrix[0, 2]), float(matrix[1, 2])


def corners_of(photo: ImageArray, board: Board) -> Array:
    """Detect the corners (N, 2) px of a photograph, in the order of the board points."""
    detection = detect(photo, board)
    return detection.image_points[np.argsort(detection.ids)]


def _opencv_corners(photo: ImageArray) -> Array:
    grey = photo if photo.ndim == 2 else cv2.cvtColor(photo, cv2.COLOR_BGR2GRAY)
    _, rough = cv2.findChessboardCorners(grey, _PATTERN)
    corners: Array = cv2.cornerSubPix(grey, rough, _WINDOW_PX, (-1, -1), _TERMINATION).reshape(
        -1, 2
    )
    # OpenCV may order the corners upside down or mirrored: with square cells it does not matter.
    return corners


def _print_table(steps: Sequence[ViewRecord], peers: Mapping[str, Camera]) -> None:
    print(_row('', 'focal length, px', 'centre x, px', 'centre y, px'))
    for step in steps:
        if step.fused is not None:
            print(_row(step.name, *_with_sigmas(step.fused)))
    for name, values in peers.items():
        print(_row(name, *(f'{value:.2f}       ' for value in values)))
    last = steps[-1].fused
    if last is not None:
        print(f'{last.views} views used, rms {last.rms_px:.3f} px')


def _row(name: str, *cells: str) -> str:
    return f'{name:24}' + ''.join(f'{cell:>18}' for cell in cells)


def _with_sigmas(fused: CameraEstimate) -> list[str]:
    values = (fused.camera.focal_px, *fused.camera.center_px)
    sigmas = (fused.focal_sigma_px, *fused.center_sigma_px)
    return [f'{value:.2f} ± {sigma:.2f}' for value, sigma in zip(values, sigmas, strict=True)]


def _draw(steps: Sequence[ViewRecord], peers: Mapping[str, Camera], output: Path) -> None:
    with mpl.rc_context(STYLE):
        figure = Figure(figsize=(12.0, 3.6), layout='constrained')
        draw_history(figure, steps, peers)
        figure.savefig(output, dpi=110)


if __name__ == '__main__':
    raise SystemExit(main())
