# Copyright 2026 p4pfr_ros maintainers
#
# Licensed under the Apache License, Version 2.0 (the "License");
# you may not use this file except in compliance with the License.
# You may obtain a copy of the License at
#
#     http://www.apache.org/licenses/LICENSE-2.0
#
# Unless required by applicable law or agreed to in writing, software
# distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied.
# See the License for the specific language governing permissions and
# limitations under the License.

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
