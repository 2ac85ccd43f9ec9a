# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""What the views have taught of their camera, and what becomes of a new one."""

from __future__ import annotations

import math

from .camera_estimate import CameraEstimate
from .candidate import Sighting
from .change_detection import Changes
from .fit_views import fit_views
from .joining import explained_anew, settled, with_view
from .joint_fit import JointFit, unfitted
from .progress import progress_of
from .results import CalibrationOptions, CalibrationState, Verdict
from .selection import distance_to_views_px, is_worth_a_fit, poses_of, rows_of, tells_focal
from ..geometry import Array
from ..model.calibration_view import CalibrationView, camera_of
from ..model.camera_knowledge import common_camera, order_of, saved_camera
from ..model.prior import Knowledge
from ..model.uncertainty import DEFAULT_SIGMA_PX
from ..one_view.results import EstimateOptions

# A changed camera's lens is as sharp as before: its noise is no more than so many variances.
_AS_SHARP = 4.0


class Learning:
    """
    One camera, learnt from one view after the other.

    What it takes, and the verdict, state and fused camera, are those of ``SelfCalibration``.

    Attributes
    ----------
    fit, camera
        The joint fit of the kept views, and its camera.
    common
        What is known of a camera before any view.

    """

    def __init__(
        self, image_size: tuple[int, int], options: CalibrationOptions, robust: EstimateOptions
    ) -> None:
        width, height = image_size
        self._image_size, self._options, self._robust = image_size, options, robust
        self._middle_px = (0.5 * (width - 1.0), 0.5 * (height - 1.0))
        self.common = common_camera(image_size, options.center_spread, robust)
        self._changes = Changes(options.outliers_to_restart)
        self._knowledge: Knowledge
        self.fit: JointFit
        self.state: CalibrationState
        self.fused: CameraEstimate | None
        self.start(None)

    def start(self, adopted: CameraEstimate | None) -> None:
        """Forget all views; begin with a camera that is known, or with none."""
        self.verdict = Verdict.NO_POSE
        self._adopted = adopted
        self._changes.clear()
        self._last_poses = rows_of(())
        if adopted is None:
            self._take(unfitted(self.common, 1), self.common)
        else:
            knowledge = saved_camera(adopted, self._middle_px, self.common)
            self._take(unfitted(knowledge, order_of(adopted.camera)), knowledge)

    def sighting(self, view: CalibrationView) -> Sighting:
        """Look at a view through the camera as it is now."""
        return Sighting(view, self.fit, self.camera, self._image_size, self._robust)

    def learn(self, sighting: Sighting) -> None:
        """Find what becomes of a view, the verdict, and let the camera follow it."""
        self.verdict = Verdict.NO_POSE
        if sighting.fit is not self.fit:  # another view has been learnt from since
            sighting = self.sighting(sighting.view)
        if sighting.agrees and not self._is_new(sighting, self._last_poses):
            self._seen_again(sighting)
        elif sighting.agrees and not self._is_new(sighting, self._poses):
            self._agreed(sighting, Verdict.REDUNDANT)
        elif sighting.explained:
            joined = with_view(sighting, self._knowledge, self._options.max_views)
            if joined is not None:
                self._take(*joined)
                self._agreed(sighting, Verdict.USED)
            elif sighting.agrees:
                self._agreed(sighting, self._remembered(sighting))
            else:
                self._disagreed(sighting)

    def _seen_again(self, sighting: Sighting) -> None:
        """Take note of a board that has not moved: one look, for hours, is no more than one."""
        self.verdict, seen = Verdict.REDUNDANT, sighting.by_fit
        # But it speaks against outliers that come between, one by one.
        if self._changes.any_disagreed and seen and tells_focal(seen, self.common):
            self._changes.forget_an_outlier()

    def _remembered(self, sighting: Sighting) -> Verdict:
        """Remember what a view tells that is not worth one of the kept ones' places."""
        seen, fit = sighting.by_fit, self.fit
        if seen is None:
            return Verdict.REDUNDANT
        known = self._knowledge.remembering(seen.told, seen.pull, fit.lens, fit.variance)
        self._knowledge = known
        more = fit.variance * (known.information - self._fitted.information)
        if not is_worth_a_fit(fit, more):
            return Verdict.REDUNDANT
        again = fit_views(fit.views, fit.poses, fit.lens, fit.order, known, self._robust.sigma_px)
        self._take(settled(again, known, self._robust.sigma_px), known)
        return Verdict.USED

    def _is_new(self, sighting: Sighting, poses: Array) -> bool:
        """Say whether a view has the board where none of these poses (V, 12) has it."""
        model = sighting.known.model
        if model is None or not len(poses):
            return True
        away_px = distance_to_views_px(
            sighting.view.board_points, model.camera_from_board, poses, self.camera
        )
        return away_px > self._options.new_view * math.hypot(*self._image_size)

    def _agreed(self, sighting: Sighting, verdict: Verdict) -> None:
        self.verdict, seen = verdict, sighting.by_fit
        if seen is None:
            return
        self._last_poses = rows_of([sighting.view.pose_from_row(seen.row)])
        # A view from straight ahead agrees with any focal length.
        if tells_focal(seen, self.common):
            self._changes.note(sighting, agrees=True)
            self._start_over_if_changed()

    def _disagreed(self, sighting: Sighting) -> None:
        """Take a view for an outlier; where many are, the camera has changed."""
        self.verdict = Verdict.OUTLIER
        self._changes.note(sighting, agrees=False)
        self._start_over_if_changed()

    def _start_over_if_changed(self) -> None:
        witnesses = self._changes.witnesses(self.fit, self.common)
        if not witnesses:
            return
        fit = explained_anew(witnesses, self.common)
        as_sharp = fit.variance < max(_AS_SHARP * self.fit.variance, DEFAULT_SIGMA_PX**2)
        if as_sharp or self._changes.unanimous:
            self.start(None)
            self._take(fit, self.common)
            self.verdict = Verdict.RESTARTED

    def _take(self, fit: JointFit, knowledge: Knowledge) -> None:
        """Make a fit the one that holds, and what is known besides what it was made with."""
        self._knowledge = self._fitted = knowledge
        self.fit, self.camera = fit, camera_of(fit.lens, self._middle_px)
        self._poses = poses_of(fit)
        self.state, self.fused = progress_of(
            fit, self.camera, knowledge.views, self._image_size, self._options, self._adopted
        )
