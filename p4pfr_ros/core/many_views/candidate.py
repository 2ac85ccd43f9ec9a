# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""
A new view, before it is used, and its evaluation with the camera of the joint fit.

A ``Candidate`` is a new view that may agree with the fit or not. An ``EvaluatedView`` has the
residuals of a view with the fit's camera, and its information about the lens.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
import math
from typing import NamedTuple

import numpy as np

from .board_views import board_view, BoardView, stacked_views
from .bundle_adjustment import (
    COLUMNS,
    pose_step,
    reduce_view,
    squared_error,
    StackedViews,
    view_block,
    VIEW_COMMON,
    WIDTH,
)
from .joint_fit import JointFit
from ..cameras.division import DivisionCamera
from ..geometry import Array, Pose, POSE_SIZE, TRANSLATION
from ..jit import jit
from ..linalg import copy_row, rotate
from ..model.lens import (
    camera_from_lens,
    CX,
    CY,
    lens_from_camera,
    LENS_SIZE,
    POSE_COLUMNS,
)
from ..model.observation import CenteredView, Observation
from ..one_view.describe import FoundPoses
from ..one_view.estimate_pose import estimate_observation, search_poses
from ..one_view.full_estimate import FullViewProblem, Rival, ViewFit
from ..one_view.results import (
    EstimateOptions,
    PoseEstimate,
    with_unusual_deviations,
    without_deviations,
)

# A view agrees without further tests if this share of its points are inliers, and their mean
# squared error is at most this multiple of its expectation.
_INLIER_RATIO = 0.85
_SQUARES = 1.5

# If a view and the others have the same camera, a common fit costs more than separate ones by a χ²
# of the camera's parameters (noise variance times scatter): at most this. No lens follows the
# model exactly, so this share of the noise variance is tolerated in addition for each point.
_LARGEST_CHI2 = 30.0
_MODEL_SHARE = 0.5

# Steps of a pose to its optimum with the board's shape, and the gain, as a share of the limit
# below which it is there.
_POSE_STEPS = 4
_POSE_GAIN = 1e-4

# A view may be of a camera that has changed, or its board or shutter deviates more than usual: by
# this factor, as a board of 200 mm that is bowed by 2 mm. The first explains the view better by so
# much in chi-square: the view contradicts the camera. (Of 300 views of bowed and stretched boards,
# rolling shutters and covered boards, none reached 9; at a zoom of 1.3 half of the views do.)
_UNUSUAL_FACTOR = 4.0
_CONTRADICTION = 12.0

# How probable a board or shutter that deviates unusually, and a camera that has changed, are
# beforehand. The latter counts where usual deviations make chi-square larger by so much.
_UNUSUAL_BOARD, _CHANGED_CAMERA = 0.02, 0.005
_NOT_USUAL = 6.0

# A view whose chi-square is above its expectation by more may be of a camera that has changed,
# though the camera explains it: its covariance then includes that.
_SUSPICIOUS = 15.0


def disagrees(excess: float, points: int, fit: JointFit) -> bool:
    """Return whether the excess cost, px², of a view with the fit's camera is significant."""
    return excess > (_LARGEST_CHI2 * fit.measured_scatter + _MODEL_SHARE * points) * fit.variance


class LensContrast(NamedTuple):
    """
    A view with a known camera against the same view with a camera of its own.

    usual_excess, excess: by how much chi-square is larger with the known camera, while board and
    shutter deviate as usual, or more than that; own: the fit with the camera of its own.
    """

    usual_excess: float
    excess: float
    own: ViewFit

    def rival(self, scatter: float) -> Rival | None:
        """
        Return the camera of its own, as probable as the points make it.

        None if usual deviations explain the view. scatter: that of views of the known camera.
        """
        usual_excess, excess = self.usual_excess / scatter, self.excess / scatter
        if usual_excess < _NOT_USUAL:
            return None
        known = math.exp(-0.5 * usual_excess) + _UNUSUAL_BOARD * math.exp(-0.5 * excess)
        return Rival(self.own, _CHANGED_CAMERA / (_CHANGED_CAMERA + known))


def _excess(known: ViewFit, free: ViewFit, limit: float) -> float:
    """Return by how much chi-square of one fit is larger than that of another."""
    variance = min(known.numbers.variance, free.numbers.variance)
    return known.chi2(variance, limit) - free.chi2(variance, limit)


@dataclass(frozen=True, eq=False)
class Candidate:
    """
    A view, and the fit of the others with its camera; the properties are cached.

    board: the name of the view's board.
    """

    view: CenteredView
    board: str
    fit: JointFit
    camera: DivisionCamera
    image_size: tuple[int, int]
    robust: EstimateOptions

    @cached_property
    def in_fit(self) -> BoardView:
        """The view with its board's shape in the fit."""
        return board_view(self.view, self.board, self.fit.boards)

    @cached_property
    def _observation(self) -> Observation:
        """The points where they are on the real board, as far as the fit knows."""
        return self.in_fit.shaped(self.fit.common)

    @cached_property
    def known(self) -> FoundPoses:
        """The poses with the fit's camera, taken as known, without deviations."""
        return search_poses(self._centered, self.camera, self.robust)

    @cached_property
    def known_pose(self) -> Pose | None:
        """The best of these poses, camera_from_board; None if there is none."""
        rows = self.known.rows
        return self.view.observation.pose_from_row(rows[0]) if rows else None

    @cached_property
    def _centered(self) -> CenteredView:
        """The view relative to the fit's principal point."""
        return self._observation.centered(self.camera.center_px, self.image_size)

    @cached_property
    def evaluated(self) -> EvaluatedView | None:
        """The view with the fit's camera; None if that camera gives no pose."""
        if not self.known.rows:
            return None
        return evaluate_view(self.in_fit, self.known.rows[0], self.fit.common, self.fit)

    @cached_property
    def alone(self) -> PoseEstimate:
        """The estimate from the view alone, but with the principal point of the fit."""
        center_px, options = self.camera.center_px, without_deviations(self.robust)
        return estimate_observation(
            self.view.observation, self.image_size, center_px, None, options
        )

    @cached_property
    def alone_row(self) -> Array | None:
        """The pose (12,) of the scaled board from the view alone; None if there is none."""
        model = self.alone.model
        if model is None:
            return None
        return self.view.observation.row_from_pose(model.camera_from_board)

    @property
    def row(self) -> Array:
        """The pose (12,) with the fit's camera, or else from the view alone."""
        row = self.alone_row if self.evaluated is None else self.evaluated.row
        assert row is not None, 'only for explained views'
        return row

    @cached_property
    def own_cost(self) -> float:
        """The cost of the view with its best camera, px², truncated at the fit's limit."""
        costs = [np.inf]
        model, row = self.alone.model, self.alone_row
        if model is not None and row is not None:
            common = self.fit.common.copy()
            common[:LENS_SIZE] = lens_from_camera(model.camera, self.view.center_px)
            flat = board_view(self.view, self.board, ())
            for view in (self.in_fit, flat):
                costs.append(evaluate_view(view, row, common, self.fit).cost)
        if self.evaluated is not None:
            costs.append(self.evaluated.cost)
        return min(costs)

    @property
    def explained(self) -> bool:
        """Whether the view has a pose with any camera."""
        return self.evaluated is not None or self.alone.model is not None

    @cached_property
    def agrees(self) -> bool:
        """Whether the fit's camera explains the view about as well as a camera of its own."""
        evaluated, fit = self.evaluated, self.fit
        if evaluated is None:
            return False
        many = evaluated.inliers >= _INLIER_RATIO * len(self.view.image)
        if many and evaluated.inlier_squares <= _SQUARES * 2.0 * fit.variance * evaluated.inliers:
            return True
        return not disagrees(evaluated.cost - self.own_cost, len(self.view.image), fit)

    @cached_property
    def _is_suspicious(self) -> bool:
        """Whether the residuals are larger than the fit's camera explains."""
        evaluated = self.evaluated
        if evaluated is None:
            return True
        freedom = 2 * len(self.view.image) - POSE_COLUMNS
        return evaluated.cost > (freedom + _SUSPICIOUS) * self.fit.variance

    def _problem_with(self, fit: JointFit, options: EstimateOptions) -> FullViewProblem:
        """Return the view with the camera of a fit, of which the covariance is the prior."""
        camera, view = self.camera, self._centered
        if fit is not self.fit:
            camera = camera_from_lens(fit.lens, self.view.center_px)
            board = board_view(self.view, self.board, fit.boards)
            view = board.shaped(fit.common).centered(camera.center_px, self.image_size)
        mean, covariance = fit.lens_without(self.view)
        mean = mean.copy()
        mean[CX : CY + 1] -= fit.lens[CX : CY + 1]
        return FullViewProblem(
            view,
            camera,
            options,
            lens_prior=(mean, covariance),
            noise_px=math.sqrt(fit.posterior_variance),
        )

    @cached_property
    def contrast(self) -> LensContrast:
        """The view with the fit's camera against the view with a camera of its own."""
        free = FullViewProblem(
            self._centered,
            None,
            self.robust,
            noise_px=math.sqrt(self.fit.posterior_variance),
        )
        rows = []
        own = self.alone.model.camera if self.alone.model else None
        for pose, camera in ((self.known.model, self.camera), (self.alone_row, own)):
            if pose is not None and camera is not None:
                lens = [camera.focal_px, camera.k / camera.focal_px]
                rows.append(np.concatenate([pose[:POSE_SIZE], lens]))
        own_fit, limit = free.best_fit(rows), self.robust.threshold_px**2
        unusual = with_unusual_deviations(self.robust, _UNUSUAL_FACTOR)
        usual_excess, excess = (
            _excess(self._problem_with(self.fit, options).best_fit([self.row]), own_fit, limit)
            for options in (self.robust, unusual)
        )
        return LensContrast(usual_excess, excess, own_fit)

    @property
    def contradicts(self) -> bool:
        """Whether no deviation explains the view with the fit's camera, but another camera."""
        return self.contrast.excess > _CONTRADICTION * self.fit.measured_scatter

    def estimate_with(self, fit: JointFit, row: Array) -> PoseEstimate:
        """
        Estimate the pose with the camera of a fit.

        row: the pose (12,) of the scaled board to start from.
        """
        problem, known = self._problem_with(fit, self.robust), self.known
        status, iterations, others = known.status, known.iterations, known.rows[1:]
        if not known.rows:
            status, iterations = self.alone.status, self.alone.iterations
        scatter = self.fit.measured_scatter
        rival = self.contrast.rival(scatter) if self._is_suspicious else None
        return problem.estimate_from([row, *others], status, iterations, rival)

    def estimate_alone(self) -> PoseEstimate:
        """Estimate from the view alone, its principal point about that of the fit."""
        return estimate_observation(
            self._observation,
            self.image_size,
            self.camera.center_px,
            None,
            self.robust,
            center_known=False,
        )


@dataclass(frozen=True, eq=False)
class EvaluatedView:
    """
    A view with a given camera, and the best pose near a given one.

    row (12,): the pose of the scaled board; squares (N,): the squared errors, px²; inliers: the
    number of them within the fit's limit, and inlier_squares: their sum; information (18, 18) and
    gradient (18,): about lens and board, the pose eliminated, px².
    """

    view: BoardView
    fit: JointFit
    row: Array
    squares: Array
    inliers: int
    inlier_squares: float
    information: Array
    gradient: Array

    @property
    def cost(self) -> float:
        """The sum of the squared errors, each truncated at the fit's limit, px²."""
        return self.inlier_squares + (len(self.squares) - self.inliers) * self.fit.limit


def evaluate_view(view: BoardView, row: Array, common: Array, fit: JointFit) -> EvaluatedView:
    """Evaluate a view near a pose (≥ 12,), with lens and shapes (C,), the limit of a fit."""
    row, squares = row[:POSE_SIZE].copy(), np.empty(len(view.image))
    equations = np.empty((VIEW_COMMON, VIEW_COMMON + 1))
    inliers, total = _evaluate(stacked_views([view]), row, common, fit.limit, squares, equations)
    information, gradient = equations[:, :VIEW_COMMON], equations[:, VIEW_COMMON]
    return EvaluatedView(
        view, fit, row, squares, inliers, total, 0.5 * (information + information.T), gradient
    )


@jit
def _evaluate(
    points: StackedViews,
    row: Array,
    common: Array,
    limit: float,
    squares: Array,
    equations: Array,
) -> tuple[int, float]:
    """
    Move a pose to its optimum, in place; write the squared errors and equations.

    Return the number of inliers and their sum. The pose was found on the flat board.
    """
    rows, block = np.zeros((8, WIDTH)), np.empty((COLUMNS, WIDTH))
    solved, step, other = np.empty((POSE_COLUMNS, COLUMNS)), np.empty(POSE_COLUMNS), row.copy()
    still = np.zeros(len(common))
    cost = view_block(points, 0, row, common, limit, rows, block)
    for _ in range(_POSE_STEPS):
        reduce_view(block, 0.0, solved, equations)
        gain = pose_step(block, solved, points.boards[0], still, step)
        if not gain > _POSE_GAIN * limit:
            break
        rotate(row, step[0], step[1], step[2], other)
        for i in range(3):
            other[TRANSLATION + i] = row[TRANSLATION + i] + step[3 + i]
        lower = view_block(points, 0, other, common, limit, rows, block)
        if not lower < cost:
            view_block(points, 0, row, common, limit, rows, block)
            break
        cost = lower
        copy_row(other, row)
    reduce_view(block, 0.0, solved, equations)
    inliers, total = 0, 0.0
    for i in range(len(squares)):
        squares[i] = squared_error(points, i, row, common, points.boards[0])
        if squares[i] < limit:
            inliers += 1
            total += squares[i]
    return inliers, total
