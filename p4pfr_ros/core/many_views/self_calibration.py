# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""``SelfCalibration``: estimates a camera from views of flat boards, one view at a time."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Sequence
import math
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from .board_views import BoardFrame
from .candidate import Candidate, EvaluatedView
from .change_detection import ChangeDetector
from .joint_fit import fit_of_prior, fit_views, JointFit, keyframes_of, Start
from .keyframes import (
    determines_focal,
    distance_to_views_px,
    fit_boards,
    fit_candidates,
    is_worth_a_fit,
    marginalised,
    poses_of,
    unscaled_row,
    with_view,
)
from .lens_terms import with_lens_terms
from .progress import Coverage, missing_views, state_of, uncertainty_of
from .results import CalibrationOptions, CalibrationState, CameraEstimate, Keyframe, Verdict
from ..cameras.camera_info import checked_image_size
from ..geometry import Array, POSE_SIZE
from ..model.lens import camera_from_lens, FOCAL, lens_from_camera
from ..model.observation import CenteredView, image_center_px, observe
from ..model.prior import (
    CommonPrior,
    FOCAL_SIGMA,
    FreeTerms,
    terms_of_lens,
    typical_focal_px,
    TypicalCamera,
)
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

# So many views that disagreed are kept, to be tried again when the camera is known better.
_MOST_REJECTED = 10

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
        self._prior: CommonPrior
        self._fitted_prior: CommonPrior
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

    @property
    def missing(self) -> tuple[str, ...]:
        """What would make the camera CALIBRATED, as advice; empty if it is."""
        if self._state is CalibrationState.CALIBRATED:
            return ()
        return missing_views(self._fit, self._coverage, self._uncertainty, self.options)

    def update(
        self,
        image_points: ArrayLike,
        board_points: ArrayLike,
        stamp: Any = None,
        *,
        board: str = '',
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
        board
            The name of the board: all views of one board share its shape.
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
        candidate = self._candidate(view, board)
        estimate = self._early_estimate(candidate) if on_pose else None
        if on_pose and estimate:
            on_pose(estimate)
        self._learn(candidate)
        if estimate is None:
            estimate = self._estimate(candidate)
            if on_pose:
                on_pose(estimate)
        if self._verdict is Verdict.USED:
            self._try_rejected_again()
        return estimate

    def _candidate(self, view: CenteredView, board: str) -> Candidate:
        """Return a view to be compared with the present fit."""
        return Candidate(view, board, self._fit, self._camera, self.image_size, self.robust)

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
        is_last = bool(fit.views) and fit.views[-1].view is candidate.view
        if is_last and len(fit.views) + self._prior.views == 1:
            return candidate.estimate_alone()
        estimate = candidate.estimate_with(fit, fit.poses[-1] if is_last else candidate.row)
        if estimate.model is None and self.state is not CalibrationState.CALIBRATED:
            return candidate.estimate_alone()
        return estimate

    @property
    def _is_doubtful(self) -> bool:
        """Whether a view has contradicted the camera a moment ago: it may have changed."""
        return self._doubtful_views > 0

    def _start(self, loaded: CameraEstimate | None) -> None:
        """Drop all views; start from a loaded camera, or from none, and from known boards."""
        self._verdict = Verdict.NO_POSE
        self._loaded = loaded
        self._changes.clear()
        self._rejected: deque[Candidate] = deque(maxlen=_MOST_REJECTED)
        self._doubtful_views = 0
        self._last_poses = _NO_POSES
        self._state, self._coverage = CalibrationState.UNCALIBRATED, Coverage(self.image_size)
        self._seen_radius_px = 0.0
        self._counted: set[CenteredView] = set()
        self._fused = None
        prior, terms = CommonPrior.without_views(self._typical), FreeTerms()
        frames: list[BoardFrame] = []
        if loaded is not None:
            lens = lens_from_camera(loaded.camera, self._middle_px)
            terms = terms_of_lens(lens)
            prior = CommonPrior.of_calibration(
                self._typical, lens, loaded.covariance, loaded.views
            ).with_scatter(loaded.scatter)
            seen = True if loaded.coverage is None else loaded.coverage
            self._coverage = Coverage(self.image_size, seen)
            half_diagonal_px = 0.5 * math.hypot(*self.image_size)
            self._seen_radius_px = loaded.seen_radius_px or half_diagonal_px
            shapes = loaded.board_shapes
            prior = prior.known_shapes(shapes.values())
            frames = [BoardFrame(n, each.center, each.half_extent) for n, each in shapes.items()]
        self._accept(fit_of_prior(prior, terms, tuple(frames)), prior)

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
        prior = self._prior = marginalised(
            self._prior, fit, evaluated.view, evaluated.information, evaluated.gradient
        )
        self._see(evaluated)
        fitted = self._fitted_prior.for_boards(prior.boards)
        added = fit.variance * (prior.information - fitted.information)
        if not is_worth_a_fit(fit, added):
            return Verdict.REDUNDANT
        sigma_px, start = self.robust.sigma_px, Start(fit.poses, fit.common, fit.boards, fit.limit)
        fit = fit_views(fit.views, start, fit.terms, prior, sigma_px)
        self._accept(with_lens_terms(fit, prior, sigma_px), prior)
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
        self._rejected.append(candidate)
        self._changes.add(candidate, agrees=False)
        self._restart_if_changed()

    def _restart_if_changed(self) -> None:
        evidence = self._changes.evidence(self._fit, self._typical)
        # Bent boards and rolling shutters deviate, too, but a camera of its own explains them
        # hardly better.
        each = [candidate.contrast.usual_excess for candidate in evidence]
        # A single view may be an outlier for any reason.
        excess = sum(min(one, _MOST_OF_ONE) for one in each)
        if not excess > _CHANGED_FOCAL:
            return
        prior = self._prior_of_boards
        fit = fit_candidates(evidence, prior)
        log_ratio = abs(math.log(fit.lens[FOCAL] / self._fit.lens[FOCAL]))
        differs = excess > _CHANGED or log_ratio > _FOCAL_CHANGE
        as_sharp = fit.variance < _AS_SHARP * self._fit.variance
        if (
            differs
            and (as_sharp or np.median(each) > _CHANGED_FOR_SURE)
            and not self._boards_explain(evidence, fit)
        ):
            self._start(None)
            self._accept(fit, prior)
            self._verdict = Verdict.RESTARTED

    def _boards_explain(self, evidence: Sequence[Candidate], changed: JointFit) -> bool:
        """Return whether boards that are bent explain the views about as well as a new camera."""
        bent = fit_boards(evidence, self._typical)
        excess = bent.cost_within(changed.limit) - changed.cost
        return excess < _CHANGED_FOCAL * min(bent.variance, changed.variance)

    @property
    def _prior_of_boards(self) -> CommonPrior:
        """The prior of a camera that has changed: the shapes of the boards stay."""
        prior = CommonPrior.without_views(self._typical).with_scatter(self._fit.scatter)
        if not np.isfinite(self._fit.full_covariance).all():
            return prior
        return prior.known_shapes(self._fit.shape(i) for i in range(len(self._fit.boards)))

    def _try_rejected_again(self) -> None:
        """Use a view that disagreed with an earlier estimate of the camera, but agrees now."""
        if not self._rejected:
            return
        old = self._rejected.popleft()
        again = self._candidate(old.view, old.board)
        joined = None
        if again.agrees and self._is_new(again, self._poses):
            joined = with_view(again, self._prior, self.options.max_views)
        if joined is not None:
            self._accept(*joined)
        elif not again.agrees:
            self._rejected.append(old)

    def _accept(self, fit: JointFit, prior: CommonPrior) -> None:
        """Make a fit the current one, with its prior."""
        self._prior = self._fitted_prior = prior
        self._fit, self._camera = fit, camera_from_lens(fit.lens, self._middle_px)
        self._poses = poses_of(fit)
        for view, first in zip(fit.views, fit.starts, strict=False):
            if view.view not in self._counted:
                inlier = fit.squares[first : first + len(view.image)] < fit.limit
                self._see_points(view.observation.image_points[inlier])
        self._counted = {view.view for view in fit.views}
        self._uncertainty = uncertainty_of(
            fit, self._coverage, self._seen_radius_px, self.image_size
        )
        views = len(fit.views) + prior.views
        state = state_of(self._uncertainty, float(fit.lens[FOCAL]), views, self.options)
        # A view that is added loses nothing: a larger uncertainty is another estimate of it.
        self._state = max(self._state, state, key=list(CalibrationState).index)
        self._fused = self._fused_estimate(fit, views)

    def _see(self, evaluated: EvaluatedView) -> None:
        """Count the inliers of a view as seen."""
        inlier = evaluated.squares < evaluated.fit.limit
        self._see_points(evaluated.view.observation.image_points[inlier])

    def _see_points(self, pixels: Array) -> None:
        self._coverage.add(pixels)
        radii = np.linalg.norm(pixels - np.asarray(self._camera.center_px), axis=1)
        self._seen_radius_px = max(self._seen_radius_px, float(radii.max(initial=0.0)))

    def _fused_estimate(self, fit: JointFit, views: int) -> CameraEstimate | None:
        """Return the camera unless it is UNCALIBRATED; the loaded one until there are views."""
        if self._state is CalibrationState.UNCALIBRATED:
            return None
        if self._uncertainty is None:  # rounding, with extreme numbers
            return self._fused
        if math.isnan(fit.rms_px):
            return self._loaded
        return CameraEstimate(
            self._camera,
            fit.covariance,
            fit.rms_px,
            views,
            scatter=fit.scatter,
            projection_sigma_px=self._uncertainty.projection_px,
            seen_radius_px=self._seen_radius_px,
            board_shapes={frame.name: fit.shape(i) for i, frame in enumerate(fit.boards)},
            coverage=self._coverage.seen,
        )


def _typical_camera(
    image_size: tuple[int, int], options: CalibrationOptions, robust: EstimateOptions
) -> TypicalCamera:
    corner_px = 0.5 * math.hypot(*image_size)
    focal_px = typical_focal_px(corner_px)
    focal_sigma_px = FOCAL_SIGMA * focal_px
    if robust.prior_focal_px is not None and robust.prior_focal_sigma_px is not None:
        focal_px, focal_sigma_px = robust.prior_focal_px, robust.prior_focal_sigma_px
    return TypicalCamera(
        corner_px=corner_px,
        center_sigma_px=options.center_spread * 2.0 * corner_px,
        focal_px=focal_px,
        focal_sigma_px=focal_sigma_px,
        k=robust.prior_k,
        k_sigma=robust.prior_k_sigma,
    )


def _checked(name: str, given: Any, kind: type[Any]) -> Any:
    """Return an options object, by default a new one; raise a TypeError for another type."""
    if given is None:
        return kind()
    if not isinstance(given, kind):
        raise TypeError(f'{name} must be {kind.__name__}, got {type(given).__name__}')
    return given
