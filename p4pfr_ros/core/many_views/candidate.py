# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""
A new view, before it is used, and its evaluation with the camera of the joint fit.

A ``Candidate`` is a new view that may agree with the fit or not. An ``EvaluatedView`` has the
residuals of a view with the fit's camera, its information about the lens, and its pose covariance.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
import math

import numpy as np

from .bundle_adjustment import squared_errors, StackedViews, view_block
from .joint_fit import fit_views, JointFit, stacked_views
from ..cameras.division import DivisionCamera
from ..geometry import Array
from ..jit import jit
from ..linalg import inverse_of_information
from ..minimal.solution import Solution
from ..model.lens import (
    camera_from_lens,
    COLUMNS,
    CX,
    CY,
    FOCAL,
    K,
    lens_from_camera,
    LENS_SIZE,
    POSE_COLUMNS,
    RESIDUAL,
    squared_error,
)
from ..model.observation import CenteredView
from ..model.prior import LensPrior
from ..model.uncertainty import COVARIANCE_SIZE, noise_variance, pose_to_public
from ..one_view.estimate_pose import estimate_observation
from ..one_view.results import (
    EstimateOptions,
    mark_undetermined,
    observability_of,
    PoseEstimate,
    Status,
)

# A blurred view has its own noise: used from this multiple of the variance of all views, and with
# at least this many degrees of freedom.
_NOISIER = 2.0
_MIN_DOF = 20

# A view agrees without further tests if this share of its points are inliers, and their mean
# squared error is at most this multiple of its expectation.
_INLIER_RATIO = 0.85
_SQUARES = 1.5

# If a view and the others have the same camera, a common fit costs more than separate ones by a χ²
# of the camera's parameters (noise variance times scatter): at most this. No lens follows the
# model exactly, so this share of the noise variance is tolerated in addition for each point.
_LARGEST_CHI2 = 30.0
_MODEL_SHARE = 0.5


def disagrees(excess: float, points: int, fit: JointFit) -> bool:
    """Return whether the excess cost, px², of a view with the fit's camera is significant."""
    return excess > (_LARGEST_CHI2 * fit.scatter + _MODEL_SHARE * points) * fit.variance


@dataclass(frozen=True, eq=False)
class Candidate:
    """A view, and the fit of the others with its camera; the properties are cached."""

    view: CenteredView
    fit: JointFit
    camera: DivisionCamera
    image_size: tuple[int, int]
    robust: EstimateOptions

    @cached_property
    def known(self) -> PoseEstimate:
        """The estimate with the fit's camera, taken as known."""
        return estimate_observation(self.view.observation, None, None, self.camera, self.robust)

    @cached_property
    def evaluated(self) -> EvaluatedView | None:
        """The view with the fit's camera; None if that camera gives no pose."""
        if self.known.model is None:
            return None
        row = self.view.observation.row_from_pose(self.known.model.camera_from_board)
        return evaluate_view(self.view, row, self.fit)

    @cached_property
    def alone(self) -> PoseEstimate:
        """The estimate from the view alone, but with the principal point of the fit."""
        center_px = self.camera.center_px
        return estimate_observation(
            self.view.observation, self.image_size, center_px, None, self.robust
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
            lens = lens_from_camera(model.camera, self.view.center_px)
            squares = np.empty(len(self.view.image))
            squared_errors(stacked_views([self.view]), row[None], lens, squares)
            costs.append(float(np.minimum(squares, self.fit.limit).sum()))
        if self.evaluated is not None:
            costs.append(self.evaluated.cost)
        return min(costs)

    @property
    def explained(self) -> bool:
        """Whether the view has a pose with any camera."""
        return self.evaluated is not None or self.alone.model is not None

    @property
    def known_or_alone(self) -> PoseEstimate:
        """The estimate with the fit's camera, or else from the view alone."""
        return self.alone if self.known.model is None else self.known

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

    def estimate_alone(self, typical: LensPrior) -> PoseEstimate:
        """
        Estimate from the view alone, with an uncertain principal point.

        Four points are too few to estimate a centre: their result is ``alone``.
        """
        alone, row, view = self.alone, self.alone_row, self.view
        if alone.model is None or row is None or len(view.image) == 4:
            return alone
        mean = typical.mean.copy()
        mean[CX : CY + 1] = lens_from_camera(self.camera, view.center_px)[CX : CY + 1]
        prior = replace(typical, mean=mean)
        lens = lens_from_camera(alone.model.camera, view.center_px)
        fit = fit_views([view], row[None], lens, 1, prior, self.robust.sigma_px)
        evaluated = evaluate_view(view, fit.poses[0], fit)
        return estimate_from_view(evaluated, alone, self.robust.threshold_px)


@dataclass(frozen=True, eq=False)
class EvaluatedView:
    """
    A view with a given pose and the camera of a joint fit.

    row (12,): the pose of the scaled board; squares (N,): the squared errors, px²; inliers: the
    number of them within the fit's limit, and inlier_squares: their sum; block (13, 13): the
    normal equations of pose and lens, [C B; Bᵀ A] of ``bundle_adjustment``.
    """

    view: CenteredView
    fit: JointFit
    row: Array
    squares: Array
    inliers: int
    inlier_squares: float
    block: Array

    @property
    def cost(self) -> float:
        """The sum of the squared errors, each truncated at the fit's limit, px²."""
        return self.inlier_squares + (len(self.view.image) - self.inliers) * self.fit.limit

    @cached_property
    def information(self) -> Array:
        """The information (6, 6) about the lens, px², the pose eliminated."""
        across, by_lens = self._parts()
        information: Array = by_lens - across.T @ self._inverse @ across
        return 0.5 * (information + information.T)

    @cached_property
    def gradient(self) -> Array:
        """The negative gradient (6,) of the lens, px², the pose eliminated."""
        across, _ = self._parts()
        by_residual = self.block[:RESIDUAL, RESIDUAL]
        at_pose = self._inverse @ by_residual[:POSE_COLUMNS]
        negative: Array = across.T @ at_pose - by_residual[POSE_COLUMNS:]
        return negative

    def covariance(self) -> Array:
        """Return the covariance (8, 8) of pose, focal length and k, in the caller's units."""
        covariance = np.empty((COVARIANCE_SIZE, COVARIANCE_SIZE))
        pose_covariance(
            self.block,
            self._inverse,
            self.fit.covariance,
            self._noise(),
            self.row,
            self.view.observation.board_scale,
            covariance,
        )
        return covariance

    @cached_property
    def _inverse(self) -> Array:
        """C⁻¹ of the block."""
        return inverse_of_information(self.block[:POSE_COLUMNS, :POSE_COLUMNS])

    def _parts(self) -> tuple[Array, Array]:
        """Return B and A of the block."""
        pose, lens = slice(0, POSE_COLUMNS), slice(POSE_COLUMNS, RESIDUAL)
        return self.block[pose, lens], self.block[lens, lens]

    def _noise(self) -> float:
        """Return the variance of a coordinate, px²."""
        dof = 2 * self.inliers - POSE_COLUMNS
        of_fit = self.fit.posterior_variance
        if dof < _MIN_DOF:
            return of_fit
        own = noise_variance(self.inlier_squares, dof, self.fit.limit)
        return own if own > _NOISIER * self.fit.variance else of_fit


def evaluate_view(view: CenteredView, row: Array, fit: JointFit) -> EvaluatedView:
    """Evaluate a view with a given pose (12,) and the fit's camera."""
    squares, block = np.empty(len(view.image)), np.empty((COLUMNS, COLUMNS))
    inliers, total = _evaluate(stacked_views([view]), row, fit.lens, fit.limit, squares, block)
    return EvaluatedView(view, fit, row, squares, inliers, total, block)


@jit
def _evaluate(
    points: StackedViews, row: Array, lens: Array, limit: float, squares: Array, block: Array
) -> tuple[int, float]:
    """Write a view's squared errors and block; return the number of inliers and their sum."""
    view_block(points, 0, row, lens, limit, np.empty((2, COLUMNS)), block)
    inliers, total = 0, 0.0
    for i in range(len(squares)):
        x, y = points.board[i, 0], points.board[i, 1]
        squares[i] = squared_error(row, lens, x, y, points.image[i, 0], points.image[i, 1])
        if squares[i] < limit:
            inliers += 1
            total += squares[i]
    return inliers, total


def estimate_from_view(
    evaluated: EvaluatedView, known: PoseEstimate, threshold_px: float
) -> PoseEstimate:
    """
    Return the public estimate of an evaluated view.

    known: the estimate with the same camera or one close to it, which has the alternatives.
    """
    view = evaluated.view
    camera = camera_from_lens(evaluated.fit.lens, view.center_px)
    pose = view.observation.pose_from_row(evaluated.row)
    covariance = evaluated.covariance()
    observable = observability_of(camera.focal_px, pose.translation, covariance, view.corner_px)
    inliers = evaluated.squares < threshold_px**2
    status = known.status
    if observable.undetermined:
        status = Status.UNDETERMINED
    elif status is Status.UNDETERMINED:
        status = Status.CONFIDENT
    return replace(
        known,
        model=Solution(camera, pose),
        status=status,
        inliers=inliers,
        rms_px=math.sqrt(evaluated.squares[inliers].mean()) if inliers.any() else math.nan,
        covariance=mark_undetermined(covariance, observable),
        alternatives=tuple(Solution(camera, s.camera_from_board) for s in known.alternatives),
        observable=observable,
    )


@jit
def pose_covariance(
    block: Array,
    inverse: Array,
    of_lens: Array,
    noise: float,
    row: Array,
    board_scale: tuple[float, float, float],
    covariance: Array,
) -> None:
    """
    Write the (8, 8) covariance of x, y, z, rotation x, y, z, focal_px, k.

    block (13, 13): normal equations [C B; Bᵀ A] of pose and lens; inverse (6, 6): C⁻¹; of_lens
    (6, 6): the covariance of the lens; noise: the variance of a coordinate, px²; row (12,): the
    pose of the scaled board; board_scale: see ``Observation``.
    """
    # A change dθ of the lens, of covariance Λ, changes the pose by δ = F dθ,  F = -C⁻¹ B,  in
    # addition to the noise:     cov(δ) = σ² C⁻¹ + F Λ Fᵀ,     cov(δ, θ) = F Λ.
    n = POSE_COLUMNS
    follows, with_lens = np.zeros((n, LENS_SIZE)), np.zeros((n, LENS_SIZE))
    for a in range(n):
        for j in range(LENS_SIZE):
            for b in range(n):
                follows[a, j] -= inverse[a, b] * block[b, n + j]
    for a in range(n):
        for j in range(LENS_SIZE):
            for i in range(LENS_SIZE):
                with_lens[a, j] += follows[a, i] * of_lens[i, j]
    for a in range(n):
        for b in range(n):
            covariance[a, b] = noise * inverse[a, b]
            for j in range(LENS_SIZE):
                covariance[a, b] += with_lens[a, j] * follows[b, j]
        for at, j in ((n, FOCAL), (n + 1, K)):
            covariance[a, at] = covariance[at, a] = with_lens[a, j]
    for at, i in ((n, FOCAL), (n + 1, K)):
        covariance[at, n] = of_lens[i, FOCAL]
        covariance[at, n + 1] = of_lens[i, K]
    for j in range(n + 2):
        pose_to_public(covariance[:, j], row, board_scale)
    for j in range(n + 2):
        pose_to_public(covariance[j, :], row, board_scale)
