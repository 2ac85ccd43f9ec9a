# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""
Loads and saves calibration files: the YAML of camera_calibration and camera_info_manager.

ROS reads image size, name, K, model, D, R and P from it. The additional key ``division`` holds
the division model and its covariance. Other programs ignore it, and it may be missing.
"""

from __future__ import annotations

from dataclasses import dataclass
import os
from typing import Any

import numpy as np
from p4pfr_ros.core.cameras.camera_info import (
    CameraInfoModel,
    COEFFICIENTS,
    MAX_NUMBER,
    MIN_FOCAL_PX,
)
from p4pfr_ros.core.cameras.division import DivisionCamera
from p4pfr_ros.core.many_views.results import CameraEstimate
from p4pfr_ros.files.writing import write_atomically
from p4pfr_ros.files.yaml_fields import ConfigError, Fields, read_yaml
import yaml


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Calibration:
    """
    A calibrated camera.

    Parameters
    ----------
    image_size
        Width and height of the full raw image, pixels.
    camera_name
        The driver's name of the camera.
    model
        The camera as in a CameraInfo message.
    estimate
        The self-calibrated camera that the model was fitted to; None for a calibration by
        another program.

    Raises
    ------
    ValueError
        The image sizes of the calibration and the model differ.

    """

    image_size: tuple[int, int]
    camera_name: str
    model: CameraInfoModel
    estimate: CameraEstimate | None = None

    def __post_init__(self) -> None:
        if tuple(self.image_size) != self.model.image_size:
            raise ValueError(
                f"image_size must be the model's, {self.model.image_size}, got {self.image_size}"
            )

    @classmethod
    def from_estimate(
        cls, estimate: CameraEstimate, image_size: tuple[int, int], camera_name: str
    ) -> Calibration:
        """Make the calibration of a self-calibrated camera."""
        return cls(
            image_size=image_size,
            camera_name=camera_name,
            model=estimate.camera.to_camera_info_model(image_size),
            estimate=estimate,
        )


def save_calibration(path: str | os.PathLike[str], calibration: Calibration) -> None:
    """
    Write a calibration file atomically; missing folders are created.

    Raises
    ------
    ConfigError
        The path is not writable.

    """
    tree = _tree_from(calibration)
    write_atomically(path, yaml.safe_dump(tree, sort_keys=False, default_flow_style=None))


def load_calibration(path: str | os.PathLike[str]) -> Calibration:
    """
    Load a calibration file, written by this package or another.

    Raises
    ------
    ConfigError
        ``PATH: KEY: expected ..., got ...``.

    """
    tree = read_yaml(path)
    try:
        return _calibration_from(Fields.of(tree))
    except ValueError as error:
        raise ConfigError(f'{path}: {error}') from None


def _tree_from(calibration: Calibration) -> dict[str, Any]:
    (width, height), model = calibration.image_size, calibration.model
    (fx, fy), (cx, cy) = model.focal_px, model.center_px
    tree: dict[str, Any] = {
        'image_width': width,
        'image_height': height,
        'camera_name': calibration.camera_name,
    }
    if calibration.estimate is not None:
        tree['division'] = _division_from(calibration.estimate, model.residual_px)
    d = model.coefficients
    # Required keys come last, so that a truncated file lacks them.
    return tree | {
        'camera_matrix': _matrix_tree(3, 3, (fx, 0.0, cx, 0.0, fy, cy, 0.0, 0.0, 1.0)),
        'distortion_model': model.distortion_model,
        'distortion_coefficients': _matrix_tree(1, len(d), d),
        'rectification_matrix': _matrix_tree(3, 3, (1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0)),
        'projection_matrix': _matrix_tree(
            3, 4, (fx, 0.0, cx, 0.0, 0.0, fy, cy, 0.0, 0.0, 0.0, 1.0, 0.0)
        ),
    }


def _division_from(estimate: CameraEstimate, residual_px: float) -> dict[str, Any]:
    camera = estimate.camera
    return {
        'focal_px': camera.focal_px,
        'center_px': list(camera.center_px),
        'k': camera.k,
        'k2': camera.k2,
        'k3': camera.k3,
        'covariance': _matrix_tree(6, 6, tuple(estimate.covariance.ravel().tolist())),
        'rms_px': float(estimate.rms_px),
        'views': int(estimate.views),
        'residual_px': residual_px,
    }


def _matrix_tree(rows: int, cols: int, data: tuple[float, ...]) -> dict[str, Any]:
    return {'rows': rows, 'cols': cols, 'data': list(data)}


def _calibration_from(fields: Fields) -> Calibration:
    fx, _, cx, _, fy, cy, *_ = _matrix_from(fields, 'camera_matrix', 3, 3)
    # Unused, but ROS requires both, and a truncated file lacks them.
    _matrix_from(fields, 'rectification_matrix', 3, 3)
    _matrix_from(fields, 'projection_matrix', 3, 4)
    for focal_px in (fx, fy):
        _check_focal('camera_matrix.data', focal_px)
    _check_center('camera_matrix.data', cx, cy)
    image_size = fields.count('image_width'), fields.count('image_height')
    division = fields.section('division') if 'division' in fields else None
    return Calibration(
        image_size=image_size,
        camera_name=fields.word('camera_name', 'unknown'),
        model=CameraInfoModel(
            *_distortion_from(fields),
            focal_px=(fx, fy),
            center_px=(cx, cy),
            residual_px=division.number('residual_px', low=0.0) if division else 0.0,
            image_size=image_size,
        ),
        estimate=_estimate_from(division) if division else None,
    )


def _check_focal(path: str, focal_px: float) -> None:
    """Reject a focal length that no camera has; a camera_info with it is rejected too."""
    if not MIN_FOCAL_PX <= focal_px <= MAX_NUMBER:
        raise ValueError(
            f'{path}: expected a focal length from {MIN_FOCAL_PX:g} to {MAX_NUMBER:g} px, '
            f'got {focal_px:g}'
        )


def _check_center(path: str, x: float, y: float) -> None:
    """Reject a centre that no camera has."""
    if not max(abs(x), abs(y)) <= MAX_NUMBER:
        raise ValueError(
            f'{path}: expected a centre within {MAX_NUMBER:g} px, got {x:g} and {y:g}'
        )


def _distortion_from(fields: Fields) -> tuple[str, tuple[float, ...]]:
    name = fields.choice('distortion_model', COEFFICIENTS, default='plumb_bob')
    data = _matrix_from(fields, 'distortion_coefficients', 1, None)
    counts = {4, 5} if name == 'plumb_bob' else {COEFFICIENTS[name]}
    if len(data) not in counts:
        expected = ' or '.join(str(n) for n in sorted(counts))
        raise ValueError(
            f'distortion_coefficients.data: expected {expected} numbers for {name}, '
            f'got {len(data)}'
        )
    return name, data


def _estimate_from(fields: Fields) -> CameraEstimate:
    focal_px, (x, y) = fields.number('focal_px'), fields.numbers('center_px', 2)
    k, k2, k3 = (fields.number(name) for name in ('k', 'k2', 'k3'))
    covariance = np.reshape(_matrix_from(fields, 'covariance', 6, 6), (6, 6))
    rms_px, views = fields.number('rms_px'), fields.count('views')
    _check_focal(fields.path_of('focal_px'), focal_px)
    _check_center(fields.path_of('center_px'), x, y)
    try:
        camera = DivisionCamera(focal_px, (x, y), k, k2, k3)
        return CameraEstimate(camera, covariance, rms_px, views)
    except ValueError as error:
        raise ValueError(f'{fields.path}.{error}') from None


def _matrix_from(fields: Fields, key: str, rows: int, cols: int | None) -> tuple[float, ...]:
    """Return the entries of a matrix, row by row; check its size (cols None: any number)."""
    matrix = fields.section(key)
    for name, size in (('rows', rows), ('cols', cols)):
        if size is not None and matrix.values.get(name) != size:
            raise matrix.error(name, str(size))
    if cols is not None:
        return matrix.numbers('data', rows * cols)
    data = matrix.numbers('data')
    if matrix.values.get('cols') != len(data):
        raise matrix.error('cols', f'{len(data)}, the length of data')
    return data
