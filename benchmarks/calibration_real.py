# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""
Calibrations of real cameras, compared by cross-validation: SelfCalibration and its peers.

Each method fits the camera to one half of the views. Then the poses alone of the other half are
fitted with that camera, for all methods by the same least squares.
"""

from __future__ import annotations

from collections.abc import Sequence
import math
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from p4pfr_ros.core.geometry import Array, rotation_from_vector
from rich.progress import track

from .calibration_methods import Fit, Method, methods, opencv_poses
from .corner_sets import CornerSet
from .tables import Measured, Row

REAL_NOTES = (
    'Real cameras: corners in public photographs, found by the detector of this project, from '
    '`P4PFR_DATA`; all methods get the same. Cross-validated rms: the camera is fitted to every '
    'second view (by SelfCalibration and lensboy with the shape of the board); with both kept, '
    'the poses alone of the other views are fitted by least squares over all their corners; then '
    'the halves change roles. It is the root of the mean squared distance in the image between '
    'corner and reprojection, over all corners of both halves. Rms of all views: the same with '
    'the camera fitted to all of them. SelfCalibration gets the views one at a time in file '
    'order, its time is that of all updates; ± is its stated standard deviation.',
    'OpenCV: `cv2.calibrateCamera` with its default of 5 coefficients, and with '
    '`CALIB_RATIONAL_MODEL`; `cv2.fisheye.calibrate`, started from the camera with 5 '
    'coefficients, because without a start it fails on fisheye_a_left. lensboy estimates five '
    'numbers of the shape of the board. It is no dependency of this project; to measure it: '
    '`python -m venv lensboy; lensboy/bin/pip install lensboy`, then '
    '`--lensboy-python lensboy/bin/python`.',
)

# Levenberg-Marquardt over the six numbers of a pose.
_STEP = 1e-6  # of the numeric derivatives, rad and m
_MAX_STEPS = 100
_START_DAMPING, _MAX_DAMPING = 1e-4, 1e8
_CONVERGED = 1e-10  # relative decrease of the sum of squares

_NO_CAMERA = 'no camera'


def real_tables(sets: Sequence[CornerSet], lensboy_python: Path | None) -> list[Measured]:
    """Compare the methods on each set: cross-validated rms, and the cameras from all views."""
    compared = methods(lensboy_python)
    cells: list[Row] = []
    cameras: list[Row] = []
    for corners in track(sets, 'real cameras', transient=True):
        start = opencv_poses(corners)
        cells.append(
            (
                corners.name,
                str(len(corners.views)),
                *(
                    _rms_cell(_cross_validated(method, corners, start))
                    for method in compared.values()
                ),
            )
        )
        cameras += [
            (corners.name, name, *_camera_cells(method(corners), corners, start))
            for name, method in compared.items()
        ]
    return [
        ('Real cameras: cross-validated rms, px', ('set', 'views', *compared), cells),
        (
            'Real cameras: fitted to all views',
            ('set', 'method', 'fx / fy, px', 'centre, px', 'rms, px', 'CPU time, s', 'state'),
            cameras,
        ),
    ]


def _cross_validated(method: Method, corners: CornerSet, start: Array) -> float:
    """Return the rms of each half with the camera of the other, px; NaN without a camera."""
    everything = np.arange(len(corners.views))
    even, odd = everything[::2], everything[1::2]
    squares = [
        squared_distances(method(corners.select(fitted)), corners, held_out, start)
        for fitted, held_out in ((even, odd), (odd, even))
    ]
    return math.sqrt(np.mean(np.concatenate(squares)))


def _camera_cells(fit: Fit | None, corners: CornerSet, start: Array) -> Row:
    if fit is None:
        return _NO_CAMERA, '', '', '', ''
    squares = squared_distances(fit, corners, np.arange(len(corners.views)), start)
    (fx, fy), (cx, cy) = fit.focal_px, fit.center_px
    focal, center = f'{fx:.2f} / {fy:.2f}', f'({cx:.2f}, {cy:.2f})'
    if fit.estimate is not None:
        focal += f' ± {fit.estimate.focal_sigma_px:.2f}'
        x, y = fit.estimate.center_sigma_px
        center += f' ± ({x:.2f}, {y:.2f})'
    return focal, center, _rms_cell(math.sqrt(squares.mean())), f'{fit.seconds:.2f}', fit.state


def _rms_cell(rms_px: float) -> str:
    return _NO_CAMERA if math.isnan(rms_px) else f'{rms_px:.3f}'


def squared_distances(
    fit: Fit | None, corners: CornerSet, views: NDArray[np.intp], start: Array
) -> Array:
    """Fit the poses alone of these views; return the squared distances (N,) of all corners."""
    if fit is None:
        return np.array([np.nan])
    squares = []
    for i in views:
        view = corners.views[i]
        errors = _fitted_pose_errors(fit, fit.board_shape[view.ids], view.image_points, start[i])
        squares.append(np.sum(errors**2, axis=1))
    return np.concatenate(squares)


def _fitted_pose_errors(fit: Fit, board: Array, image: Array, pose: Array) -> Array:
    """Return the errors (N, 2) px with the best pose, searched from pose (6,)."""
    errors, jacobian = _linearised(fit, board, image, pose)
    damping = _START_DAMPING
    for _ in range(_MAX_STEPS):
        normal = jacobian.T @ jacobian
        step = np.linalg.solve(
            normal + damping * np.diag(np.diag(normal)), jacobian.T @ errors.ravel()
        )
        trial, trial_jacobian = _linearised(fit, board, image, pose - step)
        cost, trial_cost = np.sum(errors**2), np.sum(trial**2)
        if not trial_cost < cost:  # false for NaN too: the camera does not see a point
            damping *= 10.0
            if damping > _MAX_DAMPING:
                break
            continue
        pose, errors, jacobian = pose - step, trial, trial_jacobian
        damping *= 0.1
        if cost - trial_cost < _CONVERGED * cost:
            break
    return errors


def _linearised(fit: Fit, board: Array, image: Array, pose: Array) -> tuple[Array, Array]:
    """Return the errors (N, 2) px at a pose and their derivatives (2 N, 6) by differences."""
    poses = pose + _STEP * np.vstack([np.zeros(6), np.eye(6), -np.eye(6)])
    points = [board @ rotation_from_vector(p[:3]).T + p[3:] for p in poses]
    errors = (fit.project(np.concatenate(points)).reshape(13, -1, 2) - image).reshape(13, -1)
    jacobian = (errors[1:7] - errors[7:]).T / (2.0 * _STEP)
    return errors[0].reshape(-1, 2), jacobian
