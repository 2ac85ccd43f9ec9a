# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""A view's pose by the camera of all views, dressed as an estimate."""

from __future__ import annotations

from dataclasses import replace
import math

from .view_by_fit import SeenByFit
from ..minimal.solution import Solution
from ..model.calibration_view import camera_of
from ..one_view.observability import observability_of, without_the_undetermined
from ..one_view.results import PoseEstimate, Status


def fused_answer(seen: SeenByFit, known: PoseEstimate, threshold_px: float) -> PoseEstimate:
    """Dress a view's pose by a fit's camera; known is its estimate by a camera close to it."""
    camera = camera_of(seen.fit.lens, seen.view.scaled.center_px)
    pose = seen.view.pose_from_row(seen.row)
    covariance = seen.covariance()
    observable = observability_of(
        camera.focal_px, pose.translation, covariance, seen.view.scaled.corner_px
    )
    inliers = seen.squares < threshold_px**2
    stop = known.status
    if observable.undetermined:
        stop = Status.UNDETERMINED
    elif stop is Status.UNDETERMINED:
        stop = Status.CONFIDENT
    return replace(
        known,
        model=Solution(camera, pose),
        status=stop,
        inliers=inliers,
        rms_px=math.sqrt(seen.squares[inliers].mean()) if inliers.any() else math.nan,
        covariance=without_the_undetermined(covariance, observable),
        alternatives=tuple(Solution(camera, o.camera_from_board) for o in known.alternatives),
        observable=observable,
    )
