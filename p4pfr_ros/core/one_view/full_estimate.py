# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""
One view described by the full fit of ``full_fit``, its camera unknown or known.

``FullViewProblem`` takes the place of ``ViewProblem`` where the options allow deviations: the rows
of the search and their alternatives are the starts of full fits.

This module stands alone because `estimate_pose` is complete without it.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
import math
from typing import NamedTuple

import numpy as np

from .ambiguity import same_optimum
from .describe import assessment, MAX_RATIO, shows_back, ViewProblem
from .focal_likelihood import other_focal_excess
from .full_fit import fit_view, FullFit, Rules
from .full_model import FullProblem, STATE_SIZE
from .full_prior import known_prior, lens_of_camera, usual_prior, with_free_aspect, with_prior_on_k
from .least_squares import Problem
from .results import (
    CameraFit,
    FocalLimits,
    mark_undetermined,
    MAX_FOCAL_SHARE,
    no_estimate,
    Observability,
    observability_of,
    PoseEstimate,
    Status,
    widen_focal,
)
from ..geometry import Array, Pose, POSE_SIZE, TRANSLATION
from ..minimal.solution import G, H, Solution
from ..model.lens import (
    camera_from_lens,
    FOCAL,
    K,
    LENS_SIZE,
)
from ..model.prior import typical_focal_px
from ..model.uncertainty import COV_FOCAL, COV_K, COVARIANCE_SIZE, DEFAULT_SIGMA_PX, sigma_at

# With fewer points the residuals do not measure the noise.
_FEWEST_TO_MEASURE = 5

# Steps of a row that is only to be the start of a full fit.
_FEW_STEPS = 3

# A focal length with a smaller relative standard deviation needs no likelihood test, and the view
# has no other optimum (in 3,000 drawn views those had 10 % or more).
_CERTAIN, _CERTAIN_OF_FOUR = 0.07, 0.03
# Where half the focal length raises chi-square by more, so does its double (more than four points;
# in 600 drawn views of which the double fitted 23, half did so too, or raised it by less than 20).
_CLEARLY_WORSE = 40.0

# A lens farther from the prior is none that exists: the squared distance, in variances.
_LARGEST_LENS_CHI2 = 25.0

# A variance above this share of the prior's is the prior's, not the view's.
_FROM_THE_VIEW = 0.5

# Optima with rotations closer than this, rad, are the same.
_SAME_RAD = 0.02

# Points that contradict the prior on the aspect ratio by this χ² may be of an image that was
# scaled, or all priors together by the second, since other deviations may hide it; and -2 log of
# the share of such cameras.
_NOT_SQUARE, _UNUSUAL = 4.0, 8.0
_FREE_ASPECT_CHI2 = 9.2

# Beyond this difference of logarithms a focal length is tried with a typical one instead, too.
_FAR_FROM_TYPICAL = 1.5


@dataclass(frozen=True, slots=True, eq=False)
class ViewFit:
    """
    A full fit: state (28,), lens (10,), squared errors (N,), covariance (8, 8), and numbers.

    given: its priors; penalty: χ² that is added in comparisons, as such cameras are rare.
    """

    given: FullProblem
    state: Array
    lens: Array
    squares: Array
    covariance: Array
    numbers: FullFit
    penalty: float

    def chi2(self, variance: float, limit: float) -> float:
        """Return χ² of residuals and priors; squared errors are truncated at a limit, px²."""
        return float(np.minimum(self.squares, limit).sum()) / variance + self.numbers.prior_chi2


class Rival(NamedTuple):
    """The fit of a view with a camera that is not the known one, and how probable it is."""

    fit: ViewFit
    probability: float


@dataclass(frozen=True, slots=True)
class FullViewProblem(ViewProblem):
    """
    A view whose camera and board may deviate as the options allow.

    center_known: whether the principal point is given.
    lens_prior: mean (10,) and covariance (10, 10) of a known camera's lens; None: it is exact.
    noise_px: standard deviation of a coordinate, where the points are too few to measure it.
    """

    center_known: bool = False
    lens_prior: tuple[Array, Array] | None = None
    noise_px: float = DEFAULT_SIGMA_PX

    def describe(
        self, row: Array, problem: Problem, others: Array | None, status: Status, iterations: int
    ) -> PoseEstimate:
        """Return the result of the full fits that start from a row and its alternatives."""
        n, given = len(self.view.image), self._given(row)
        if others is None and self.camera is None and n > 4:
            return self._result(self._fits_of_search(row, problem, given), status, iterations)
        arrays = assessment(n)
        summary = self._assess(row, problem, others is None, arrays, _FEW_STEPS)
        if others is None:
            others = arrays.others[: summary.others]
        fits = self._fits([row, *others], given)
        camera_fit = None if self.camera is None else CameraFit(*summary.stretch)
        return self._result(fits, status, iterations, camera_fit)

    def _fits_of_search(self, row: Array, problem: Problem, given: FullProblem) -> list[ViewFit]:
        """Return the fit from a row and, if it leaves room for other optima, fits from those."""
        fits = self._fits([row], given)
        if fits and _focal_share(fits[0]) < _CERTAIN:
            return fits
        fitted, arrays = row.copy(), assessment(len(self.view.image))
        summary = self._assess(row, problem, True, arrays, _FEW_STEPS)
        # The row may have been swapped with a better one.
        found = (row, *arrays.others[: summary.others])
        return fits + self._fits([one for one in found if not same_optimum(one, fitted)], given)

    def estimate_from(
        self, rows: Sequence[Array], status: Status, iterations: int, rival: Rival | None = None
    ) -> PoseEstimate:
        """Return the result of the full fits that start from rows (≥ 14,), at least one."""
        fits = self._fits(rows, self._given(rows[0]))
        return self._result(fits, status, iterations, rival=rival)

    def _fits(self, rows: Iterable[Array], given: FullProblem) -> list[ViewFit]:
        """
        Return the full fits that start from rows.

        Where the points of an unknown camera contradict square pixels, its aspect ratio is free in
        another fit. Few cameras have such pixels, so that fit must explain the view much better.
        """
        fits = [self._fit(start, given) for start in self._starts(rows)]
        if self.camera is not None or not any(_asks_for_aspect(fit.numbers) for fit in fits):
            return fits
        free = given._replace(information=with_free_aspect(given.information))
        starts = [np.concatenate([fit.state[:POSE_SIZE], fit.lens]) for fit in fits]
        return fits + [self._fit(start, free, penalty=_FREE_ASPECT_CHI2) for start in starts]

    def _result(
        self,
        fits: list[ViewFit],
        status: Status,
        iterations: int,
        camera_fit: CameraFit | None = None,
        rival: Rival | None = None,
    ) -> PoseEstimate:
        """Return the result of the best of the fits that are possible."""
        n, options = len(self.view.image), self.options
        fits, cause = self._possible(fits)
        if not fits:
            return no_estimate(cause, n, iterations)
        ranked = self._ranked(fits)
        best, others = ranked[0][1], [fit for _, fit in ranked[1:]]
        model = self._model(best)
        if rival:
            self._include(best, rival.fit, rival.probability)
        observable = self._observable(best, model.camera_from_board)
        if others:
            self._include_alternatives(ranked)
        # Another aspect ratio is no other pose: it counts in the covariance alone.
        others = [other for other in others if other.penalty == best.penalty]
        return PoseEstimate(
            model=model,
            status=_status(status, observable),
            inliers=best.squares < options.threshold_px**2,
            rms_px=math.sqrt(best.numbers.total / best.numbers.inliers),
            iterations=iterations,
            covariance=mark_undetermined(best.covariance, observable),
            alternatives=tuple(self._model(other) for other in others),
            observable=observable,
            camera_fit=camera_fit,
            focal_limits=None if self.camera else _limits_of(best.numbers),
        )

    def _possible(self, fits: list[ViewFit]) -> tuple[list[ViewFit], Status]:
        """Return the fits that are possible, and why there is none."""
        cause = Status.NO_SOLUTION
        if self.camera is None:
            fits = [fit for fit in fits if self._plausible(fit)]
        if any(fit.numbers.inliers < len(self.view.image) for fit in fits):
            cause = Status.NO_CONSENSUS
            fits = [fit for fit in fits if fit.numbers.inliers >= self.fewest_inliers]
        if fits and not self.options.two_sided:
            cause = Status.SEEN_FROM_BEHIND
            fits = [fit for fit in fits if not shows_back(fit.state)]
        return fits, cause

    def best_fit(self, rows: Sequence[Array]) -> ViewFit:
        """Return the best of the full fits that start from rows, deviations of usual size."""
        given = self._given(rows[0])
        fits = [self._fit(start, given, widens=False) for start in self._starts(rows)]
        return self._ranked(fits)[0][1]

    def _starts(self, rows: Iterable[Array]) -> list[Array]:
        """Return the starts (22,) of rows: pose and lens."""
        starts = []
        for row in rows:
            start = np.zeros(POSE_SIZE + LENS_SIZE)
            start[:POSE_SIZE] = row[:POSE_SIZE]
            starts.append(start)
            if self.camera is not None:
                start[POSE_SIZE:] = lens_of_camera(self.camera)
                continue
            start[POSE_SIZE + FOCAL], start[POSE_SIZE + K] = row[G], row[G] * row[H]
            typical_px = typical_focal_px(self.view.corner_px)
            if abs(math.log(row[G] / typical_px)) > _FAR_FROM_TYPICAL:
                # A few points may fit a focal length far beyond every real one exactly; least
                # squares does not find the way back. The size in the image stays the same.
                other = start.copy()
                other[TRANSLATION + 2] *= typical_px / row[G]
                other[POSE_SIZE + FOCAL], other[POSE_SIZE + K] = typical_px, 0.0
                starts.append(other)
        return starts

    def _fit(
        self, start: Array, given: FullProblem, *, widens: bool = True, penalty: float = 0.0
    ) -> ViewFit:
        view, options = self.view, self.options
        n = len(view.image)
        state, lens, squares = np.empty(STATE_SIZE), np.empty(LENS_SIZE), np.empty(n)
        covariance = np.empty((COVARIANCE_SIZE, COVARIANCE_SIZE))
        exact = n == 4
        rules = Rules(
            math.inf if exact else options.threshold_px**2,
            options.sigma_px or (self.noise_px if n < _FEWEST_TO_MEASURE else 0.0),
            widens and self.camera is not None and not exact,
            options.threshold_px**2,
        )
        scale = view.observation.board_scale
        numbers = fit_view(start, given, rules, scale, state, lens, squares, covariance)
        return ViewFit(given, state, lens, squares, covariance, numbers, penalty)

    def _plausible(self, fit: ViewFit) -> bool:
        """
        Return whether the camera is within the limits.

        The corners of a fisheye's image are dark, and its polynomial there is an extrapolation:
        the largest field of view and distortion are judged at the farthest point that was seen.
        """
        options, numbers = self.options, fit.numbers
        return (
            # Written so that NaN is not plausible.
            numbers.lens_chi2 < _LARGEST_LENS_CHI2
            and math.isfinite(float(fit.lens.sum()))
            and 2.0 * math.degrees(numbers.corner_rad) >= options.min_fov_deg
            and 2.0 * math.degrees(numbers.seen_rad) <= options.max_fov_deg
            and abs(numbers.seen_bend) <= options.max_distortion
        )

    def _ranked(self, fits: list[ViewFit]) -> list[tuple[float, ViewFit]]:
        """
        Return the best fit, and others that explain the view as well and differ from each other.

        Each with the chi-square by which it is worse than the best.
        """
        if len(fits) == 1:
            return [(0.0, fits[0])]
        variance = min(fit.numbers.variance for fit in fits)
        limit = self.options.threshold_px**2
        costs = [fit.chi2(variance, limit) + fit.penalty for fit in fits]
        order = sorted(range(len(fits)), key=costs.__getitem__)
        excess = [(costs[i] - costs[order[0]], fits[i]) for i in order]
        return _different([one for one in excess if one[0] < MAX_RATIO])

    def _include_alternatives(self, ranked: Sequence[tuple[float, ViewFit]]) -> None:
        """
        Widen the best fit's covariance by the alternatives, as probable as they are, in place.

        With the probability pᵢ of an alternative that is off by dᵢ, the second moment about the
        best fit is  C + Σ pᵢ dᵢ dᵢᵀ.
        """
        weights = np.array([math.exp(-0.5 * excess) for excess, _ in ranked])
        for (_, fit), weight in zip(ranked[1:], weights[1:], strict=True):
            self._include(ranked[0][1], fit, weight / weights.sum())

    def _include(self, best: ViewFit, other: ViewFit, probability: float) -> None:
        """Widen the covariance of the best fit by another fit, in place."""
        pose, other_pose = (
            self.view.observation.pose_from_row(fit.state[:POSE_SIZE]) for fit in (best, other)
        )
        turn = Pose.unchecked(other_pose.rotation @ pose.rotation.T, np.zeros(3)).rotation_vector
        off = np.concatenate([other_pose.translation - pose.translation, turn, np.zeros(2)])
        off[COV_FOCAL] = other.lens[FOCAL] - best.lens[FOCAL]
        off[COV_K] = other.lens[K] - best.lens[K]
        best.covariance[:] += probability * np.outer(off, off)

    def _observable(self, fit: ViewFit, pose: Pose) -> Observability:
        """Return what the view determines; widen the covariance by the likelihood of f."""
        given, focal_px, covariance = fit.given, float(fit.lens[FOCAL]), fit.covariance
        found = observability_of(focal_px, pose.translation, covariance, given.corner_px)
        if self.camera is not None:
            return found
        # A sigma that is hardly smaller than the prior's is not from the view.
        hardly = given.usual > 0.0 and fit.numbers.bend_share >= _FROM_THE_VIEW
        distortion = found.distortion and not hardly
        share = self._likely_focal_share(fit) if found.focal else math.inf
        if share > MAX_FOCAL_SHARE:
            return Observability(found.direction, False, False, distortion)
        widen_focal(covariance, focal_px, share)
        return Observability(found.direction, found.distance, True, distortion)

    def _likely_focal_share(self, fit: ViewFit) -> float:
        """
        Return the relative standard deviation of the focal length, from its likelihood too.

        Near fronto-parallel views the covariance misleads: the estimate rests on a tilt that is
        noise, and at that tilt the focal length seems determined.
        """
        share = _focal_share(fit)
        four = len(fit.squares) == 4
        if share < (_CERTAIN_OF_FOUR if four else _CERTAIN):
            return share
        limit, variance = self.options.threshold_px**2, fit.numbers.variance
        log_factor = math.log(2.0)
        not_observable = (log_factor / MAX_FOCAL_SHARE) ** 2
        for factor in (0.5, 2.0):
            excess = other_focal_excess(
                fit.state, fit.given, factor, variance, limit, not_observable
            )
            # A normal log f that is off by ln 2 has the chi-square (ln 2 / share)².
            share = max(share, log_factor / math.sqrt(max(excess, 1e-6)))
            if share > MAX_FOCAL_SHARE or (not four and excess > _CLEARLY_WORSE):
                break
        return share

    def _model(self, fit: ViewFit) -> Solution:
        camera = self.camera or camera_from_lens(fit.lens, self.view.center_px)
        return Solution(camera, self.view.observation.pose_from_row(fit.state[:POSE_SIZE]))

    def _given(self, row: Array) -> FullProblem:
        """Return the problem of the view, its priors about a row's camera."""
        view, options = self.view, self.options
        if self.camera is not None:
            lens, covariance = self.lens_prior or (lens_of_camera(self.camera), None)
            prior = known_prior(options, lens, view.corner_px, covariance)
        else:
            prior = usual_prior(options, view.corner_px, self.center_known)
            if options.prior_k_sigma is not None:
                focal_px = options.prior_focal_px or float(row[G])
                prior = with_prior_on_k(prior, options, focal_px, view.corner_px)
        board = np.empty((len(view.board), 3))
        board[:, :2], board[:, 2] = view.board, view.heights
        return FullProblem(view.image, board, view.corner_px, *prior)


def _different(ranked: Sequence[tuple[float, ViewFit]]) -> list[tuple[float, ViewFit]]:
    """Return the fits that differ from those before them."""
    kept = [ranked[0]]
    for excess, fit in ranked[1:]:
        if not any(fit.penalty == other.penalty and _same_pose(fit, other) for _, other in kept):
            kept.append((excess, fit))
    return kept


def _same_pose(fit: ViewFit, other: ViewFit) -> bool:
    """Return whether the rotations of two fits are the same."""
    # |A - B| = √8 sin(angle / 2)
    apart = float(np.linalg.norm(fit.state[:9] - other.state[:9]))
    return apart <= math.sqrt(2.0) * _SAME_RAD


def _asks_for_aspect(numbers: FullFit) -> bool:
    """Return whether a fit with another aspect ratio may explain the view much better."""
    return numbers.aspect_chi2 > _NOT_SQUARE or numbers.prior_chi2 > _UNUSUAL


def _focal_share(fit: ViewFit) -> float:
    """Return the relative standard deviation of the focal length."""
    return sigma_at(fit.covariance, COV_FOCAL) / float(fit.lens[FOCAL])


def _limits_of(numbers: FullFit) -> FocalLimits:
    return FocalLimits(numbers.focal_by_center, numbers.focal_by_lens, numbers.focal_by_others)


def _status(status: Status, observable: Observability) -> Status:
    if status is Status.FOUR_POINTS or not observable.undetermined:
        return status
    return Status.UNDETERMINED
