# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""
Pose, focal length and distortion from one view of a flat marker or board. Needs no ROS.

The solver needs NumPy and Numba only. ``detect`` (OpenCV), ``load_boards`` and
``load_calibration`` (PyYAML) are imported on first use.
"""

from __future__ import annotations

import importlib
import importlib.metadata
from typing import Any, TYPE_CHECKING

from .core.cameras.camera_info import CameraInfoModel
from .core.cameras.division import DivisionCamera
from .core.geometry import Pose
from .core.many_views.results import (
    CalibrationOptions,
    CalibrationState,
    CameraEstimate,
    Keyframe,
    Verdict,
)
from .core.many_views.self_calibration import SelfCalibration
from .core.minimal.solution import Solution
from .core.minimal.solver import SolutionBatch, solve_p4pfr, solve_p4pfr_batch
from .core.model.board_shape import BoardShape
from .core.one_view.estimate_pose import estimate_pose
from .core.one_view.results import EstimateOptions, Observability, PoseEstimate, Status

if TYPE_CHECKING:
    from .detection import detect
    from .files.boards import load_boards
    from .files.calibration import load_calibration

    __version__: str

__all__ = [
    'BoardShape',
    'CalibrationOptions',
    'CalibrationState',
    'CameraEstimate',
    'CameraInfoModel',
    'DivisionCamera',
    'EstimateOptions',
    'Keyframe',
    'Observability',
    'Pose',
    'PoseEstimate',
    'SelfCalibration',
    'Solution',
    'SolutionBatch',
    'Status',
    'Verdict',
    'detect',
    'estimate_pose',
    'load_boards',
    'load_calibration',
    'solve_p4pfr',
    'solve_p4pfr_batch',
]

_ON_FIRST_USE = {
    'detect': '.detection',
    'load_boards': '.files.boards',
    'load_calibration': '.files.calibration',
}


def __getattr__(name: str) -> Any:
    if name == '__version__':
        return _version()
    if name not in _ON_FIRST_USE:
        raise AttributeError(f'module {__name__!r} has no attribute {name!r}')
    value = getattr(importlib.import_module(_ON_FIRST_USE[name], __name__), name)
    globals()[name] = value
    return value


def _version() -> str:
    """Return the version of setup.py, which a release sets."""
    try:
        return importlib.metadata.version(__name__)
    except importlib.metadata.PackageNotFoundError:  # run from its sources
        return 'unknown'
