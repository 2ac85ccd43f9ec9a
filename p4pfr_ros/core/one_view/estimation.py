# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""One call of ``estimate_pose``: find the best model, or rank those of four points."""

from __future__ import annotations

from dataclasses import dataclass
import math

import numpy as np

from .ambiguity import same_optimum
from .conclude import MAX_RATIO, refine_all, refine_wide, solve_four
from .describe import Answering, no_estimate
from .least_squares import truncated_cost
from .prior import NO_PRIOR
from .problem import known_problem, POSE, Problem
from .ransac import Search, search_best
from .results import PoseEstimate, Status
from .weak_perspective import weak_perspective_rows
from ..cameras.division import DivisionCamera
from ..geometry import Array
from ..minimal.roots import MAX_ROOTS
from ..minimal.solution import G, H, ROW_SIZE

# A guessed camera is some pixels off: its pose is sought with a wider threshold (of squares).
_WIDE = 100.0


@dataclass(frozen=True, slots=True)
class Estimation:
    """One call, of a view whose points are not on a line."""

    answering: Answering

    def run(self) -> PoseEstimate:
        """Answer."""
        return self._from_four() if len(self.answering.view.image) == 4 else self._from_many()

    def _from_four(self) -> PoseEstimate:
        """Rank every solution of exactly four points."""
        answering = self.answering
        problem = answering.problem()
        rows = np.empty((MAX_ROOTS + 1, ROW_SIZE))
        costs = np.empty(MAX_ROOTS + 1)
        count = solve_four(problem, rows)
        if problem.unknowns == POSE:
            return self._pose_of_four(problem, rows[:count])
        guess = self._guessed() if count == 0 or self._knows_focal else None
        if guess is not None:
            rows[count] = guess
            count += 1
        if count == 0:
            return no_estimate(Status.NO_SOLUTION, 4, 1)
        # None of four is an outlier yet. Without a prior a free camera meets them exactly.
        refine_all(rows, count, problem, costs)
        if count == 1:
            return answering.describe(rows[0], problem, None, Status.FOUR_POINTS, 1)
        ranked = _ranked(rows[:count], costs[:count], answering, problem.prior != NO_PRIOR)
        return answering.describe(ranked[0], problem, ranked[1:], Status.FOUR_POINTS, 1)

    def _pose_of_four(self, problem: Problem, rows: Array) -> PoseEstimate:
        """Refine the pose by a known camera from its closed form, or from weak perspective."""
        costs = np.empty(2)
        refine_all(rows, len(rows), problem, costs)
        if len(rows) == 0 or not costs[0] < self.answering.options.threshold_px**2:
            rows = weak_perspective_rows(problem.rays, problem.board)
            refine_all(rows, len(rows), problem, costs)
        if len(rows) == 0:
            return no_estimate(Status.NO_SOLUTION, 4, 1)
        best = rows[np.argmin(costs[: len(rows)])]
        return self.answering.describe(best, problem, None, Status.FOUR_POINTS, 1)

    def _from_many(self) -> PoseEstimate:
        """Search, refine and look for other optima."""
        answering = self.answering
        best = np.empty(ROW_SIZE)
        search = self._search(1.0)
        problem = answering.problem()
        iterations, cost = search_best(problem, search, best)
        if self._knows_focal:
            # Samples of a view from straight ahead have any focal length but the known one.
            guess = self._guessed()
            if guess is not None and truncated_cost(guess, problem, search.limit, cost) < cost:
                best, cost = guess, 0.0
        stop = Status.SPENT if iterations == search.max_iterations else Status.CONFIDENT
        answer = no_estimate(Status.NO_SOLUTION, len(problem.image), iterations)
        if cost < math.inf:
            answer = answering.describe(best, problem, None, stop, iterations)
        if answer.model is None and not self._knows_focal:
            for start in self._other_starts():
                found = answering.describe(start, problem, None, stop, iterations)
                if found.model is not None:
                    return found
        return answer

    def _other_starts(self) -> Array:
        """Return rows (n, ROW_SIZE) for a view whose samples have no solution, or a bad one."""
        if self.answering.camera is None:
            guess = self._guessed()
            return np.empty((0, ROW_SIZE)) if guess is None else guess[None]
        problem = self.answering.problem()
        rows = weak_perspective_rows(problem.rays, problem.board)
        refine_all(rows, len(rows), problem, np.empty(len(rows)))
        return rows

    @property
    def _knows_focal(self) -> bool:
        answering = self.answering
        return answering.camera is None and answering.options.prior_focal_px is not None

    def _search(self, widen: float) -> Search:
        options = self.answering.options
        return Search(
            widen * options.threshold_px**2,
            options.confidence,
            min(options.min_iterations, math.comb(len(self.answering.view.image), 4)),
            options.max_iterations,
            options.seed,
        )

    def _guessed(self) -> Array | None:
        """Return a row by a common camera, or the known one, refined with that as its prior."""
        common = self.answering.problem(common_focal=True, common_k=True)
        focal_px, k = common.prior.focal_px, common.prior.k
        lens = DivisionCamera(focal_px, (0.0, 0.0), k)
        known = known_problem(common.image, common.board, common.gates, lens)
        row = np.empty(ROW_SIZE)
        search = self._search(_WIDE)
        if not search_best(known, search, row)[1] < math.inf:
            return None
        row[G], row[H] = focal_px, k / focal_px
        refine_wide(row, common, search.limit, self.answering.options.threshold_px**2)
        return row


def _ranked(rows: Array, costs: Array, answering: Answering, by_cost: bool) -> Array:
    """Sort solutions: by their cost, or where all cost nothing by how common they are."""
    if by_cost:
        order = np.argsort(costs, kind='stable')
        order = order[costs[order] - costs.min() <= MAX_RATIO * answering.sigma_px**2]
    else:
        order = np.argsort([answering.surprise(row) for row in rows], kind='stable')
    different: list[Array] = []
    for row in rows[order]:
        if not any(same_optimum(row, other) for other in different):
            different.append(row)
    return np.array(different)
