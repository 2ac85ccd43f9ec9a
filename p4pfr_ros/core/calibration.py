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

"""``SelfCalibration``: the camera from all its views of flat boards, while they come in."""

from __future__ import annotations

import math
from typing import Any

from numpy.typing import ArrayLike

from .answer import no_estimate
from .calibration_terms import CalibrationOptions, CalibrationState, KeptView, Verdict
from .calibration_view import calibration_view, camera_of
from .camera_estimate import CameraEstimate
from .camera_knowledge import common_camera, order_of, saved_camera
from .changes import Changes
from .estimate import PoseEstimate, RansacOptions, Stop
from .fit_views import fit_views
from .fused_answer import fused_answer, seen_by_fit
from .geometry import Array
from .information import Knowledge
from .joining import explained_anew, settled, with_view
from .joint_fit import JointFit, unfitted
from .kept_views import kept_views
from .lone_answer import lone_answer
from .progress import state_of
from .sighting import Sighting
from .uncertainty import DEFAULT_SIGMA_PX
from .view_choice import distance_to_views_px, is_worth_a_fit, rows_of, tells_focal

# A changed camera's lens is as sharp as before: its noise is no more than so many variances.
_AS_SHARP = 4.0


class SelfCalibration:
    """
    Estimates one camera from its views, one at a time, and each view's pose by that camera.

    Focal length, centre and distortion are the camera's, a pose belongs to a view. A bounded set
    of views is kept for what they tell of the camera, and all are fitted together. A view that
    disagrees does not count; when views go on disagreeing, the camera has changed (zoom, focus),
    and is started over.

    Parameters
    ----------
    image_size
        (width, height) of the full raw picture, px.
    options
        How to calibrate.
    robust
        How to search each view; its priors and its noise hold for the camera.

    Attributes
    ----------
    state
        How far the calibration is.
    fused
        The camera and how sure it is; None while ``state`` is UNCALIBRATED.
    verdict
        What became of the last view.

    Raises
    ------
    ValueError
        The size is not positive.

    """

    def __init__(
        self,
        image_size: tuple[int, int],
        *,
        options: CalibrationOptions | None = None,
        robust: RansacOptions | None = None,
    ) -> None:
        width, height = image_size
        if not (width > 0 and height > 0):
            raise ValueError(f'image_size must be positive, got {image_size}')
        self.image_size = (int(width), int(height))
        self.options = options or CalibrationOptions()
        self.robust = robust or RansacOptions()
        self.verdict = Verdict.UNUSED
        self.state = CalibrationState.UNCALIBRATED
        self.fused: CameraEstimate | None = None
        self._middle_px = (0.5 * (width - 1.0), 0.5 * (height - 1.0))
        self._common = common_camera(self.image_size, self.options.center_spread, self.robust)
        self._changes = Changes(self.options.outliers_to_restart)
        self._last_poses = rows_of(())
        self._knowledge = self._fitted = self._common
        self._fit: JointFit
        self._start(self._common, None)

    def reset(self) -> None:
        """Forget all views, and the camera."""
        self._start(self._common, None)

    def adopt(self, estimate: CameraEstimate) -> None:
        """Start over from a camera that is known: an earlier calibration, say."""
        self._start(saved_camera(estimate, self._middle_px, self._common), estimate)

    @property
    def views(self) -> tuple[KeptView, ...]:
        """The views that the camera is estimated from, oldest first."""
        return kept_views(self._fit)

    def update(
        self, image_points: ArrayLike, board_points: ArrayLike, stamp: Any = None
    ) -> PoseEstimate:
        """
        Take in one view, and estimate its pose.

        Parameters
        ----------
        image_points : (N, 2) array, N ≥ 4
            Pixels of the full raw picture; pixel centres are integers.
        board_points : (N, 2) array
            The same points on the board's plane Z = 0, metres.
        stamp
            Whatever tells the view from others; it is kept with it.

        Returns
        -------
        The estimate by the fused camera, whose errors its covariance holds. While there is no
        such camera, or where the view disagrees with it, the estimate by the view alone.

        Raises
        ------
        ValueError
            A wrong shape, or a number that is not finite.

        """
        view = calibration_view(image_points, board_points, self.image_size, stamp)
        self.verdict = Verdict.UNUSED
        if view.scaled.collinear:
            return no_estimate(Stop.COLLINEAR, len(view), 0)
        sighting = Sighting(view, self._fit, self._camera, self.image_size, self.robust)
        self._judge(sighting)
        return self._answer(sighting)

    def _judge(self, sighting: Sighting) -> None:
        """Find what becomes of a view."""
        if sighting.agrees and not self._is_new(sighting, self._last_poses):
            self._seen_again(sighting)
        elif sighting.agrees and not self._is_new(sighting, self._poses):
            self._agreed(sighting, Verdict.KNOWN)
        elif sighting.explained:
            joined = with_view(sighting, self._knowledge, self.options.max_views)
            if joined is not None:
                self._take(*joined)
                self._agreed(sighting, Verdict.KEPT)
            elif sighting.agrees:
                self._agreed(sighting, self._remembered(sighting))
            else:
                self._disagreed(sighting)

    def _seen_again(self, sighting: Sighting) -> None:
        """Take note of a board that has not moved: one look, for hours, is no more than one."""
        self.verdict, seen = Verdict.KNOWN, sighting.by_fit
        # But it speaks against outliers that come between, one by one.
        if self._changes.any_disagreed and seen and tells_focal(seen, self._common):
            self._changes.forget_an_outlier()

    def _remembered(self, sighting: Sighting) -> Verdict:
        """Remember what a view tells that is not worth one of the kept ones' places."""
        seen, fit = sighting.by_fit, self._fit
        if seen is None:
            return Verdict.KNOWN
        known = self._knowledge.remembering(seen.told, seen.pull, fit.lens, fit.variance)
        self._knowledge = known
        more = fit.variance * (known.information - self._fitted.information)
        if not is_worth_a_fit(fit, more):
            return Verdict.KNOWN
        again = fit_views(fit.views, fit.poses, fit.lens, fit.order, known, self.robust.sigma_px)
        self._take(settled(again, known, self.robust.sigma_px), known)
        return Verdict.KEPT

    def _is_new(self, sighting: Sighting, poses: Array) -> bool:
        """Say whether a view has the board where none of these poses (V, 12) has it."""
        model = sighting.known.model
        if model is None or not len(poses):
            return True
        away_px = distance_to_views_px(
            sighting.view.board_points, model.camera_from_board, poses, self._camera
        )
        return away_px > self.options.new_view * math.hypot(*self.image_size)

    def _agreed(self, sighting: Sighting, verdict: Verdict) -> None:
        self.verdict, seen = verdict, sighting.by_fit
        if seen is None:
            return
        self._last_poses = rows_of([sighting.view.pose_from_row(seen.row)])
        # A view from straight ahead agrees with any focal length.
        if tells_focal(seen, self._common):
            self._changes.note(sighting, agrees=True)
            self._start_over_if_changed()

    def _disagreed(self, sighting: Sighting) -> None:
        """Take a view for an outlier; where many are, the camera has changed."""
        self.verdict = Verdict.OUTLIER
        self._changes.note(sighting, agrees=False)
        self._start_over_if_changed()

    def _start_over_if_changed(self) -> None:
        witnesses = self._changes.witnesses(self._fit, self._common)
        if not witnesses:
            return
        fit = explained_anew(witnesses, self._common)
        as_sharp = fit.variance < max(_AS_SHARP * self._fit.variance, DEFAULT_SIGMA_PX**2)
        if as_sharp or self._changes.unanimous:
            self._start(self._common, None)
            self._take(fit, self._common)
            self.verdict = Verdict.RESTARTED

    def _start(self, knowledge: Knowledge, adopted: CameraEstimate | None) -> None:
        self.verdict = Verdict.UNUSED
        self._adopted = adopted
        self._changes.clear()
        self._last_poses = rows_of(())
        order = order_of(adopted.camera) if adopted else 1
        self._take(unfitted(knowledge, order), knowledge)

    def _take(self, fit: JointFit, knowledge: Knowledge) -> None:
        """Make a fit the one that holds, and what is known besides what it was made with."""
        self._knowledge = self._fitted = knowledge
        self._fit, self._camera = fit, camera_of(fit.lens, self._middle_px)
        pairs = zip(fit.views, fit.poses, strict=True)
        self._poses = rows_of([view.pose_from_row(row) for view, row in pairs])
        covariance, views = fit.covariance, len(fit.views) + knowledge.views
        corner_px = 0.5 * math.hypot(*self.image_size)
        self.state = state_of(fit.lens, covariance, corner_px, views, self.options)
        if self.state is CalibrationState.UNCALIBRATED:
            self.fused = None
        elif math.isfinite(fit.rms_px):
            self.fused = CameraEstimate(self._camera, covariance, fit.rms_px, views)
        else:  # no view yet
            self.fused = self._adopted

    def _answer(self, sighting: Sighting) -> PoseEstimate:
        """Answer by the fused camera where there is one and the view agrees."""
        if self.verdict is Verdict.OUTLIER:
            return lone_answer(sighting, self._common)
        if self.fused is None or self.verdict is Verdict.UNUSED:
            return sighting.alone
        seen, fit = sighting.by_fit, self._fit
        if seen is None or fit is not sighting.fit:
            is_last = bool(fit.views) and fit.views[-1] is sighting.view
            seen = seen_by_fit(sighting.view, fit.poses[-1] if is_last else sighting.row, fit)
        return fused_answer(seen, self._camera, sighting.known_or_alone, self.robust.threshold_px)
