# SPDX-License-Identifier: Apache-2.0
"""Pose, focal length and distortion from one view of a flat marker or board. No ROS in here."""

from .core.calibration import SelfCalibration
from .core.calibration_terms import CalibrationOptions, CalibrationState, KeptView, Verdict
from .core.camera import DivisionCamera
from .core.camera_estimate import CameraEstimate
from .core.estimate import PoseEstimate, RansacOptions, Stop
from .core.geometry import Pose
from .core.minimal import SolutionBatch, solve_p4pfr, solve_p4pfr_batch
from .core.observability import Observability
from .core.robust import estimate_pose
from .core.solution import Solution

__version__ = '0.1.0'

__all__ = [
    'CalibrationOptions',
    'CalibrationState',
    'CameraEstimate',
    'DivisionCamera',
    'KeptView',
    'Observability',
    'Pose',
    'PoseEstimate',
    'RansacOptions',
    'SelfCalibration',
    'Solution',
    'SolutionBatch',
    'Stop',
    'Verdict',
    'estimate_pose',
    'solve_p4pfr',
    'solve_p4pfr_batch',
]
