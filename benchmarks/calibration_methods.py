# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""
Calibration of one camera by ``SelfCalibration``, OpenCV and lensboy, behind one interface.

This module stands alone so that a peer is added in one place.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
import json
from pathlib import Path
import subprocess
import tempfile
import time
from typing import Any

import cv2
import numpy as np
from p4pfr_ros import CameraEstimate
from p4pfr_ros.core.geometry import Array

from .calibration_orders import BOARD, calibrate
from .corner_sets import CornerSet

OURS = 'SelfCalibration'
_LENSBOY = Path(__file__).parent / 'peers/fit_lensboy.py'
# OpenCV 5 has the flags of cv2.fisheye in cv2.
_flags: Any = cv2 if hasattr(cv2, 'CALIB_RECOMPUTE_EXTRINSIC') else cv2.fisheye
_FISHEYE_FLAGS = (
    _flags.CALIB_RECOMPUTE_EXTRINSIC | _flags.CALIB_FIX_SKEW | _flags.CALIB_USE_INTRINSIC_GUESS
)
_FISHEYE_TERMINATION = (cv2.TERM_CRITERIA_EPS + cv2.TERM_CRITERIA_COUNT, 200, 1e-10)
_NO_POSE = np.zeros(3)


@dataclass(frozen=True, slots=True)
class Fit:
    """
    A camera fitted to views.

    Parameters
    ----------
    project
        Maps points (N, 3) of the optical frame to pixels (N, 2).
    board_shape : (M, 3) array
        The points of the board, metres: with Z = 0 if the method takes it to be flat.
    focal_px, center_px
        (fx, fy) and (cx, cy).
    seconds
        CPU time.
    state, estimate
        Of SelfCalibration: its state after the last view, and its camera with the covariance.

    """

    project: Callable[[Array], Array]
    board_shape: Array
    focal_px: tuple[float, float]
    center_px: tuple[float, float]
    seconds: float
    state: str = ''
    estimate: CameraEstimate | None = None


# Returns None if the method finds no camera.
Method = Callable[[CornerSet], Fit | None]


def methods(lensboy_python: Path | None) -> dict[str, Method]:
    """Return the methods by name; lensboy_python: of the environment that has lensboy."""
    chosen: dict[str, Method] = {
        OURS: _self_calibration,
        'OpenCV, 5 coefficients': partial(_opencv, 0),
        'OpenCV, 8 coefficients': partial(_opencv, cv2.CALIB_RATIONAL_MODEL),
        'cv2.fisheye': _opencv_fisheye,
    }
    if lensboy_python is not None:
        chosen['lensboy, 8 coefficients + board shape'] = partial(_lensboy, lensboy_python)
    return chosen


def opencv_poses(corners: CornerSet) -> Array:
    """Return the poses (V, 6) of all views by OpenCV: rotation vector, translation."""
    _, _, _, rotations, translations = cv2.calibrateCamera(*_opencv_views(corners), None, None)
    return np.hstack([np.reshape(rotations, (-1, 3)), np.reshape(translations, (-1, 3))])


def _self_calibration(corners: CornerSet) -> Fit | None:
    run = calibrate(corners)
    estimate = run.cameras[-1]
    if estimate is None:
        return None
    camera = estimate.camera
    return Fit(
        camera.project,
        _board_shape(estimate, corners),
        camera.focal_xy_px,
        camera.center_px,
        sum(run.seconds),
        run.states[-1].name,
        estimate,
    )


def _board_shape(estimate: Any, corners: CornerSet) -> Array:
    # Until self-calibration estimates the shape of each board.
    shape = estimate.board_shape(BOARD)
    assert shape is not None
    points: Array = shape.points(corners.board_points)
    return points


def _opencv(flags: int, corners: CornerSet) -> Fit | None:
    begin = time.process_time()
    _, matrix, coefficients, *_ = cv2.calibrateCamera(
        *_opencv_views(corners), None, None, flags=flags
    )
    seconds = time.process_time() - begin
    return _opencv_fit(matrix, coefficients, _flat(corners), seconds)


def _opencv_views(corners: CornerSet) -> tuple[list[Any], list[Any], tuple[int, int]]:
    flat = _flat(corners).astype(np.float32)
    board_points = [flat[view.ids] for view in corners.views]
    image_points = [view.image_points.astype(np.float32) for view in corners.views]
    return board_points, image_points, corners.image_size


def _opencv_fit(matrix: Array, coefficients: Array, board_shape: Array, seconds: float) -> Fit:
    def project(points: Array) -> Array:
        pixels, _ = cv2.projectPoints(points, _NO_POSE, _NO_POSE, matrix, coefficients)
        return np.asarray(pixels).reshape(-1, 2)

    return Fit(project, board_shape, *_pinhole(matrix), seconds)


def _opencv_fisheye(corners: CornerSet) -> Fit | None:
    flat = _flat(corners)
    # Its own start fails on fisheye_a_left: start from the five-coefficient fit, which is close.
    _, matrix, *_ = cv2.calibrateCamera(*_opencv_views(corners), None, None)
    coefficients = np.zeros((4, 1))
    begin = time.process_time()
    try:
        cv2.fisheye.calibrate(
            [flat[None, view.ids] for view in corners.views],
            [view.image_points[None] for view in corners.views],
            corners.image_size,
            matrix,
            coefficients,
            flags=_FISHEYE_FLAGS,
            criteria=_FISHEYE_TERMINATION,
        )
    except cv2.error:
        return None
    seconds = time.process_time() - begin

    def project(points: Array) -> Array:
        pixels, _ = cv2.fisheye.projectPoints(
            points[:, None], _NO_POSE, _NO_POSE, matrix, coefficients
        )
        return np.asarray(pixels).reshape(-1, 2)

    return Fit(project, flat, *_pinhole(matrix), seconds)


def _lensboy(python: Path, corners: CornerSet) -> Fit | None:
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / 'corners.npz'
        np.savez(
            path,
            image_size=corners.image_size,
            board_points=corners.board_points,
            view=np.repeat(np.arange(len(corners.views)), [len(v.ids) for v in corners.views]),
            ids=np.concatenate([view.ids for view in corners.views]),
            image_points=np.concatenate([view.image_points for view in corners.views]),
        )
        # An environment of its own: without the paths of this one.
        done = subprocess.run(
            [python, '-I', _LENSBOY, path], capture_output=True, text=True, check=False
        )
    if done.returncode:
        raise RuntimeError(f'{python} {_LENSBOY.name}: {done.stderr.strip()}')
    answer = json.loads(done.stdout)
    matrix, coefficients, board_shape = (
        np.array(answer[name]) for name in ('matrix', 'coefficients', 'board_shape')
    )
    return _opencv_fit(matrix, coefficients, board_shape, answer['seconds'])


def _flat(corners: CornerSet) -> Array:
    return np.pad(corners.board_points, ((0, 0), (0, 1)))


def _pinhole(matrix: Array) -> tuple[tuple[float, float], tuple[float, float]]:
    """Return focal lengths and centre."""
    (fx, _, cx), (_, fy, cy), _ = matrix.tolist()
    return (fx, fy), (cx, cy)
