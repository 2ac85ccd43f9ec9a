# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""
From the best row of a search to a ``PoseEstimate``: refinement, noise, covariance, alternatives.

``ViewProblem`` holds one call of ``estimate_pose``. The compiled ``assess`` refines a row and
fills the arrays of its result. Quantities that the view does not determine get a typical camera's
prior, and are reported as not observable.

This module stands alone because it is the second half of an estimate: ``estimate_pose`` finds a
row, this module makes its result.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
import math
from typing import NamedTuple

import numpy as np

from .ambiguity import another_focal_fits, MAX_OTHERS, other_optima
from .camera_fit import stretch_of, stretched_equations
from .free_camera import Gates, Prior, prior_cost
from .least_squares import (
    covariance_from,
    free_problem,
    hypotheses,
    known_problem,
    least_squares_work,
    minimise,
    normal_equations,
    plausible,
    POSE,
    Problem,
    squared_errors,
    truncated_cost,
)
from .ransac import fewest_inliers, ransac_work, RansacWork
from .results import (
    CameraFit,
    EstimateOptions,
    mark_undetermined,
    no_estimate,
    Observability,
    observability_of,
    PoseEstimate,
    Status,
)
from ..cameras.division import DivisionCamera
from ..geometry import Array
from ..jit import jit
from ..linalg import copy_row
from ..minimal.one import workspace
from ..minimal.solution import G, H, ROW_SIZE, Solution
from ..model.observation import CenteredView
from ..model.prior import BEND_SIGMA, FOCAL_SIGMA, typical_focal_px
from ..model.uncertainty import (
    COV_FOCAL,
    DEFAULT_SIGMA_PX,
    largest_excess,
    noise_variance,
    posterior_variance,
)

# Largest atypicality of a typical camera: two standard deviations, squared.
_TYPICAL = 4.0

# A focal length with a smaller relative standard deviation needs no likelihood test.
_CERTAIN = 0.03

# Twice the log of the likelihood ratio beyond which the worse optimum is rejected: 1 in 100.
MAX_RATIO = 9.21

STEPS = 100
_TOLERANCE = 1e-13

# Another optimum is better only if its cost is lower by more than rounding.
_BETTER = 1.0 - 1e-9


@dataclass(frozen=True, slots=True)
class ViewProblem:
    """One view, its camera if that is known, and the options of its estimation."""

    view: CenteredView
    camera: DivisionCamera | None
    options: EstimateOptions

    @property
    def sigma_px(self) -> float:
        """The given or default standard deviation of a coordinate, px."""
        return self.options.sigma_px or DEFAULT_SIGMA_PX

    @property
    def has_focal_prior(self) -> bool:
        """Whether the camera is unknown and the caller gave a prior on its focal length."""
        return self.camera is None and self.options.prior_focal_px is not None

    @property
    def fewest_inliers(self) -> int:
        """The smallest number of inliers that is accepted; exactly four points must all be."""
        options, image = self.options, self.view.image
        at_least = max(options.min_inliers, math.ceil(options.min_inlier_ratio * len(image)))
        # An image is no larger than the square whose diagonal reaches twice to its corner.
        max_area = 2.0 * self.view.corner_px**2
        return fewest_inliers(image, options.threshold_px, max_area, at_least)

    def problem(
        self,
        variance: float | None = None,
        *,
        typical_focal: bool = False,
        typical_k: bool = False,
    ) -> Problem:
        """
        Make the least-squares problem, its priors weighted by the noise variance, px².

        typical_focal, typical_k: use the typical camera's prior unless the caller gave one.
        """
        view, options = self.view, self.options
        gates = Gates(
            view.corner_px,
            math.radians(options.min_fov_deg) / 2.0,
            math.radians(options.max_fov_deg) / 2.0,
            options.max_distortion,
        )
        if self.camera is not None:
            return known_problem(view.image, view.board, gates, self.camera)
        prior = self._prior(variance or self.sigma_px**2, typical_focal, typical_k)
        return free_problem(view.image, view.board, gates, prior)

    def _prior(self, variance: float, typical_focal: bool, typical_k: bool) -> Prior:
        options = self.options
        focal_px, focal_sigma_px = options.prior_focal_px, options.prior_focal_sigma_px
        k, k_sigma = options.prior_k, options.prior_k_sigma
        typical_px = typical_focal_px(self.view.corner_px)
        if focal_px is None and typical_focal:
            focal_px, focal_sigma_px = typical_px, FOCAL_SIGMA * typical_px
        if k_sigma is None and typical_k:
            k_sigma = BEND_SIGMA * ((focal_px or typical_px) / self.view.corner_px) ** 2
        return Prior(
            focal_px or 0.0,
            variance / focal_sigma_px**2 if focal_sigma_px else 0.0,
            k,
            variance / k_sigma**2 if k_sigma else 0.0,
        )

    def atypicality(self, row: Array) -> float:
        """Return the squared deviation of a row's camera from a typical one, in variances."""
        corner_px = self.view.corner_px
        by_focal = math.log2(row[G] / typical_focal_px(corner_px))
        by_bend = row[H] * corner_px**2 / row[G] / BEND_SIGMA
        return float(by_focal**2 + by_bend**2)

    def describe(
        self, row: Array, problem: Problem, others: Array | None, status: Status, iterations: int
    ) -> PoseEstimate:
        """
        Refine a row in place, and return its result.

        problem: with the caller's priors only. others: the alternatives (n, ROW_SIZE); None: they
        are searched.
        """
        n = len(self.view.image)
        arrays = assessment(n)
        search_others = others is None
        start = row.copy()
        summary = self._assess(row, problem, search_others, arrays)
        if self.options.sigma_px is None and self._has_priors:
            # The priors were weighted by the default noise: now by the measured one.
            summary = self._assess(row, self.problem(summary.variance), search_others, arrays)
        observable = self._observability(row, summary, arrays)
        if not (observable.distortion and observable.focal):
            row[:] = start
            summary, observable = self._complete(row, observable, summary, search_others, arrays)
        if summary.inliers < n and summary.inliers < self.fewest_inliers:
            return no_estimate(Status.NO_CONSENSUS, n, iterations)
        if others is None:
            others = arrays.others[: summary.others]
        return PoseEstimate(
            model=self._solution(row),
            status=_final_status(status, observable),
            inliers=arrays.squares < self.options.threshold_px**2,
            rms_px=math.sqrt(summary.total / summary.inliers),
            iterations=iterations,
            covariance=mark_undetermined(arrays.covariance, observable),
            alternatives=tuple(self._solution(other) for other in others),
            observable=observable,
            camera_fit=None if self.camera is None else CameraFit(*summary.stretch),
        )

    def _complete(
        self,
        row: Array,
        observable: Observability,
        summary: Summary,
        search_others: bool,
        arrays: Assessment,
    ) -> tuple[Summary, Observability]:
        """
        Assess a row again, with a typical camera's priors on the quantities not determined.

        Those stay not observable. Others, which hardly vary over all typical cameras, become
        observable: the direction of a fronto-parallel board, for example.
        """
        variance = summary.variance
        # An exact solution of four points, one of several, stays exact if its camera is typical.
        steps = 0 if not search_others and self.atypicality(row) < _TYPICAL else STEPS
        if not observable.distortion:
            problem = self.problem(variance, typical_k=True)
            summary = self._assess(row, problem, search_others, arrays, steps)
            observable = replace(self._observability(row, summary, arrays), distortion=False)
        if not observable.focal:
            typical_k = not observable.distortion
            problem = self.problem(variance, typical_k=typical_k, typical_focal=True)
            summary = self._assess(row, problem, search_others, arrays, steps)
            before, observable = observable, self._observability(row, summary, arrays)
            distortion = before.distortion and observable.distortion
            observable = replace(observable, distance=False, focal=False, distortion=distortion)
        return summary, observable

    @property
    def _has_priors(self) -> bool:
        return self.has_focal_prior or (
            self.camera is None and self.options.prior_k_sigma is not None
        )

    def _assess(
        self,
        row: Array,
        problem: Problem,
        search_others: bool,
        arrays: Assessment,
        steps: int = STEPS,
    ) -> Summary:
        limit, sigma_px = self.options.threshold_px**2, self.options.sigma_px or 0.0
        scale = self.view.observation.board_scale
        return Summary(*assess(row, problem, limit, sigma_px, scale, search_others, steps, arrays))

    def _observability(self, row: Array, summary: Summary, arrays: Assessment) -> Observability:
        translation = self.view.observation.translation_from_row(row)
        observable = observability_of(
            float(row[G]), translation, arrays.covariance, self.view.corner_px
        )
        share = math.sqrt(arrays.covariance[COV_FOCAL, COV_FOCAL]) / row[G]
        certain = self.camera is not None or share < _CERTAIN
        if certain or not observable.focal or len(self.view.image) == 4:
            return observable
        # The standard deviation may mislead: test the likelihood, with the caller's priors only.
        limit = self.options.threshold_px**2
        problem = self.problem(summary.variance)
        if another_focal_fits(row, problem, limit, MAX_RATIO * summary.variance):
            return replace(observable, focal=False, distance=False)
        return observable

    def _solution(self, row: Array) -> Solution:
        camera = self.camera
        if camera is None:
            g, h = row[G:].tolist()
            camera = DivisionCamera.unchecked(g, self.view.center_px, h * g)
        return Solution(camera, self.view.observation.pose_from_row(row))


class FoundPoses(NamedTuple):
    """Poses (≥ 12,) of the scaled board that explain a view, the best first; none: see status."""

    rows: list[Array]
    status: Status
    iterations: int

    @property
    def model(self) -> Array | None:
        """The best pose; None if there is none."""
        return self.rows[0] if self.rows else None


@dataclass(frozen=True, slots=True)
class PoseSearch(ViewProblem):
    """A view whose poses alone are wanted, not described: `describe` returns `FoundPoses`."""

    def describe(  # type: ignore[override]
        self, row: Array, problem: Problem, others: Array | None, status: Status, iterations: int
    ) -> FoundPoses:
        """Refine a row in place; return it and the alternatives."""
        arrays = assessment(len(self.view.image))
        summary = self._assess(row, problem, others is None, arrays)
        if summary.inliers < self.fewest_inliers:
            return FoundPoses([], Status.NO_CONSENSUS, iterations)
        found = [row, *(arrays.others[: summary.others] if others is None else others)]
        if not self.options.two_sided:
            found = [each for each in found if not shows_back(each)]
        return FoundPoses(found, status if found else Status.SEEN_FROM_BEHIND, iterations)


def _final_status(status: Status, observable: Observability) -> Status:
    if status is Status.FOUR_POINTS or not observable.undetermined:
        return status
    return Status.UNDETERMINED


def shows_back(row: Array) -> bool:
    """Return whether a pose (≥ 12,) of the scaled board shows the camera the board's back."""
    xz, yz, zz, x, y, z = row[[2, 5, 8, 9, 10, 11]].tolist()
    return bool(xz * x + yz * y + zz * z > 0.0)


class Assessment(NamedTuple):
    """
    Arrays of a result, filled in place.

    squares (N,) px² and covariance (8, 8) of the model; others (MAX_OTHERS, ROW_SIZE) and their
    costs (MAX_OTHERS,) px².
    """

    squares: Array
    covariance: Array
    others: Array
    costs: Array


class Summary(NamedTuple):
    """
    Number of inliers, their squared errors' sum, noise variance (px²), number of others.

    stretch: of the board with a known camera, see `stretch_of`.
    """

    inliers: int
    total: float
    variance: float
    others: int
    stretch: tuple[float, float]


def assessment(n: int) -> Assessment:
    """Allocate the arrays for a view of n points."""
    return Assessment(
        np.empty(n), np.empty((8, 8)), np.empty((MAX_OTHERS, ROW_SIZE)), np.empty(MAX_OTHERS)
    )


@jit
def inliers_of(row: Array, problem: Problem, limit: float, squares: Array) -> tuple[int, float]:
    """Write the squared errors; return the number and the sum of those below the limit."""
    squared_errors(row, problem, 0, len(squares), squares)
    count = 0
    total = 0.0
    for square in squares:
        if square < limit:
            count += 1
            total += square
    return count, total


@jit
def measured_noise(
    problem: Problem,
    prior_squares: float,
    inliers: tuple[int, float],
    limit: float,
    sigma_px: float,
) -> tuple[float, int]:
    """
    Return the noise variance, px², and the degrees of freedom with which it was measured.

    prior_squares: the squared residuals of the priors, px². 0 degrees of freedom: the noise was
    given (sigma_px > 0), or the points are too few to measure it.
    """
    if sigma_px > 0.0:
        return sigma_px * sigma_px, 0
    count, total = inliers
    prior = problem.prior
    priors = (1 if prior.focal_weight > 0.0 else 0) + (1 if prior.k_weight > 0.0 else 0)
    dof = 2 * count + priors - problem.unknowns
    if len(problem.image) == 4 or dof <= 0:
        return DEFAULT_SIGMA_PX * DEFAULT_SIGMA_PX, 0
    return noise_variance(total + prior_squares, dof, limit), dof


@jit
def assess(
    row: Array,
    problem: Problem,
    limit: float,
    sigma_px: float,
    board_scale: tuple[float, float, float],
    search_others: bool,
    steps: int,
    arrays: Assessment,
) -> tuple[int, float, float, int, tuple[float, float]]:
    """
    Refine ``row`` in place, in at most ``steps``, and fill the arrays of its assessment.

    sigma_px 0: the noise is measured. board_scale: see ``Observation``. Return the fields of
    ``Summary``.
    """
    work = ransac_work()
    others = 0
    for attempt in range(2):
        cost, count, total, variance, dof, stretch = _refined(
            row, problem, limit, sigma_px, board_scale, steps, arrays, work
        )
        if not search_others or attempt > 0:
            break
        excess = largest_excess(variance, dof, MAX_RATIO)
        others = other_optima(problem, row, cost, limit, excess, arrays.others, arrays.costs, work)
        if not _swap_with_better(row, cost, others, arrays):
            break
    return count, total, variance, others, stretch


@jit
def _refined(
    row: Array,
    problem: Problem,
    limit: float,
    sigma_px: float,
    board_scale: tuple[float, float, float],
    steps: int,
    arrays: Assessment,
    work: RansacWork,
) -> tuple[float, int, float, float, int, tuple[float, float]]:
    """Return cost, number of inliers, their sum, noise variance, its dof, and the stretch."""
    copy_row(row, work.local)
    cost = minimise(work.local, problem, limit, steps, _TOLERANCE, work.refine)
    if plausible(work.local, problem):
        copy_row(work.local, row)
    else:
        cost = truncated_cost(row, problem, limit, math.inf)
    count, total = inliers_of(row, problem, limit, arrays.squares)
    variance, dof = measured_noise(
        problem, prior_cost(row, problem.prior), (count, total), limit, sigma_px
    )
    stretch = (0.0, math.inf)
    if problem.unknowns == POSE:
        stretched_equations(row, problem, limit, work.refine)
        stretch = stretch_of((count, total), limit, sigma_px, work.refine)
    else:
        normal_equations(row, problem, limit, work.refine)
    widened = posterior_variance(variance, dof, limit)
    system = work.refine.system
    covariance_from(
        work.refine.normal, problem.unknowns, widened, row, board_scale, system, arrays.covariance
    )
    return cost, count, total, variance, dof, stretch


@jit
def _swap_with_better(row: Array, cost: float, others: int, arrays: Assessment) -> bool:
    """Swap the row with the best of the others if that costs less; return whether it did."""
    best = -1
    for i in range(others):
        if arrays.costs[i] < cost * _BETTER:
            cost = arrays.costs[i]
            best = i
    if best >= 0:
        for i in range(len(row)):
            row[i], arrays.others[best, i] = arrays.others[best, i], row[i]
    return best >= 0


@jit
def solve_four(problem: Problem, rows: Array) -> int:
    """Write the solutions of exactly four points; return their number."""
    return hypotheses(problem, np.arange(4), rows, workspace())


@jit
def refine_all(rows: Array, count: int, problem: Problem, limit: float, costs: Array) -> None:
    """Refine each row over the points within the limit, px²; write the costs (count,)."""
    work = least_squares_work()
    for s in range(count):
        costs[s] = minimise(rows[s], problem, limit, STEPS, _TOLERANCE, work)
