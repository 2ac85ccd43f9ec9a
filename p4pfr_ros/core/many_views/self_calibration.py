# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""``SelfCalibration``: the camera from all its views of flat boards, while they come in."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from numpy.typing import ArrayLike

from .camera_estimate import CameraEstimate
from .candidate import Sighting
from .fused_answer import fused_answer
from .keyframes import keyframes
from .learning import Learning
from .lone_answer import lone_answer
from .results import CalibrationOptions, CalibrationState, Keyframe, Verdict
from .view_by_fit import seen_by_fit
from ..model.calibration_view import calibration_view
from ..one_view.results import EstimateOptions, PoseEstimate


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
        robust: EstimateOptions | None = None,
    ) -> None:
        width, height = image_size
        if not (width > 0 and height > 0):
            raise ValueError(f'image_size must be positive, got {image_size}')
        self.image_size = (int(width), int(height))
        self.options = options or CalibrationOptions()
        self.robust = robust or EstimateOptions()
        self._learning = Learning(self.image_size, self.options, self.robust)

    def reset(self) -> None:
        """Forget all views, and the camera."""
        self._learning.start(None)

    def load(self, estimate: CameraEstimate) -> None:
        """Start over from a camera that is known: an earlier calibration, say."""
        self._learning.start(estimate)

    @property
    def state(self) -> CalibrationState:
        """How far the calibration is."""
        return self._learning.state

    @property
    def fused(self) -> CameraEstimate | None:
        """The camera and how sure it is; None while ``state`` is UNCALIBRATED."""
        return self._learning.fused

    @property
    def verdict(self) -> Verdict:
        """What became of the last view."""
        return self._learning.verdict

    @property
    def views(self) -> tuple[Keyframe, ...]:
        """The views that the camera is estimated from, oldest first."""
        return keyframes(self._learning.fit)

    def update(
        self,
        image_points: ArrayLike,
        board_points: ArrayLike,
        stamp: Any = None,
        *,
        on_pose: Callable[[PoseEstimate], object] | None = None,
    ) -> PoseEstimate:
        """
        Estimate the pose of one view, and update the camera with it.

        Parameters
        ----------
        image_points : (N, 2) array, N ≥ 4
            Pixels of the full raw image; pixel centres are integers.
        board_points : (N, 2) array
            The same points on the board's plane Z = 0, metres.
        stamp
            Any value that identifies the view; it is stored with a keyframe.
        on_pose
            Called once with the estimate that is returned, as soon as it is known: while the
            camera is CALIBRATED and the view agrees with it, that is before the camera is
            updated, which takes longer than the pose.

        Returns
        -------
        The estimate by the fused camera; its covariance includes the camera's. Without a fused
        camera, or if the view disagrees with it, the estimate from this view alone.

        Raises
        ------
        ValueError
            A wrong shape, or a number that is not finite.

        """
        view = calibration_view(image_points, board_points, self.image_size, stamp)
        candidate = self._learning.sighting(view)
        estimate = self._early_estimate(candidate) if on_pose else None
        if on_pose and estimate:
            on_pose(estimate)
        self._learning.learn(candidate)
        if estimate is None:
            estimate = self._estimate(candidate)
            if on_pose:
                on_pose(estimate)
        return estimate

    def _early_estimate(self, candidate: Sighting) -> PoseEstimate | None:
        """Return the pose by the calibrated camera; None if there is none yet, or it disagrees."""
        if self.state is not CalibrationState.CALIBRATED or not candidate.agrees:
            return None
        assert candidate.by_fit is not None
        return fused_answer(candidate.by_fit, candidate.known, self.robust.threshold_px)

    def _estimate(self, candidate: Sighting) -> PoseEstimate:
        """Return the pose by the updated camera, if both agree."""
        learning = self._learning
        if learning.verdict is Verdict.OUTLIER:
            return lone_answer(candidate, learning.common)
        if learning.fused is None or learning.verdict is Verdict.NO_POSE:
            return candidate.alone
        seen, fit = candidate.by_fit, learning.fit
        if seen is None or fit is not candidate.fit:
            is_last = bool(fit.views) and fit.views[-1] is candidate.view
            seen = seen_by_fit(candidate.view, fit.poses[-1] if is_last else candidate.row, fit)
        return fused_answer(seen, candidate.known_or_alone, self.robust.threshold_px)
