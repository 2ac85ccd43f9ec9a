# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""
Loads and saves calibration files: the YAML of camera_calibration and camera_info_manager.

ROS reads image size, name, K, model, D, R and P from it. The additional key ``division`` holds
the division model, its covariance, where the lens was seen, and the shapes of the boards. Other
programs ignore it, and it may be missing. Files of version 0.1.0, with three terms of the lens
and square pixels, are loaded too, and those of other programs (``camera_formats``).
"""

from __future__ import annotations

from dataclasses import dataclass, replace
import math
import os
from pathlib import Path
import re
from typing import Any

import numpy as np
from p4pfr_ros.core.cameras.camera_info import CameraInfoModel, MAX_NUMBER, MIN_FOCAL_PX
from p4pfr_ros.core.cameras.division import DivisionCamera
from p4pfr_ros.core.geometry import Array, Mask
from p4pfr_ros.core.many_views.results import CameraEstimate, COVERAGE_SHAPE
from p4pfr_ros.core.model.board_shape import BoardShape, SHAPE_SIZE
from p4pfr_ros.core.model.lens import LENS_SIZE
from p4pfr_ros.files.camera_formats import camera_from
from p4pfr_ros.files.printable import printable_path, shown
from p4pfr_ros.files.writing import back_up, write_atomically
from p4pfr_ros.files.yaml_fields import ConfigError, Fields
from p4pfr_ros.files.yaml_reading import read_bytes, read_yaml
import yaml

# The key of what this package adds to ROS's file.
_DIVISION = 'division'

# Numbers of the division model beside focal length and centre: in every file, and not in those
# of version 0.1.0.
_OLD_NUMBERS = ('k', 'k2', 'k3')
_NEW_NUMBERS = ('k4', 'aspect', 'p1', 'p2')

# Size of the covariance in files of version 0.1.0: up to k3.
_OLD_SIZE = 6

# The parts of the image, row by row: one character each.
_UNSEEN, _SEEN = '.', '#'

# Larger boards, and boards that are bent more, in shares of their half size, are not believed.
_LARGEST_BOARD_M, _LARGEST_SHAPE = 1e4, 1.0

# Tolerated deviation of a board's covariance from symmetric and positive semidefinite.
_ROUNDING = 1e-6


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
    assumed
        What the file left open, and was assumed, such as the model of the lens; usually empty.

    Raises
    ------
    ValueError
        The image sizes of the calibration and the model differ.

    """

    image_size: tuple[int, int]
    camera_name: str
    model: CameraInfoModel
    estimate: CameraEstimate | None = None
    assumed: str = ''

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
            model=estimate.camera.to_camera_info_model(image_size, estimate.seen_radius_px),
            estimate=estimate,
        )


def save_calibration(path: str | os.PathLike[str], calibration: Calibration) -> Path | None:
    """
    Write a calibration file atomically; missing folders are created.

    A file that another program wrote is kept with .bak appended to its name, and that path is
    returned.

    Raises
    ------
    ConfigError
        The path is not writable, or not that of a regular file.

    """
    tree = _tree_from(calibration)
    text = yaml.dump(tree, Dumper=_Dumper, sort_keys=False, default_flow_style=None)
    backup = None if is_missing(path) or _is_ours(path) else back_up(path)
    write_atomically(path, text)
    return backup


def load_calibration(path: str | os.PathLike[str], camera_name: str = '') -> Calibration:
    """
    Load a calibration file, written by this package or another.

    Read are the files of camera_calibration and camera_info_manager, a printed CameraInfo, those
    of OpenCV's cv::FileStorage, Kalibr's camera chains, and camodocal's. ``camera_name`` selects
    one of several cameras in a chain, by its key (cam0) or a part of its topic.

    Raises
    ------
    ConfigError
        ``PATH: KEY: expected ..., got ...``.

    """
    tree = read_yaml(path)
    try:
        return _calibration_from(Fields.of(tree), camera_name)
    except ValueError as error:
        raise ConfigError(f'{printable_path(path)}: {error}') from None


def is_missing(path: str | os.PathLike[str]) -> bool:
    """Return whether there is no file; one that cannot be reached is not missing."""
    try:
        os.stat(path)
    except (FileNotFoundError, NotADirectoryError):
        return True
    except (OSError, ValueError):  # reading reports it
        pass
    return False


def _is_ours(path: str | os.PathLike[str]) -> bool:
    """Return whether this package wrote a file; an empty one need not be kept either."""
    data = read_bytes(path)
    is_ours = re.search(rf'^{_DIVISION}:'.encode(), data, re.MULTILINE) is not None
    return is_ours or not data.strip()


class _Rows(list[str]):
    """Text that is written one row a line."""


class _Dumper(yaml.SafeDumper):
    """Writes a picture made of characters so that it can be seen."""


_Dumper.add_representer(
    _Rows,
    lambda dumper, rows: dumper.represent_sequence(
        'tag:yaml.org,2002:seq', rows, flow_style=False
    ),
)


def _tree_from(calibration: Calibration) -> dict[str, Any]:
    (width, height), model = calibration.image_size, calibration.model
    (fx, fy), (cx, cy) = model.focal_px, model.center_px
    tree: dict[str, Any] = {
        'image_width': width,
        'image_height': height,
        'camera_name': calibration.camera_name,
    }
    if calibration.estimate is not None:
        tree[_DIVISION] = _division_from(calibration.estimate, model)
    d = model.coefficients
    # Required keys come last, so that a truncated file lacks them.
    return tree | {
        'camera_matrix': _matrix_tree(3, 3, (fx, model.skew_px, cx, 0.0, fy, cy, 0.0, 0.0, 1.0)),
        'distortion_model': model.distortion_model,
        'distortion_coefficients': _matrix_tree(1, len(d), d),
        'rectification_matrix': _matrix_tree(3, 3, (1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0)),
        'projection_matrix': _matrix_tree(
            3, 4, (fx, 0.0, cx, 0.0, 0.0, fy, cy, 0.0, 0.0, 0.0, 1.0, 0.0)
        ),
    }


def _division_from(estimate: CameraEstimate, model: CameraInfoModel) -> dict[str, Any]:
    """Return the section; numbers that are not known have no key."""
    camera = estimate.camera
    tree: dict[str, Any] = {'focal_px': camera.focal_px, 'center_px': list(camera.center_px)}
    for name in (*_OLD_NUMBERS, *_NEW_NUMBERS):
        tree[name] = getattr(camera, name)
    tree |= {
        'covariance': _square_tree(estimate.covariance),
        'rms_px': float(estimate.rms_px),
        'views': int(estimate.views),
        'scatter': float(estimate.scatter),
    }
    if not math.isnan(estimate.projection_sigma_px):
        tree['projection_sigma_px'] = float(estimate.projection_sigma_px)
    if estimate.seen_radius_px is not None:
        tree['seen_radius_px'] = float(estimate.seen_radius_px)
    tree['residual_px'] = float(model.residual_px)
    tree['residual_outside_px'] = float(model.residual_outside_px)
    if estimate.coverage is not None:
        marks = np.where(estimate.coverage, _SEEN, _UNSEEN)
        tree['coverage'] = _Rows(''.join(row) for row in marks)
    if estimate.board_shapes:
        shapes = estimate.board_shapes.items()
        tree['boards'] = {name: _board_tree(shape) for name, shape in shapes}
    return tree


def _board_tree(shape: BoardShape) -> dict[str, Any]:
    return {
        'center_m': shape.center.tolist(),
        'half_extent_m': shape.half_extent.tolist(),
        'numbers': shape.numbers.tolist(),
        'covariance': _square_tree(shape.covariance),
    }


def _square_tree(matrix: Array) -> dict[str, Any]:
    size = len(matrix)
    return _matrix_tree(size, size, tuple(matrix.ravel().tolist()))


def _matrix_tree(rows: int, cols: int, data: tuple[float, ...]) -> dict[str, Any]:
    return {'rows': rows, 'cols': cols, 'data': list(data)}


def _calibration_from(fields: Fields, camera_name: str) -> Calibration:
    camera = camera_from(fields, camera_name)
    if _DIVISION not in fields:
        return Calibration(
            image_size=camera.model.image_size,
            camera_name=camera.name,
            model=camera.model,
            assumed=camera.assumed,
        )
    # This package wrote them, after the other keys: a file without them is truncated.
    fields.section('distortion_coefficients')
    division = fields.section(_DIVISION)
    return Calibration(
        image_size=camera.model.image_size,
        camera_name=camera.name,
        model=replace(
            camera.model,
            residual_px=division.number('residual_px', low=0.0),
            residual_outside_px=_outside_from(division),
        ),
        estimate=_estimate_from(division),
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


def _optional(fields: Fields, key: str) -> float | None:
    """Return a number ≥ 0; None if it is missing."""
    return fields.number(key, low=0.0) if key in fields else None


def _estimate_from(fields: Fields) -> CameraEstimate:
    focal_px, (x, y) = fields.number('focal_px'), fields.numbers('center_px', 2)
    is_old = fields.section('covariance').values.get('rows') == _OLD_SIZE
    # In a file with the larger covariance a missing term is damage, not zero.
    names = _OLD_NUMBERS if is_old else (*_OLD_NUMBERS, *_NEW_NUMBERS)
    numbers = {name: fields.number(name) for name in names}
    covariance = _square_from(fields, 'covariance', _OLD_SIZE if is_old else LENS_SIZE)
    rms_px, views = fields.number('rms_px'), fields.count('views')
    _check_focal(fields.path_of('focal_px'), focal_px)
    _check_focal(fields.path_of('aspect'), focal_px * numbers.get('aspect', 1.0))
    _check_center(fields.path_of('center_px'), x, y)
    for name, number in numbers.items():
        if not abs(number) <= MAX_NUMBER:
            raise fields.error(name, f'a number within {MAX_NUMBER:g}')
    scatter = 1.0 if is_old else fields.number('scatter')
    projection_sigma_px = _optional(fields, 'projection_sigma_px')
    seen_radius_px = _optional(fields, 'seen_radius_px')
    shapes, coverage = _boards_from(fields), _coverage_from(fields)
    try:
        return CameraEstimate(
            DivisionCamera(focal_px, (x, y), **numbers),
            covariance,
            rms_px,
            views,
            scatter=scatter,
            projection_sigma_px=math.nan if projection_sigma_px is None else projection_sigma_px,
            seen_radius_px=seen_radius_px,
            board_shapes=shapes,
            coverage=coverage,
        )
    except ValueError as error:
        raise ValueError(f'{fields.path}.{error}') from None


def _outside_from(fields: Fields) -> float:
    """Return the residual where the lens was not seen; older files do not tell it apart."""
    return _optional(fields, 'residual_outside_px') or 0.0


def _coverage_from(fields: Fields) -> Mask | None:
    if 'coverage' not in fields:
        return None
    rows, columns = COVERAGE_SHAPE
    given = fields.values['coverage']
    is_picture = isinstance(given, list) and all(
        isinstance(row, str) and len(row) == columns and set(row) <= {_UNSEEN, _SEEN}
        for row in given
    )
    if not is_picture or len(given) != rows:
        raise fields.error('coverage', f'{rows} rows of {columns} characters {_UNSEEN} or {_SEEN}')
    return np.array([[mark == _SEEN for mark in row] for row in given])


def _boards_from(fields: Fields) -> dict[str, BoardShape]:
    """Return the shapes of the boards by name."""
    if 'boards' not in fields:
        return {}
    boards = fields.section('boards')
    for name in boards.values:
        if not isinstance(name, str):
            raise ValueError(f'{boards.path}: expected names of boards, got {shown(name)}')
    return {name: _shape_from(boards.section(name)) for name in boards.values}


def _shape_from(fields: Fields) -> BoardShape:
    """
    Return the shape of a board.

    A shape moves the points of every later view, so one that no board has is rejected.
    """
    center, half_extent = fields.numbers('center_m', 2), fields.numbers('half_extent_m', 2)
    numbers = fields.numbers('numbers', SHAPE_SIZE)
    covariance = _square_from(fields, 'covariance', SHAPE_SIZE)
    if not (min(half_extent) >= 0.0 and 0.0 < max(half_extent) <= _LARGEST_BOARD_M):
        raise fields.error('half_extent_m', f'lengths from 0 to {_LARGEST_BOARD_M:g} m')
    if not max(map(abs, center)) <= _LARGEST_BOARD_M:
        raise fields.error('center_m', f'coordinates within {_LARGEST_BOARD_M:g} m')
    if not max(map(abs, numbers)) <= _LARGEST_SHAPE:
        raise fields.error('numbers', f'shares of at most {_LARGEST_SHAPE:g}')
    if not _is_covariance(covariance):
        raise fields.error('covariance', 'a symmetric matrix ≥ 0 with entries of at most 1')
    return BoardShape(np.array(center), np.array(half_extent), np.array(numbers), covariance)


def _is_covariance(matrix: Array) -> bool:
    variances = np.diag(matrix)
    if not np.abs(matrix).max() <= _LARGEST_SHAPE**2 or variances.min() < 0.0:
        return False
    # What is exact is correlated with nothing.
    if matrix[variances == 0.0].any():
        return False
    # In units of the standard deviations.
    sigma = np.sqrt(variances)
    unit = matrix / np.outer(*(2 * [np.where(sigma > 0.0, sigma, 1.0)]))
    symmetric = np.abs(unit - unit.T).max() <= _ROUNDING
    return bool(symmetric and np.linalg.eigvalsh(unit)[0] >= -_ROUNDING)


def _square_from(fields: Fields, key: str, size: int) -> Array:
    matrix = fields.section(key)
    for name in ('rows', 'cols'):
        if matrix.values.get(name) != size:
            raise matrix.error(name, str(size))
    return np.reshape(matrix.numbers('data', size * size), (size, size))
