# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""
The estimate of one view by the full fit of ``full_fit``, its camera unknown or known.

The search and the fit without deviations give the starts: the best model and its alternatives.

This module stands alone because `estimate_pose` is complete without it: it is the last step where
the options allow deviations.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
import math

import numpy as np

from .describe import MAX_RATIO, ViewProblem
from .full_fit import fit_full, other_focal_excess, public_covariance
from .full_model import (
    ASPECT,
    BEND,
    BOW_XX,
    DEVIATIONS,
    full_work,
    FullProblem,
    FullWork,
    lens_of,
    LOG_FOCAL,
    PARAMETERS,
    SHEAR,
    state_from,
    STATE_SIZE,
    STRETCH,
)
from .results import (
    EstimateOptions,
    mark_undetermined,
    no_estimate,
    Observability,
    observability_of,
    PoseEstimate,
    Status,
)
from ..cameras.division import DivisionCamera
from ..geometry import Array, POSE_SIZE, TRANSLATION
from ..linalg import inverse_of_information
from ..minimal.solution import Solution
from ..model.lens import (
    camera_from_lens,
    CX,
    CY,
    FOCAL,
    K,
    K2,
    K3,
    lens_from_camera,
    LENS_SIZE,
    POSE_COLUMNS,
)
from ..model.observation import CenteredView
from ..model.prior import typical_focal_px
from ..model.uncertainty import COV_FOCAL, COVARIANCE_SIZE, DEFAULT_SIGMA_PX

# A focal length with a smaller relative standard deviation needs no likelihood test; an observable
# one must be distinguishable from its half and its double.
_CERTAIN = 0.03
_FOCAL_FACTORS = (0.5, 2.0)
_HELD_STEPS = 30

# A variance above this share of the prior's is the prior's, not the view's.
_FROM_THE_VIEW = 0.5

# Optima with rotations closer than this, rad, are the same.
_SAME_RAD = 0.02

# Beyond this difference of logarithms a focal length is tried with a typical one instead, too.
_FAR_FROM_TYPICAL = 1.5

# Largest number of times that a known camera's view gets larger deviations.
_WIDENINGS = 4

_SMALLEST_VARIANCE = 0.1**2


@dataclass(frozen=True, slots=True, eq=False)
class _Fit:
    """A full fit: its state, workspace, and the numbers that `fit_full` returns."""

    state: Array
    work: FullWork
    lens: Array
    prior_chi2: float
    variance: float
    dof: float
    inliers: int
    total: float


@dataclass(frozen=True, slots=True)
class FullEstimate:
    """One view, and whether its principal point is known."""

    view: ViewProblem
    center_known: bool

    def of(self, estimate: PoseEstimate) -> PoseEstimate:
        """Return the estimate by the full fit, from another one's models as starts."""
        assert estimate.model is not None
        camera = self.view.camera
        if camera is None:
            problem = self._problem(estimate.model.camera.focal_px)
        else:
            lens = lens_from_camera(camera, self.view.view.center_px)
            problem = known_lens_problem(
                self.view.view, lens, np.zeros((LENS_SIZE, LENS_SIZE)), self.view.options
            )
        starts = (estimate.model, *estimate.alternatives)
        if camera is None:
            typical_px = typical_focal_px(self.view.view.corner_px)
            starts += tuple(
                self._with_typical_focal(start)
                for start in starts
                if abs(math.log(start.camera.focal_px / typical_px)) > _FAR_FROM_TYPICAL
            )
        fits = [fit for start in starts if (fit := self._fit(start, problem)) is not None]
        n = len(self.view.view.image)
        if not fits:
            return no_estimate(Status.NO_SOLUTION, n, estimate.iterations)
        variance = min(fit.variance for fit in fits)
        costs = [self._cost(fit, variance) for fit in fits]
        best, *others = sorted(zip(costs, fits, strict=True), key=lambda pair: pair[0])
        if best[1].inliers < min(n, self.view.options.min_inliers):
            return no_estimate(Status.NO_CONSENSUS, n, estimate.iterations)
        close = [fit for cost, fit in others if cost - best[0] < MAX_RATIO]
        return self._result(best[1], self._different(best[1], close), problem, estimate)

    def _with_typical_focal(self, start: Solution) -> Solution:
        """
        Return a start with a typical focal length and the same size in the image.

        A few points may fit a focal length far beyond every real one exactly; from there least
        squares does not find the way back.
        """
        view = self.view.view
        focal_px = typical_focal_px(view.corner_px)
        row = view.observation.row_from_pose(start.camera_from_board)
        row[TRANSLATION + 2] *= focal_px / start.camera.focal_px
        camera = DivisionCamera(focal_px, start.camera.center_px)
        return Solution(camera, view.observation.pose_from_row(row))

    def _problem(self, focal_px: float) -> FullProblem:
        view, options = self.view.view, self.view.options
        corner_px = view.corner_px
        mean, sigma = np.zeros(LENS_SIZE), np.ones(LENS_SIZE)
        mean[LOG_FOCAL] = math.log(typical_focal_px(corner_px))
        sigma[LOG_FOCAL] = options.focal_spread
        if options.prior_focal_px is not None and options.prior_focal_sigma_px is not None:
            mean[LOG_FOCAL] = math.log(options.prior_focal_px)
            sigma[LOG_FOCAL] = options.prior_focal_sigma_px / options.prior_focal_px
            focal_px = options.prior_focal_px
        center_known = self.center_known or options.center_spread == 0.0
        if not center_known:
            sigma[CX] = sigma[CY] = options.center_spread * 2.0 * corner_px
        usual = options.lens_spread or 1.0
        information = np.diag(sigma**-2.0)
        if options.prior_k_sigma is not None:
            usual = 0.0
            self._add_prior_on_k(focal_px, mean, information)
        sizes = _sizes_of(options)
        sizes[SHEAR] = 0.0  # which would cost an unknown camera half of its accuracy
        active = np.ones(PARAMETERS, dtype=bool)
        active[POSE_COLUMNS + CX : POSE_COLUMNS + CY + 1] = not center_known
        active[POSE_COLUMNS + BEND + 1 : POSE_COLUMNS + LENS_SIZE] = options.lens_spread > 0.0
        active[POSE_COLUMNS + LENS_SIZE :] = sizes > 0.0
        return FullProblem(
            view.image,
            view.board,
            corner_px,
            mean,
            information,
            usual,
            sizes,
            np.flatnonzero(active),
        )

    def _add_prior_on_k(self, focal_px: float, mean: Array, information: Array) -> None:
        """Add the caller's prior on k = b₁ (f/R)², linear about a focal length, in place."""
        options, unit = self.view.options, (focal_px / self.view.view.corner_px) ** 2
        sigma = options.prior_k_sigma
        assert sigma is not None
        # dk = unit db₁ + 2 k d(log f); the mean has the given k at its own focal length.
        by = np.zeros(LENS_SIZE)
        by[LOG_FOCAL], by[BEND] = 2.0 * options.prior_k, unit
        information[BEND:, BEND:] = np.diag([0.0, 0.1**-2, 0.02**-2])
        information += np.outer(by, by) / sigma**2
        mean[BEND] = options.prior_k * (1.0 + 2.0 * (math.log(focal_px) - mean[LOG_FOCAL])) / unit

    def _fit(self, start: Solution, problem: FullProblem) -> _Fit | None:
        """Fit from a start; return None if the camera is outside the limits."""
        view, options = self.view.view, self.view.options
        state, lens = np.empty(STATE_SIZE), lens_from_camera(start.camera, view.center_px)
        row = view.observation.row_from_pose(start.camera_from_board)
        state_from(row, lens, problem.corner_px, state)
        work = full_work(len(view.image))
        exact = len(view.image) == 4
        sigma_px = options.sigma_px or (DEFAULT_SIGMA_PX if exact else 0.0)
        limit = math.inf if exact else options.threshold_px**2
        found = fit_full(state, problem, limit, sigma_px, _SMALLEST_VARIANCE, work)
        if self.view.camera is not None:
            found = widen_deviations(state, problem, limit, sigma_px, found, work)
        lens_of(state, problem.corner_px, lens)
        fit = _Fit(state, work, lens, *found)
        known = self.view.camera is not None
        return fit if known or self._plausible(fit, problem) else None

    def _plausible(self, fit: _Fit, problem: FullProblem) -> bool:
        """
        Return whether the camera is within the limits.

        The corners of a fisheye's image are dark, and its polynomial there is an extrapolation:
        the largest field of view and distortion are judged at the farthest point that was seen.
        """
        options = self.view.options
        seen_px = math.sqrt(np.max(np.sum((self.view.view.image - fit.lens[1:3]) ** 2, axis=1)))
        if not np.isfinite(fit.state).all():
            return False
        at_corner_deg, _ = _half_field(fit.lens, problem.corner_px)
        seen_deg, bend = _half_field(fit.lens, seen_px)
        return (
            2.0 * at_corner_deg >= options.min_fov_deg
            and 2.0 * seen_deg <= options.max_fov_deg
            and abs(bend) <= options.max_distortion
        )

    def _cost(self, fit: _Fit, variance: float) -> float:
        limit = self.view.options.threshold_px**2
        return float(np.minimum(fit.work.squares, limit).sum() / variance + fit.prior_chi2)

    def _different(self, best: _Fit, others: Sequence[_Fit]) -> list[_Fit]:
        """Return the fits that differ from the best one and from each other."""
        kept = [best]
        for fit in others:
            apart = (np.linalg.norm(fit.state[:9] - other.state[:9]) for other in kept)
            # |A - B| = √8 sin(angle / 2)
            if min(apart) > math.sqrt(2.0) * _SAME_RAD:
                kept.append(fit)
        return kept[1:]

    def _result(
        self, fit: _Fit, others: list[_Fit], problem: FullProblem, estimate: PoseEstimate
    ) -> PoseEstimate:
        view = self.view.view
        covariance = np.empty((COVARIANCE_SIZE, COVARIANCE_SIZE))
        scale = view.observation.board_scale
        public_covariance(fit.state, problem, scale, fit.work, covariance)
        inliers = fit.work.squares < self.view.options.threshold_px**2
        observable = self._observability(fit, problem, covariance)
        status = estimate.status
        if status is not Status.FOUR_POINTS and observable.undetermined:
            status = Status.UNDETERMINED
        elif status is Status.UNDETERMINED:
            status = Status.CONFIDENT
        return PoseEstimate(
            model=self._solution(fit),
            status=status,
            inliers=inliers,
            rms_px=math.sqrt(fit.work.squares[inliers].mean()) if inliers.any() else math.nan,
            iterations=estimate.iterations,
            covariance=mark_undetermined(covariance, observable),
            alternatives=tuple(self._solution(other) for other in others),
            observable=observable,
        )

    def _observability(self, fit: _Fit, problem: FullProblem, covariance: Array) -> Observability:
        view = self.view.view
        translation = view.observation.translation_from_row(fit.state)
        focal_px = float(fit.lens[0])
        observable = observability_of(focal_px, translation, covariance, problem.corner_px)
        if problem.usual > 0.0 and observable.distortion:
            # A sigma that is hardly smaller than the prior's is not from the view.
            at = int(np.flatnonzero(problem.active == POSE_COLUMNS + BEND)[0])
            share_of_prior = fit.work.covariance[at, at] * problem.information[BEND, BEND]
            observable = replace(observable, distortion=bool(share_of_prior < _FROM_THE_VIEW))
        share = math.sqrt(max(covariance[COV_FOCAL, COV_FOCAL], 0.0)) / focal_px
        if self.view.camera is not None or share < _CERTAIN or not observable.focal:
            return observable
        limit = self.view.options.threshold_px**2
        for factor in _FOCAL_FACTORS:
            excess = other_focal_excess(
                fit.state, problem, factor, fit.variance, limit, _HELD_STEPS, fit.work
            )
            if excess < MAX_RATIO:
                return replace(observable, distance=False, focal=False)
        return observable

    def _solution(self, fit: _Fit) -> Solution:
        camera = self.view.camera
        if camera is None:
            camera = camera_from_lens(fit.lens, self.view.view.center_px)
        return Solution(camera, self.view.view.observation.pose_from_row(fit.state[:12]))


def known_lens_problem(
    view: CenteredView, lens: Array, covariance: Array, options: EstimateOptions
) -> FullProblem:
    """
    Return the problem of a view with a lens (6,) of known covariance (6, 6).

    The lens is relative to the view's centre. Terms of zero variance keep their values.
    """
    corner_px = view.corner_px
    state = np.empty(STATE_SIZE)
    state_from(np.zeros(POSE_SIZE), lens, corner_px, state)
    # θ = (log f, c, bᵢ = kᵢ (R/f)²ⁱ):  d(log f) = df / f,  dbᵢ = (R/f)²ⁱ dkᵢ - 2i bᵢ df / f.
    jacobian = np.eye(LENS_SIZE)
    jacobian[LOG_FOCAL, FOCAL] = 1.0 / lens[FOCAL]
    mean = state[POSE_SIZE : POSE_SIZE + LENS_SIZE]
    for i in range(3):
        jacobian[BEND + i, K + i] = (corner_px / lens[FOCAL]) ** (2 * i + 2)
        jacobian[BEND + i, FOCAL] = -(2 * i + 2) * mean[BEND + i] / lens[FOCAL]
    free = np.diag(covariance) > 0.0
    information = np.zeros((LENS_SIZE, LENS_SIZE))
    if free.any():
        transformed = (jacobian @ covariance @ jacobian.T)[np.ix_(free, free)]
        information[np.ix_(free, free)] = inverse_of_information(transformed)
    sizes = _sizes_of(options)
    active = np.concatenate([np.ones(POSE_COLUMNS, dtype=bool), free, sizes > 0.0])
    return FullProblem(
        view.image,
        view.board,
        corner_px,
        mean.copy(),
        information,
        0.0,
        sizes,
        np.flatnonzero(active),
    )


def _sizes_of(options: EstimateOptions) -> Array:
    sizes = np.zeros(DEVIATIONS)
    sizes[ASPECT], sizes[SHEAR] = options.aspect_spread, options.image_shear
    sizes[STRETCH : STRETCH + 2] = options.board_stretch
    sizes[BOW_XX:] = options.board_bow
    return sizes


def widen_deviations(
    state: Array,
    problem: FullProblem,
    limit: float,
    sigma_px: float,
    found: tuple[float, float, float, int, float],
    work: FullWork,
) -> tuple[float, float, float, int, float]:
    """
    Fit again with larger deviations, in place, while the fit asks for more than it was allowed.

    A view that deviates more than usual (a bent print, a faster motion) then has the covariance
    that its own misfit asks for.
    """
    active = problem.sizes > 0.0
    for _ in range(_WIDENINGS):
        multiples = state[STATE_SIZE - DEVIATIONS :]
        excess = float(np.mean(multiples[active] ** 2)) if active.any() else 0.0
        if not excess > 1.0:
            break
        problem.sizes[:] *= math.sqrt(excess)
        multiples /= math.sqrt(excess)
        found = fit_full(state, problem, limit, sigma_px, found[1], work)
    return found


def _half_field(lens: Array, radius_px: float) -> tuple[float, float]:
    """Return angle to the axis, degrees, and bend of the ray at a distance from the centre."""
    q = (radius_px / lens[FOCAL]) ** 2
    bend = q * (lens[K] + q * (lens[K2] + q * lens[K3]))
    return math.degrees(math.atan2(math.sqrt(q), 1.0 + bend)), bend
