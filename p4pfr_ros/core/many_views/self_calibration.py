# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""``SelfCalibration``: estimates a camera from views of flat boards, one view at a time."""

from __future__ import annotations

from collections.abc import Callable
import math
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from .candidate import Candidate
from .change_detection import ChangeDetector
from .joint_fit import fit_of_prior, fit_views, JointFit, keyframes_of
from .keyframes import (
    determines_focal,
    distance_to_views_px,
    fit_candidates,
    is_worth_a_fit,
    poses_of,
    unscaled_row,
    with_lens_order,
    with_view,
)
from .results import CalibrationOptions, CalibrationState, CameraEstimate, Keyframe, Verdict
from ..cameras.camera_info import checked_image_size
from ..cameras.division import DivisionCamera
from ..geometry import Array, POSE_SIZE
from ..model.lens import camera_from_lens, CX, FOCAL, K, LENS_SIZE
from ..model.observation import image_center_px, observe
from ..model.prior import calibrated_camera, LensPrior, typical_camera
from ..one_view.results import EstimateOptions, no_estimate, PoseEstimate, Status

# A restart requires that cameras of their own lower the chi-square of the views, in all, by more
# than boards that are bent or printed wrongly and rolling shutters do: by the first where one new
# camera has a focal length this much different, else by the second. And one new camera must fit
# them about as well as earlier views fitted the previous one, up to this multiple of the noise
# variance, or cameras of their own lower the chi-square of most views by the last but one, as
# nothing else could. One view counts at most the last.
_CHANGED_FOCAL, _CHANGED = 30.0, 120.0
_FOCAL_CHANGE = 0.035
_AS_SHARP = 1.5
_CHANGED_FOR_SURE = 100.0
_MOST_OF_ONE = 50.0

# After a view that contradicts a calibrated camera no pose is estimated from so many views: of a
# camera that has changed, not every view tells.
_DOUBTFUL_VIEWS = 4

# With a larger standard deviation of the focal length (relative), or of the bend at the corner,
# the camera is UNCALIBRATED.
_ROUGH = 0.15

_NO_POSES = np.empty((0, POSE_SIZE))


class SelfCalibration:
    """
    Estimates one camera from its views, and the pose of each view with that camera.

    Focal length, centre and distortion belong to the camera, a pose to a view. A bounded set of
    keyframes is fitted together; other views are marginalised. A view that disagrees with the
    camera is not used. If several views disagree, the camera has changed (zoom, focus), and the
    calibration restarts.

    Parameters
    ----------
    image_size
        (width, height) of the full raw image, px.
    options
        Options of the calibration.
    robust
        Options of the estimation from each view; its priors and sigma_px apply to the camera, too.

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
        width, height = checked_image_size(image_size)
        self.image_size = (int(width), int(height))
        self.options: CalibrationOptions = _checked('options', options, CalibrationOptions)
        self.robust: EstimateOptions = _checked('robust', robust, EstimateOptions)
        self._middle_px = image_center_px(self.image_size)
        self._typical = _typical_camera(self.image_size, self.options, self.robust)
        self._changes = ChangeDetector(self.options.outliers_to_restart)
        # The prior with all marginalised views, and the one in the current fit.
        self._prior: LensPrior
        self._fitted_prior: LensPrior
        self._fit: JointFit
        self._state: CalibrationState
        self._fused: CameraEstimate | None
        self._start(None)

    def __repr__(self) -> str:
        return (
            f'SelfCalibration({self.image_size}, {self.state.name}, '
            f'{len(self._fit.views)} keyframes, {self.fused})'
        )

    def reset(self) -> None:
        """Drop all views and the camera."""
        self._start(None)

    def load(self, estimate: CameraEstimate) -> None:
        """Restart from a camera that was calibrated earlier."""
        self._start(estimate)

    @property
    def state(self) -> CalibrationState:
        """The progress of the calibration."""
        return self._state

    @property
    def fused(self) -> CameraEstimate | None:
        """The camera and its covariance; None while ``state`` is UNCALIBRATED."""
        return self._fused

    @property
    def verdict(self) -> Verdict:
        """How the calibration used the last view."""
        return self._verdict

    @property
    def views(self) -> tuple[Keyframe, ...]:
        """The keyframes that the camera is estimated from, oldest first."""
        return keyframes_of(self._fit)

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
            Called once with the estimate that is returned. While the camera is CALIBRATED and
            the view agrees with it, the call comes before the update of the camera, which takes
            longer than the pose.

        Returns
        -------
        The estimate with the fused camera; its covariance includes the camera's. Without a fused
        camera, the estimate from this view alone. If the view disagrees with the camera: while
        CALIBRATED, the estimate with a covariance as large as the misfit asks for, or no pose
        (MISFIT) for this view and the next few; before, the estimate from this view alone.

        Raises
        ------
        ValueError
            A wrong shape, or a number that is not finite.

        """
        observation = observe(image_points, board_points, stamp)
        view = observation.centered(self._middle_px, self.image_size)
        candidate = Candidate(view, self._fit, self._camera, self.image_size, self.robust)
        estimate = self._early_estimate(candidate) if on_pose else None
        if on_pose and estimate:
            on_pose(estimate)
        self._learn(candidate)
        if estimate is None:
            estimate = self._estimate(candidate)
            if on_pose:
                on_pose(estimate)
        return estimate

    def _early_estimate(self, candidate: Candidate) -> PoseEstimate | None:
        """Return the estimate before the update; None if not calibrated, or the view disagrees."""
        if self._is_doubtful or not (
            self.state is CalibrationState.CALIBRATED and candidate.agrees
        ):
            return None
        assert candidate.evaluated is not None
        return candidate.estimate_with(candidate.fit, candidate.evaluated.row)

    def _estimate(self, candidate: Candidate) -> PoseEstimate:
        """Return the estimate with the updated camera, from the view alone, or MISFIT."""
        if self.state is CalibrationState.CALIBRATED and candidate.known.rows:
            if self._is_doubtful:
                status, n = Status.MISFIT, len(candidate.view.image)
                return no_estimate(status, n, candidate.known.iterations)
            if self._verdict is Verdict.OUTLIER:
                return candidate.estimate_with(self._fit, candidate.row)
        if self._fused is None or self._verdict in (Verdict.OUTLIER, Verdict.NO_POSE):
            return candidate.estimate_alone()
        fit = self._fit
        is_last = bool(fit.views) and fit.views[-1] is candidate.view
        if is_last and len(fit.views) + self._prior.views == 1:
            return candidate.estimate_alone()
        return candidate.estimate_with(fit, fit.poses[-1] if is_last else candidate.row)

    @property
    def _is_doubtful(self) -> bool:
        """Whether a view has contradicted the camera a moment ago: it may have changed."""
        return self._doubtful_views > 0

    def _start(self, loaded: CameraEstimate | None) -> None:
        """Drop all views; start from a loaded camera, or from none."""
        self._verdict = Verdict.NO_POSE
        self._loaded = loaded
        self._changes.clear()
        self._doubtful_views = 0
        self._last_poses = _NO_POSES
        if loaded is None:
            self._accept(fit_of_prior(self._typical, 1), self._typical)
            return
        camera, covariance = loaded.camera, loaded.covariance
        prior = calibrated_camera(camera, covariance, loaded.views, self._middle_px, self._typical)
        self._accept(fit_of_prior(prior, camera.order), prior)

    def _learn(self, candidate: Candidate) -> None:
        """Set the verdict on a view, and update the camera with it accordingly."""
        self._verdict = Verdict.NO_POSE
        self._doubtful_views = max(self._doubtful_views - 1, 0)
        if candidate.agrees and not self._is_new(candidate, self._last_poses):
            self._handle_stationary_board(candidate)
        elif candidate.agrees and not self._is_new(candidate, self._poses):
            self._record_agreement(candidate, Verdict.REDUNDANT)
        elif candidate.explained:
            joined = with_view(candidate, self._prior, self.options.max_views)
            if joined is not None:
                self._accept(*joined)
                self._record_agreement(candidate, Verdict.USED)
            elif candidate.agrees:
                self._record_agreement(candidate, self._marginalise(candidate))
            else:
                self._record_disagreement(candidate)

    def _handle_stationary_board(self, candidate: Candidate) -> None:
        """Count a stationary board as one view, however long it is visible."""
        self._verdict, evaluated = Verdict.REDUNDANT, candidate.evaluated
        # It still shows that the outliers in between are no change of the camera.
        if (
            self._changes.any_disagreed
            and evaluated
            and determines_focal(evaluated, self._typical)
        ):
            self._changes.drop_outlier()

    def _marginalise(self, candidate: Candidate) -> Verdict:
        """Add the information of a view that replaces no keyframe; fit again if it is worth it."""
        evaluated, fit = candidate.evaluated, self._fit
        if evaluated is None:
            return Verdict.REDUNDANT
        prior = self._prior.marginalise(
            evaluated.information, evaluated.gradient, fit.lens, fit.variance
        )
        self._prior = prior
        added = fit.variance * (prior.information - self._fitted_prior.information)
        if not is_worth_a_fit(fit, added):
            return Verdict.REDUNDANT
        sigma_px = self.robust.sigma_px
        fit = fit_views(fit.views, fit.poses, fit.lens, fit.order, prior, sigma_px)
        self._accept(with_lens_order(fit, prior, sigma_px), prior)
        return Verdict.USED

    def _is_new(self, candidate: Candidate, poses: Array) -> bool:
        """Return whether a view differs from those with these poses (V, 12)."""
        pose = candidate.known_pose
        if pose is None or not len(poses):
            return True
        distance_px = distance_to_views_px(
            candidate.view.observation.board_points, pose, poses, self._camera
        )
        return distance_px > self.options.new_view * math.hypot(*self.image_size)

    def _record_agreement(self, candidate: Candidate, verdict: Verdict) -> None:
        """Store the pose and, if it has information on the focal length, the view."""
        self._verdict, evaluated = verdict, candidate.evaluated
        if evaluated is None:
            return
        self._last_poses = unscaled_row(evaluated.row, candidate.view.observation)[None]
        # A fronto-parallel view is not informative: it agrees with any focal length.
        if determines_focal(evaluated, self._typical):
            self._changes.add(candidate, agrees=True)
            self._restart_if_changed()

    def _record_disagreement(self, candidate: Candidate) -> None:
        self._verdict = Verdict.OUTLIER
        if candidate.contradicts:
            self._doubtful_views = _DOUBTFUL_VIEWS
        self._changes.add(candidate, agrees=False)
        self._restart_if_changed()

    def _restart_if_changed(self) -> None:
        evidence = self._changes.evidence(self._fit, self._typical)
        # Bent boards and rolling shutters deviate, too, but a camera of its own explains them
        # hardly better.
        each = [candidate.contrast.excess for candidate in evidence]
        # A single view may be an outlier for any reason.
        excess = sum(min(one, _MOST_OF_ONE) for one in each)
        if not excess > _CHANGED_FOCAL:
            return
        fit = fit_candidates(evidence, self._typical)
        log_ratio = abs(math.log(fit.lens[FOCAL] / self._fit.lens[FOCAL]))
        differs = excess > _CHANGED or log_ratio > _FOCAL_CHANGE
        as_sharp = fit.variance < _AS_SHARP * self._fit.variance
        if differs and (as_sharp or np.median(each) > _CHANGED_FOR_SURE):
            self._start(None)
            self._accept(fit, self._typical)
            self._verdict = Verdict.RESTARTED

    def _accept(self, fit: JointFit, prior: LensPrior) -> None:
        """Make a fit the current one, with its prior."""
        self._prior = self._fitted_prior = prior
        self._fit, self._camera = fit, camera_from_lens(fit.lens, self._middle_px)
        self._poses = poses_of(fit)
        self._state, self._fused = _progress_of(
            fit, self._camera, prior.views, self.image_size, self.options, self._loaded
        )


def _typical_camera(
    image_size: tuple[int, int], options: CalibrationOptions, robust: EstimateOptions
) -> LensPrior:
    focal = None
    if robust.prior_focal_px is not None and robust.prior_focal_sigma_px is not None:
        focal = robust.prior_focal_px, robust.prior_focal_sigma_px
    k = robust.prior_k, robust.prior_k_sigma
    return typical_camera(image_size, options.center_spread, focal, k)


def _checked(name: str, given: Any, kind: type[Any]) -> Any:
    """Return an options object, by default a new one; raise a TypeError for another type."""
    if given is None:
        return kind()
    if not isinstance(given, kind):
        raise TypeError(f'{name} must be {kind.__name__}, got {type(given).__name__}')
    return given


def _progress_of(
    fit: JointFit,
    camera: DivisionCamera,
    marginalised: int,
    image_size: tuple[int, int],
    options: CalibrationOptions,
    loaded: CameraEstimate | None,
) -> tuple[CalibrationState, CameraEstimate | None]:
    """
    Return the state of a fit, and its camera unless it is UNCALIBRATED.

    marginalised: the number of views in the prior; loaded: the camera that the calibration started
    from, which is returned as it is while there are no views.
    """
    views, covariance = len(fit.views) + marginalised, fit.covariance
    state = _state_of(fit.lens, covariance, 0.5 * math.hypot(*image_size), views, options)
    if state is CalibrationState.UNCALIBRATED:
        return state, None
    rms_px = fit.rms_px
    if math.isnan(rms_px):
        return state, loaded
    return state, CameraEstimate(camera, covariance, rms_px, views)


def _state_of(
    lens: Array, covariance: Array, corner_px: float, views: int, options: CalibrationOptions
) -> CalibrationState:
    """Return the state of a lens (6,) with a covariance (6, 6); corner_px: half the diagonal."""
    # Rounding may leave negative variances if the numbers are extreme.
    if not (np.diag(covariance) >= 0.0).all():
        return CalibrationState.UNCALIBRATED
    focal_share = math.sqrt(covariance[FOCAL, FOCAL]) / lens[FOCAL]
    center_share = math.sqrt(np.diag(covariance)[CX:K].max()) / (2.0 * corner_px)
    # At the corner the ray's depth is  1 + k q + k2 q² + k3 q³,  q = |d|².
    q = (corner_px / lens[FOCAL]) ** 2
    by_terms = np.zeros(LENS_SIZE)
    by_terms[K:] = q, q**2, q**3
    bend = math.sqrt(by_terms @ covariance @ by_terms)
    if not (focal_share < _ROUGH and bend < _ROUGH):
        return CalibrationState.UNCALIBRATED
    calibrated = (
        views >= options.min_views
        and focal_share < options.focal_tolerance
        and center_share < options.center_tolerance
        and bend < options.bend_tolerance
    )
    return CalibrationState.CALIBRATED if calibrated else CalibrationState.CONVERGING
