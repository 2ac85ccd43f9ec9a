# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""Self-calibration of fisheye lenses, which the division polynomial only approximates."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from p4pfr_ros import DivisionCamera, estimate_pose, EstimateOptions, SelfCalibration
from p4pfr_ros.core.cameras.camera_info import CameraInfoModel
from p4pfr_ros.scenes.camera_views import board_grid, draw_camera_view
from p4pfr_ros.scenes.instances import IMAGE_SIZE
from p4pfr_ros.scenes.single_view import SyntheticView

from .tables import Measured, Row

_FIELDS_OF_VIEW_DEG = (100, 130, 150)
_VIEWS, _HELD_OUT = 18, 10
_NOISE_PX = 0.3
_CORNER_PX = 0.5 * math.hypot(*IMAGE_SIZE)
_ALL_INLIERS = EstimateOptions.ideal(threshold_px=100.0)

HEADER = (
    'field of view',
    'terms',
    'rms of held-out views / noise',
    'focal length error, %, median',
    'worst',
)


def wide_rows(cameras: int) -> Measured:
    """Calibrate some lenses of each field of view."""
    rows: list[Row] = []
    for fov_deg in _FIELDS_OF_VIEW_DEG:
        results = [_calibrate(fov_deg, seed) for seed in range(max(1, cameras))]
        terms, rms_ratios, focal_errors = zip(*results, strict=True)
        spread = f'{min(terms)} to {max(terms)}' if min(terms) < max(terms) else f'{terms[0]}'
        percent = 100.0 * np.abs(focal_errors)
        errors = (f'{np.median(percent):.3f}', f'{percent.max():.3f}')
        rows.append((f'{fov_deg}°', spread, f'{max(rms_ratios):.2f}', *errors))
    title = (
        f'Equidistant lenses, {max(1, cameras)} each: {_VIEWS} views of 200 points, '
        f'{_NOISE_PX} px; worst rms of {_HELD_OUT} held-out views'
    )
    return title, HEADER, rows


def _calibrate(fov_deg: float, seed: int) -> tuple[int, float, float]:
    """Return terms, rms of held-out views / noise, and relative focal length error."""
    rng = np.random.default_rng(seed)
    focal_px = _CORNER_PX / math.radians(0.5 * fov_deg)
    center_px = tuple(0.5 * np.array(IMAGE_SIZE) + rng.normal(0.0, 8.0, 2))
    lens = CameraInfoModel(
        'equidistant', (0.0,) * 4, (focal_px, focal_px), center_px, 0.0, IMAGE_SIZE
    )
    calibration = SelfCalibration(IMAGE_SIZE)
    for view in _views(rng, lens, _VIEWS):
        calibration.update(view.image_points, view.board_points)
    if calibration.fused is None:
        raise RuntimeError(f'no camera at {fov_deg} degrees, seed {seed}')
    camera = calibration.fused.camera
    squares = [_mean_square(camera, view) for view in _views(rng, lens, _HELD_OUT)]
    rms_ratio = math.sqrt(np.mean(squares) / 2.0) / _NOISE_PX
    terms = 1 + (camera.k2 != 0.0) + (camera.k3 != 0.0)
    return terms, rms_ratio, camera.focal_px / focal_px - 1.0


def _views(rng: np.random.Generator, lens: Any, count: int) -> list[SyntheticView]:
    options: dict[str, Any] = {'tilt_deg': (0.0, 60.0), 'distance': (0.35, 1.2)}
    return [
        draw_camera_view(rng, lens, board_grid(20, 10), noise_px=_NOISE_PX, **options)
        for _ in range(count)
    ]


def _mean_square(camera: DivisionCamera, view: SyntheticView) -> float:
    """Return the mean squared error of a view, px², with the camera and the best pose."""
    model = estimate_pose(
        view.image_points, view.board_points, camera=camera, options=_ALL_INLIERS
    ).model
    if model is None:
        return math.inf
    points = np.pad(view.board_points, ((0, 0), (0, 1)))
    projected = camera.project(model.camera_from_board.transform(points))
    return float(np.mean(np.sum((projected - view.image_points) ** 2, axis=1)))
