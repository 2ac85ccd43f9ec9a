# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""From a kernel's row of numbers to a ``PoseEstimate``: priors, noise, honesty."""

from __future__ import annotations

from dataclasses import dataclass, replace
import math

import numpy as np

from .conclude import conclude, Conclusion, conclusion_room, MAX_RATIO, STEPS, Summary
from .free_camera import Gates
from .likelihood import another_focal_fits
from .observability import Observability, observability_of, without_the_undetermined
from .prior import Prior
from .problem import free_problem, known_problem, Problem
from .results import EstimateOptions, PoseEstimate, Status
from ..cameras.division import DivisionCamera
from ..geometry import Array, Pose
from ..minimal.solution import G, H, Solution, TRANSLATION
from ..model.observation import PreparedView
from ..model.uncertainty import DEFAULT_SIGMA_PX

# What most cameras are: a field of view of about 60°, and a lens that bends the corner little.
# It stands in for what a view does not determine, and ranks what it cannot tell apart; a
# quantity it stands in for is never called observable.
_COMMON_HALF_FOV_RAD = math.radians(30.0)
_COMMON_FOCAL_SPREAD = 0.5  # of itself
_COMMON_BEND_SPREAD = 0.3  # of k |d|² at the image's corner
_NOT_SURPRISING = 4.0  # two spreads, squared

# A focal length that is known to this share of itself is not asked about again.
_SURE = 0.03


@dataclass(frozen=True, slots=True)
class Answering:
    """The view as the kernels want it, and the way back to the caller's frame."""

    view: PreparedView
    camera: DivisionCamera | None
    options: EstimateOptions

    @property
    def sigma_px(self) -> float:
        """The noise of a coordinate before any is measured."""
        return self.options.sigma_px or DEFAULT_SIGMA_PX

    def problem(
        self,
        variance: float | None = None,
        *,
        common_focal: bool = False,
        common_k: bool = False,
    ) -> Problem:
        """
        Make the problem, its priors weighed by the variance of the noise, px².

        common_focal, common_k: what most cameras are stands in where the caller knows nothing.
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
        prior = self._prior(variance or self.sigma_px**2, common_focal, common_k)
        return free_problem(view.image, view.board, gates, prior)

    def _prior(self, variance: float, common_focal: bool, common_k: bool) -> Prior:
        options = self.options
        focal_px, focal_spread_px = options.prior_focal_px, options.prior_focal_sigma_px
        k, k_spread = options.prior_k, options.prior_k_sigma
        common_px = self.view.corner_px / math.tan(_COMMON_HALF_FOV_RAD)
        if focal_px is None and common_focal:
            focal_px, focal_spread_px = common_px, _COMMON_FOCAL_SPREAD * common_px
        if k_spread is None and common_k:
            k_spread = _COMMON_BEND_SPREAD * ((focal_px or common_px) / self.view.corner_px) ** 2
        return Prior(
            focal_px or 0.0,
            variance / focal_spread_px**2 if focal_spread_px else 0.0,
            k,
            variance / k_spread**2 if k_spread else 0.0,
        )

    def surprise(self, row: Array) -> float:
        """Rank cameras by how common they are: squares of deviations in units of a spread."""
        corner_px = self.view.corner_px
        by_focal = math.log2(row[G] / (corner_px / math.tan(_COMMON_HALF_FOV_RAD)))
        by_bend = row[H] * corner_px**2 / row[G] / _COMMON_BEND_SPREAD
        return float(by_focal**2 + by_bend**2)

    def describe(
        self, row: Array, problem: Problem, others: Array | None, stop: Status, iterations: int
    ) -> PoseEstimate:
        """
        Say of a row all that there is to say.

        problem: the view's, with the caller's priors. others None: they are sought.
        """
        n = len(self.view.image)
        found = conclusion_room(n)
        seek = others is None
        start = row.copy()
        summary = self._conclude(row, problem, seek, found)
        if self.options.sigma_px is None and self._has_priors:
            # They had been weighed by a guess of the noise.
            summary = self._conclude(row, self.problem(summary.variance), seek, found)
        seen = self._seen(row, summary, found)
        if not (seen.distortion and seen.focal):
            row[:] = start
            summary, seen = self._stand_in(row, seen, summary, seek, found)
        if summary.inliers < min(n, self.options.min_inliers):
            return no_estimate(Status.NO_CONSENSUS, n, iterations)
        if others is None:
            others = found.others[: summary.others]
        return PoseEstimate(
            model=self._solution(row),
            status=_stop(stop, seen),
            inliers=found.squares < self.options.threshold_px**2,
            rms_px=math.sqrt(summary.total / summary.inliers),
            iterations=iterations,
            covariance=without_the_undetermined(found.covariance, seen),
            alternatives=tuple(self._solution(other) for other in others),
            observable=seen,
        )

    def _stand_in(
        self, row: Array, seen: Observability, summary: Summary, seek: bool, found: Conclusion
    ) -> tuple[Summary, Observability]:
        """
        Conclude with a common camera in place of what the view leaves open.

        What is small over all common cameras is determined all the same: the direction of a
        board seen from straight ahead, say. What the common camera stands in for is not.
        """
        variance = summary.variance
        # An exact solution of four points by a common camera stays one, beside the others.
        steps = 0 if not seek and self.surprise(row) < _NOT_SURPRISING else STEPS
        if not seen.distortion:
            problem = self.problem(variance, common_k=True)
            summary = self._conclude(row, problem, seek, found, steps)
            seen = replace(self._seen(row, summary, found), distortion=False)
        if not seen.focal:
            problem = self.problem(variance, common_k=not seen.distortion, common_focal=True)
            summary = self._conclude(row, problem, seek, found, steps)
            bends = seen.distortion
            seen = self._seen(row, summary, found)
            seen = replace(seen, distance=False, focal=False, distortion=seen.distortion and bends)
        return summary, seen

    @property
    def _has_priors(self) -> bool:
        options = self.options
        given = options.prior_focal_px is not None or options.prior_k_sigma is not None
        return self.camera is None and given

    def _conclude(
        self, row: Array, problem: Problem, seek: bool, found: Conclusion, steps: int = STEPS
    ) -> Summary:
        limit, sigma_px = self.options.threshold_px**2, self.options.sigma_px or 0.0
        board = (*self.view.board_mean.tolist(), self.view.board_size)
        return Summary(*conclude(row, problem, limit, sigma_px, board, seek, steps, found))

    def _seen(self, row: Array, summary: Summary, found: Conclusion) -> Observability:
        translation = self._translation(row)
        seen = observability_of(float(row[G]), translation, found.covariance, self.view.corner_px)
        share = math.sqrt(found.covariance[6, 6]) / row[G]
        if self.camera is not None or not seen.focal or share < _SURE or len(self.view.image) == 4:
            return seen
        # The standard deviation may deceive: ask the likelihood, by what the caller knows alone.
        limit = self.options.threshold_px**2
        problem = self.problem(summary.variance)
        deceived = another_focal_fits(row, problem, limit, MAX_RATIO * summary.variance)
        return replace(seen, focal=False, distance=False) if deceived else seen

    def _translation(self, row: Array) -> Array:
        """Return to the board's own origin and unit: R (X - m) / s + t, times s."""
        rotation = row[:TRANSLATION].reshape(3, 3)
        moved: Array = self.view.board_size * row[TRANSLATION:G]
        moved -= rotation[:, :2] @ self.view.board_mean
        return moved

    def _solution(self, row: Array) -> Solution:
        camera = self.camera
        if camera is None:
            g, h = row[G:].tolist()
            camera = DivisionCamera.unchecked(g, self.view.center_px, h * g)
        rotation = row[:TRANSLATION].reshape(3, 3).copy()
        return Solution(camera, Pose.unchecked(rotation, self._translation(row)))


def _stop(stop: Status, seen: Observability) -> Status:
    """Say first what people must know first."""
    if stop is Status.FOUR_POINTS or not seen.undetermined:
        return stop
    return Status.UNDETERMINED


def no_estimate(stop: Status, n: int, iterations: int) -> PoseEstimate:
    """Answer that there is none, and why."""
    return PoseEstimate(
        model=None,
        status=stop,
        inliers=np.zeros(n, dtype=bool),
        rms_px=math.nan,
        iterations=iterations,
        covariance=np.full((8, 8), np.nan),
        alternatives=(),
        observable=Observability(),
    )
