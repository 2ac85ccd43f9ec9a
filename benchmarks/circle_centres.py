# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""
Accuracy of circle grids: OpenCV's middles, and the centres corrected for perspective and lens.

    python -m benchmarks.circle_centres [--page docs/benchmark_circles.md]
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator
from pathlib import Path

import cv2
import numpy as np
from p4pfr_ros import DivisionCamera, Pose
from p4pfr_ros.boards import CircleGrid
from p4pfr_ros.core.geometry import Array
from p4pfr_ros.detection import detect
from p4pfr_ros.rendering import Renderer
from rich.console import Console

from .tables import Measured, page_of, Row, table_of

_SIZE = (1280, 960)
_CENTER = (639.5, 479.5)
_CAMERAS = {
    'pinhole': DivisionCamera(1000.0, _CENTER),
    'k -0.3': DivisionCamera(1000.0, _CENTER, -0.3),
    'wide, k -0.35': DivisionCamera(500.0, _CENTER, -0.35),
    # Not of the model that the correction assumes: another centre, and a second term.
    'k -0.25, k2 0.03, centre 20 px off': DivisionCamera(1000.0, (659.5, 459.5), -0.25, 0.03),
}
_BOARDS = {
    '7x5, 18 of 30 mm': CircleGrid(columns=7, rows=5, spacing_m=0.03, diameter_m=0.018),
    '5x4, 38 of 50 mm': CircleGrid(columns=5, rows=4, spacing_m=0.05, diameter_m=0.038),
    '4x11, 12 of 20 mm': CircleGrid(
        columns=4, rows=11, spacing_m=0.02, diameter_m=0.012, asymmetric=True
    ),
}
_VIEWS = 20
_TILT_DEG = (5.0, 45.0)
_HEADER = (
    'grid',
    'camera',
    'OpenCV median px',
    '99 %',
    'found',
    'ours median px',
    '99 %',
    'found',
)
_NOTE = (
    f'Distances from the images of the true centres, {_VIEWS} rendered views at '
    f'{_SIZE[0]}x{_SIZE[1]} tilted by {_TILT_DEG[0]:.0f} to {_TILT_DEG[1]:.0f} degrees, blur '
    '0.7 px, noise 2 grey levels. OpenCV: findCirclesGrid, with clustering if that fails without. '
    'OpenCV reports the middle of the image of a circle, which is not the image of its middle; '
    'its error is in one direction and grows with the size of the circles. p4pfr_ros/detection/'
    'circle_centres.py derives the correction. The search for the circles is our own, too '
    '(circle_lattice.py).'
)


def main(arguments: list[str] | None = None) -> int:
    """Measure, print the table and write the page."""
    parser = argparse.ArgumentParser(
        prog='python -m benchmarks.circle_centres', description=__doc__.split('\n\n')[0].strip()
    )
    parser.add_argument('--page', type=Path, metavar='FILE', help='write a Markdown page')
    options = parser.parse_args(arguments)
    table: Measured = ('Centres of circles', _HEADER, list(_rows()))
    Console(width=150).print(table_of(*table))
    if options.page:
        command = 'python -m benchmarks.circle_centres --page docs/benchmark_circles.md'
        options.page.write_text(page_of('Circle grids', command, [table], [_NOTE]))
    return 0


def _rows() -> Iterator[Row]:
    for board_name, board in _BOARDS.items():
        for camera_name, camera in _CAMERAS.items():
            yield (board_name, camera_name, *_measured(board, camera))


def _measured(board: CircleGrid, camera: DivisionCamera) -> Row:
    renderer = Renderer(camera, _SIZE)
    opencv: list[Array] = []
    ours: list[Array] = []
    for seed, pose in enumerate(_poses(board, camera)):
        image = renderer.render(board, pose, blur_sigma_px=0.7, noise_sigma=2.0, seed=seed)
        truth = camera.project(pose.transform(np.pad(board.points, ((0, 0), (0, 1)))))
        middles = _opencv_middles(image, board)
        if middles is not None:  # in an order of its own
            opencv.append(np.linalg.norm(middles[:, None] - truth, axis=2).min(axis=1))
        detection = detect(image, board)
        ours.append(np.linalg.norm(detection.image_points - truth[detection.ids], axis=1))
    return (*_summary(opencv, board), *_summary(ours, board))


def _opencv_middles(image: np.ndarray, board: CircleGrid) -> Array | None:
    layout = cv2.CALIB_CB_ASYMMETRIC_GRID if board.asymmetric else cv2.CALIB_CB_SYMMETRIC_GRID
    for flags in (layout, layout | cv2.CALIB_CB_CLUSTERING):
        found, middles = cv2.findCirclesGrid(image, (board.columns, board.rows), flags=flags)
        if found:
            return np.asarray(middles, dtype=np.float64).reshape(-1, 2)
    return None


def _summary(errors: list[Array], board: CircleGrid) -> Row:
    found = sum(len(each) == len(board.points) for each in errors)
    if not found:
        return ('-', '-', f'0/{_VIEWS}')
    stacked = np.concatenate(errors)
    quantiles = (f'{np.quantile(stacked, share):.4f}' for share in (0.5, 0.99))
    return (*quantiles, f'{found}/{_VIEWS}')


def _poses(board: CircleGrid, camera: DivisionCamera) -> Iterator[Pose]:
    rng = np.random.default_rng(1)
    distance_m = 1.15 * camera.focal_px / 1000.0 * max(board.sheet_size_m) / 0.5
    head_on = Pose(np.diag([1.0, -1.0, -1.0]), np.zeros(3))
    for _ in range(_VIEWS):
        azimuth, tilt = rng.uniform(0.0, 2.0 * np.pi), np.radians(rng.uniform(*_TILT_DEG))
        x, y = distance_m * rng.uniform(-0.1, 0.1, 2)
        axis = (tilt * np.cos(azimuth), tilt * np.sin(azimuth), 0.0)
        roll = Pose.from_rotation_vector((0.0, 0.0, rng.uniform(-0.5, 0.5)), np.zeros(3))
        yield Pose.from_rotation_vector(axis, (x, y, distance_m)) @ roll @ head_on


if __name__ == '__main__':
    raise SystemExit(main())
