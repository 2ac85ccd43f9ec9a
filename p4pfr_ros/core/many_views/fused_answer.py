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

"""A view's pose by the camera of all views, dressed as an estimate."""

from __future__ import annotations

from dataclasses import replace
import math

from .calibration_view import camera_of
from .estimate import PoseEstimate, Stop
from .observability import observability_of, without_the_undetermined
from .seen_by_fit import SeenByFit
from .solution import Solution


def fused_answer(seen: SeenByFit, known: PoseEstimate, threshold_px: float) -> PoseEstimate:
    """Dress a view's pose by a fit's camera; known is its estimate by a camera close to it."""
    camera = camera_of(seen.fit.lens, seen.view.scaled.center_px)
    pose = seen.view.pose_from_row(seen.row)
    covariance = seen.covariance()
    observable = observability_of(
        camera.focal_px, pose.translation, covariance, seen.view.scaled.corner_px
    )
    inliers = seen.squares < threshold_px**2
    stop = known.stop
    if observable.undetermined:
        stop = Stop.UNDETERMINED
    elif stop is Stop.UNDETERMINED:
        stop = Stop.CONFIDENT
    return replace(
        known,
        model=Solution(camera, pose),
        stop=stop,
        inliers=inliers,
        rms_px=math.sqrt(seen.squares[inliers].mean()) if inliers.any() else math.nan,
        covariance=without_the_undetermined(covariance, observable),
        alternatives=tuple(Solution(camera, o.camera_from_board) for o in known.alternatives),
        observable=observable,
    )
