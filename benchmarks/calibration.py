# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""
Self-calibration in tables: accuracy, speed, lenses outside the division model, real cameras.

    [P4PFR_DATA=FOLDER] python -m benchmarks.calibration [--cameras N] [--lensboy-python PATH]
                                                         [--markdown FILE]

Real cameras, beside OpenCV and lensboy, need P4PFR_DATA: FOLDER/corners contains .npz files.
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence
import math
from pathlib import Path
import time

import cv2
import numpy as np
from p4pfr_ros import DivisionCamera, SelfCalibration, Verdict
from p4pfr_ros.core.geometry import Array
from p4pfr_ros.scenes.camera_views import (
    board_grid,
    draw_camera,
    draw_camera_view,
    fit_from_ground_truth,
)
from p4pfr_ros.scenes.instances import IMAGE_SIZE
from p4pfr_ros.scenes.single_view import SyntheticView
from rich.progress import track

from .calibration_orders import halves_table, ORDERS, ORDERS_NOTE, orders_table
from .calibration_real import REAL_NOTES, real_tables
from .calibration_rim import RIM_NOTE, rim_table
from .calibration_wide import wide_rows
from .corner_sets import NO_CORNERS, read_corner_sets
from .tables import Measured, page_of

_CORNER_PX = 0.5 * math.hypot(*IMAGE_SIZE)
_KEYFRAMES, _TIMED_VIEWS = 40, 100


def main(arguments: list[str] | None = None) -> int:
    """Run the benchmark and print the tables."""
    parser = argparse.ArgumentParser(
        prog='python -m benchmarks.calibration', description=__doc__.split('\n\n')[0]
    )
    parser.add_argument(
        '--cameras', type=int, default=100, help='number of cameras; default: %(default)s'
    )
    parser.add_argument(
        '--markdown', type=Path, metavar='FILE', help='also write the tables to FILE'
    )
    parser.add_argument(
        '--lensboy-python',
        type=Path,
        metavar='PATH',
        help='Python of an environment that has lensboy, to compare with it on real cameras',
    )
    options = parser.parse_args(arguments)
    cv2.setNumThreads(1)
    sets = read_corner_sets()
    few = max(1, options.cameras // 20)
    tables = [_errors_table(options.cameras), _time_table(), wide_rows(options.cameras // 10)]
    tables.append(rim_table(sets, few))
    notes = [RIM_NOTE, f'Real cameras are left out: {NO_CORNERS}.']
    if sets:
        tables += real_tables(sets, options.lensboy_python)
        tables += [orders_table(sets, ORDERS), halves_table(sets, ORDERS)]
        notes = [RIM_NOTE, *REAL_NOTES, ORDERS_NOTE]
    text = page_of(
        'Self-calibration, measured',
        'python -m benchmarks.calibration',
        tables,
        notes,
    )
    print(text)
    if options.markdown:
        options.markdown.write_text(text)
    return 0


def _errors_table(cameras: int) -> Measured:
    """Compare with full bundle adjustment from ground truth."""
    ours, reference, squares = [], [], []
    for seed in track(range(cameras), 'cameras', transient=True):
        rng = np.random.default_rng(seed)
        camera = draw_camera(rng)
        views = [
            draw_camera_view(rng, camera, board_grid(6, 4), outlier_share=0.1) for _ in range(30)
        ]
        calibration = SelfCalibration(IMAGE_SIZE)
        for view in views:
            calibration.update(view.image_points, view.board_points)
        fused = calibration.fused
        if fused is None:
            raise RuntimeError(f'no camera from the views of seed {seed}')
        ours.append(_magnitudes(fused.camera, camera))
        reference.append(_magnitudes(fit_from_ground_truth(views), camera))
        error = _error(fused.camera, camera)
        squares.append(error @ np.linalg.solve(fused.covariance[:4, :4], error))
    medians = [np.median(errors, axis=0) for errors in (ours, reference)]
    names = ('focal length, %', 'centre, px', 'distortion at the corner, k r²')
    rows = [
        (name, f'{a:.4f}', f'{b:.4f}', f'{a / b:.2f}')
        for name, a, b in zip(names, *medians, strict=True)
    ]
    rows.append(('mean normalised squared error', f'{np.mean(squares):.2f}', '4 expected', ''))
    title = f'Median errors, {cameras} cameras: 30 views of 24 points, 0.5 px, 10 % outliers'
    return (
        title,
        ('', 'SelfCalibration', 'full bundle adjustment from ground truth', 'ratio'),
        rows,
    )


def _error(estimate: DivisionCamera, truth: DivisionCamera) -> Array:
    x, y = np.subtract(estimate.center_px, truth.center_px)
    return np.array([estimate.focal_px - truth.focal_px, x, y, estimate.k - truth.k])


def _magnitudes(estimate: DivisionCamera, truth: DivisionCamera) -> Array:
    focal_px, x, y, k = np.abs(_error(estimate, truth))
    distortion = k * (_CORNER_PX / truth.focal_px) ** 2
    return np.array([100.0 * focal_px / truth.focal_px, math.hypot(x, y), distortion])


def _time_table() -> Measured:
    """Time updates with a full set of keyframes, and OpenCV on as many views."""
    small, large = _times_ms(9, 6), _times_ms(22, 22)
    rows = [(name, *(f'{times_ms[name]:.2f}' for times_ms in (small, large))) for name in small]
    return 'One update, median CPU time', ('', '54 points, ms', '484 points, ms'), rows


def _times_ms(columns: int, rows: int) -> dict[str, float]:
    """Return the median times with a board of this many points, ms."""
    rng = np.random.default_rng(0)
    camera = DivisionCamera(800.0, (650.0, 470.0), -0.2)
    board = board_grid(columns, rows)
    views = [draw_camera_view(rng, camera, board) for _ in range(_KEYFRAMES + _TIMED_VIEWS)]
    calibration = SelfCalibration(IMAGE_SIZE)
    for view in views[:_KEYFRAMES]:
        calibration.update(view.image_points, view.board_points)
    times: dict[Verdict, list[float]] = {Verdict.USED: [], Verdict.REDUNDANT: []}
    for view in views[_KEYFRAMES:]:
        seconds = _seconds(calibration, view)
        times.setdefault(calibration.verdict, []).append(seconds)
    begin = time.process_time()
    _opencv(views[-_KEYFRAMES:])
    opencv = time.process_time() - begin
    return {
        f'view added, all {_KEYFRAMES} views refitted': 1e3
        * float(np.median(times[Verdict.USED])),
        'redundant view, information kept': 1e3 * float(np.median(times[Verdict.REDUNDANT])),
        f'cv2.calibrateCamera, {_KEYFRAMES} views at once': 1e3 * opencv,
    }


def _seconds(calibration: SelfCalibration, view: SyntheticView) -> float:
    begin = time.process_time()
    calibration.update(view.image_points, view.board_points)
    return time.process_time() - begin


def _opencv(views: Sequence[SyntheticView]) -> None:
    """Call cv2.calibrateCamera with its default five coefficients."""
    points = [np.pad(v.board_points, ((0, 0), (0, 1))).astype(np.float32) for v in views]
    image = [v.image_points.astype(np.float32) for v in views]
    cv2.calibrateCamera(points, image, IMAGE_SIZE, None, None)


if __name__ == '__main__':
    raise SystemExit(main())
