# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""``JointFit``: one lens and board shapes fitted to many views; noise, covariance, scatter."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
import math
from typing import NamedTuple

import numpy as np

from .board_views import BoardFrame, BoardView, number_of_shapes, stacked_views
from .bundle_adjustment import (
    adjust,
    adjustment_work,
    AdjustmentWork,
    squared_errors,
    StackedViews,
    VIEW_COMMON,
)
from .results import Keyframe
from ..cameras.division import DivisionCamera
from ..geometry import Array, Ints, POSE_SIZE
from ..linalg import inverse_of_information
from ..model.board_shape import BoardShape, SHAPE_SIZE
from ..model.lens import ASPECT, camera_from_lens, FOCAL, LENS_SIZE, POSE_COLUMNS
from ..model.observation import CenteredView
from ..model.prior import common_places, CommonPrior, FreeTerms, shape_slice, WeightedPrior
from ..model.uncertainty import DEFAULT_SIGMA_PX, noise_variance, posterior_variance

# Points beyond this many standard deviations of a coordinate are outliers, but no points within
# the second limit, px. Errors of real corners have longer tails than normal ones.
_GATE_SIGMAS = 6.0
_SMALLEST_GATE_PX = 0.1

# Degrees of freedom and scatter that are added to those measured where views shall tell alone.
_NO_SCATTER = 4.0, 1.0

# The median of the squared length of a normal error is 2 ln 2 variances of a coordinate.
_MEDIAN_SQUARE = 2.0 * math.log(2.0)

# Upper limit of the median, px²: it is infinite if most points are not visible.
_LARGEST_SQUARE = 1e6

# With fewer degrees of freedom the residuals do not measure the noise.
_MIN_DOF = 20

# Each round measures the noise for its gate and adjusts: maximum number of steps, and the relative
# fall of the cost below which it ends. Rounds end early where the gate stays.
_ROUNDS = ((20, 1e-2), (10, 1e-4), (20, 1e-7))
_SAME_GATE = 0.05

# A view is taken out of a fit by a linear step: at most so large, as a share of the focal length.
_FARTHEST_FOCAL = 0.5


@dataclass(frozen=True, eq=False)
class JointFit:
    """
    One lens, the shapes of the boards, and the poses of all views.

    common (C,): lens and shapes; terms: the free ones of the lens; boards: frames of the shapes
    poses (V, 12) of the scaled boards
    squares (M,): squared errors of all points, px²; limit: points beyond it are outliers, px²
    variance of a coordinate, px²; dof: degrees of freedom; measured: whether from the residuals
    scatter: chi-square per degree of freedom of the views' lenses, at least 1, and not small where
    views are too few to tell; measured_scatter: what they tell
    equations (C, C + 1): of the common parameters: views, prior and marginalised views, px²
    prior (C, C): information in them that is from the prior, not from marginalised views, px²
    typical (C,): of that, the information from a typical camera and board, px²
    information (V, 18, 18), gradients (V, 18): information and negative gradient of each view, px²
    """

    views: tuple[BoardView, ...]
    common: Array
    terms: FreeTerms
    boards: tuple[BoardFrame, ...]
    poses: Array
    squares: Array
    limit: float
    variance: float
    dof: int
    measured: bool
    scatter: float
    measured_scatter: float
    equations: Array
    prior: Array
    typical: Array
    information: Array
    gradients: Array

    @property
    def lens(self) -> Array:
        """The lens (10,)."""
        return self.common[:LENS_SIZE]

    @property
    def cost(self) -> float:
        """The sum of the squared errors, each truncated at the limit, px²."""
        return self.cost_within(self.limit)

    def cost_within(self, limit: float) -> float:
        """Return the cost with another limit, px²."""
        return float(np.minimum(self.squares, limit).sum())

    @property
    def rms_px(self) -> float:
        """Root mean square distance between the inliers and their reprojections."""
        inliers = self.squares[self.squares < self.limit]
        return math.sqrt(inliers.mean()) if inliers.size else math.nan

    @property
    def starts(self) -> Ints:
        """Start and end of each view's points in the squares, (V + 1,)."""
        return np.concatenate(
            [[0], np.cumsum([len(view.image) for view in self.views], dtype=np.int64)]
        )

    @property
    def free(self) -> Ints:
        """The places of the estimated common parameters."""
        return self.terms.with_boards(number_of_shapes(self.boards))

    def without(self, v: int) -> JointFit:
        """Return the fit without a view; nothing is fitted again."""
        keep = np.arange(len(self.views)) != v
        first, last = self.starts[v : v + 2]
        return replace(
            self,
            views=(*self.views[:v], *self.views[v + 1 :]),
            poses=self.poses[keep],
            squares=np.delete(self.squares, np.arange(first, last)),
            information=self.information[keep],
            gradients=self.gradients[keep],
        )

    def lens_without(self, view: CenteredView) -> tuple[Array, Array]:
        """
        Return the lens (10,) and its covariance (10, 10) without what a view tells, if fitted.

        With them as its prior, the view is not counted twice. Of the considered parameters the
        covariance has the aspect ratio alone.
        """
        fitted = [v for v, other in enumerate(self.views) if other.view is view]
        known = np.union1d(self.terms.columns, [ASPECT])
        covariance = np.zeros((LENS_SIZE, LENS_SIZE))
        if not fitted:
            covariance[np.ix_(known, known)] = self.full_covariance[np.ix_(known, known)]
            return self.lens, covariance
        # The negative gradients of all views and the prior cancel: without g of this view the
        # step is -(T - S)⁻¹ g, T the information of all, and S of the view.
        free, at = self.free, common_places(self.views[fitted[0]].board)
        rest = self.equations[:, :-1].copy()
        rest[np.ix_(at, at)] -= self.information[fitted[0]]
        gradient = np.zeros(len(rest))
        gradient[at] = self.gradients[fitted[0]]
        lens = self.lens.copy()
        own = free < LENS_SIZE
        step = inverse_of_information(rest[np.ix_(free, free)]) @ gradient[free]
        # The cost is quadratic nearby only.
        share = min(1.0, _FARTHEST_FOCAL * lens[FOCAL] / max(abs(step[0]), 1e-300))
        lens[free[own]] -= share * step[own]
        inverse = inverse_of_information(rest)
        with np.errstate(all='ignore'):  # extreme numbers
            of_lens = self.posterior_variance * inverse[np.ix_(known, known)]
        covariance[np.ix_(known, known)] = np.nan_to_num(of_lens)
        return lens, covariance

    @cached_property
    def full_covariance(self) -> Array:
        """
        The second moment (C, C) of the errors of all common parameters.

        Considered parameters are zero in the fit, but may be anything that prior and views allow.
        With T = S + Λ, the information of views and prior about all parameters, their best
        estimate is a step δ = T⁻¹ g away, and the error about it has the covariance
        T⁻¹ (v S + σ² Λ) T⁻¹: v is the posterior variance, scatter included. About the fit the
        errors have δ δᵀ more. Marginalised views belong to S.
        """
        total, gradient = self.equations[:, :-1], self.equations[:, -1]
        inverse = inverse_of_information(total)
        of_noise = self.posterior_variance * (total - self.prior)
        # Not finite if the numbers are extreme.
        with np.errstate(all='ignore'):
            covariance = inverse @ (of_noise + self.variance * self.prior) @ inverse
            step = inverse @ gradient
            moment = covariance + np.outer(step, step)
            symmetric: Array = 0.5 * (moment + moment.T)
        return symmetric

    @property
    def covariance(self) -> Array:
        """The second moment (10, 10) of the errors of the lens."""
        return self.full_covariance[:LENS_SIZE, :LENS_SIZE]

    @cached_property
    def posterior_variance(self) -> float:
        """The variance that turns an inverse JᵀJ into a covariance, px²."""
        dof = self.dof if self.measured else 0
        return self.scatter * posterior_variance(self.variance, dof, self.limit)

    def shape(self, board: int) -> BoardShape:
        """Return the shape of a board."""
        at, frame = shape_slice(board), self.boards[board]
        covariance = self.full_covariance[at, at]
        return BoardShape(frame.center, frame.half_extent, self.common[at], covariance)


def gate_of(variance: float) -> float:
    """Return the squared error, px², beyond which a point is an outlier."""
    return max(_GATE_SIGMAS**2 * variance, _SMALLEST_GATE_PX**2)


def fit_of_prior(prior: CommonPrior, terms: FreeTerms, boards: tuple[BoardFrame, ...]) -> JointFit:
    """Return a fit without views: the prior."""
    variance = DEFAULT_SIGMA_PX**2
    count = number_of_shapes(boards)
    prior = prior.for_boards(count)
    focal_px = prior.reference[0] or prior.typical.focal_px
    weighted = prior.weighted(variance, focal_px, terms, count)
    step = inverse_of_information(weighted.information) @ weighted.gradient
    free = terms.with_boards(count)
    common = weighted.reference.copy()
    common[free] += step[free]
    return JointFit(
        views=(),
        common=common,
        terms=terms,
        boards=boards,
        poses=np.empty((0, POSE_SIZE)),
        squares=np.empty(0),
        limit=gate_of(variance),
        variance=variance,
        dof=0,
        measured=False,
        scatter=1.0,
        measured_scatter=1.0,
        equations=np.column_stack([weighted.information, np.zeros(len(common))]),
        prior=weighted.information,
        typical=variance * prior.typical.information(focal_px, terms, count),
        information=np.empty((0, VIEW_COMMON, VIEW_COMMON)),
        gradients=np.empty((0, VIEW_COMMON)),
    )


class Start(NamedTuple):
    """
    Where a fit starts: poses (V, 12), common parameters (≤ C,), and the frames of boards.

    limit: of the outliers of an earlier fit, px²; with about the same one it is a good start.
    """

    poses: Array
    common: Array
    boards: tuple[BoardFrame, ...]
    limit: float = 0.0


def fit_views(
    views: Sequence[BoardView],
    start: Start,
    terms: FreeTerms,
    prior: CommonPrior,
    sigma_px: float | None = None,
) -> JointFit:
    """
    Fit one lens and the shapes of the boards to the views.

    sigma_px: the standard deviation of a coordinate; None: it is measured.
    """
    count = number_of_shapes(start.boards)
    points, poses = stacked_views(views), start.poses.copy()
    common = np.zeros(LENS_SIZE + SHAPE_SIZE * count)
    common[: len(start.common)] = start.common
    fixed = np.setdiff1d(np.arange(LENS_SIZE), terms.columns)
    common[fixed] = 0.0
    focal_px = float(common[0])
    squares = np.empty(len(points.image))
    work = adjustment_work(len(views), len(common))
    free = terms.with_boards(count)
    unknowns = POSE_COLUMNS * len(views) + len(terms.columns)
    variance, limit = 0.0, start.limit
    for steps, tolerance in _ROUNDS:
        squared_errors(points, poses, common, squares)
        variance = sigma_px**2 if sigma_px else _median_variance(squares, unknowns)
        if abs(gate_of(variance) - limit) < _SAME_GATE * limit:
            variance, tolerance = limit / _GATE_SIGMAS**2, _ROUNDS[-1][1]
        limit = gate_of(variance)
        weighted = prior.weighted(variance, focal_px, terms, count)
        adjust(points, poses, common, free, weighted, limit, steps, tolerance, work)
        if tolerance == _ROUNDS[-1][1]:
            break
    fitted = _Fitted(tuple(views), points, common, terms, start.boards, poses, limit, work)
    return _result_of(fitted, prior, variance, focal_px, measured=sigma_px is None)


class _Fitted(NamedTuple):
    """The outcome of the adjustment, and its workspace."""

    views: tuple[BoardView, ...]
    points: StackedViews
    common: Array
    terms: FreeTerms
    boards: tuple[BoardFrame, ...]
    poses: Array
    limit: float
    work: AdjustmentWork


def _result_of(
    fitted: _Fitted, prior: CommonPrior, variance: float, focal_px: float, measured: bool
) -> JointFit:
    """Measure the noise, unless it is given, and make the result."""
    views, points, common, terms, boards, poses, limit, work = fitted
    squares = np.empty(len(points.image))
    squared_errors(points, poses, common, squares)
    inlier = squares < limit
    dof = 2 * int(inlier.sum()) - POSE_COLUMNS * len(views) - len(terms.columns)
    measured = measured and dof >= _MIN_DOF
    given, count = variance, number_of_shapes(boards)
    if measured:
        variance = noise_variance(float(squares[inlier].sum()), dof, limit)
    unit = prior.weighted(1.0, focal_px, terms, count)
    of_prior = variance * (unit.information - prior.for_boards(count).marginalised)
    of_view = work.of_view.copy()
    fit = JointFit(
        views=views,
        common=common,
        terms=terms,
        boards=boards,
        poses=poses,
        squares=squares,
        limit=limit,
        variance=variance,
        dof=dof,
        measured=measured,
        scatter=1.0,
        measured_scatter=1.0,
        equations=_with_variance(work.reduced, unit, common, variance - given),
        prior=of_prior,
        typical=variance * prior.typical.information(focal_px, terms, count),
        information=of_view[:, :, :VIEW_COMMON],
        gradients=of_view[:, :, VIEW_COMMON],
    )
    if not measured:
        return fit
    scatter, measured_scatter = _scatter(fit, prior.scatter), _scatter(fit, _NO_SCATTER)
    return replace(fit, scatter=scatter, measured_scatter=measured_scatter)


def _with_variance(equations: Array, unit: WeightedPrior, common: Array, more: float) -> Array:
    """Return equations (C, C + 1) whose prior has this much more of the noise variance, px²."""
    result = equations.copy()
    result[:, :-1] += more * unit.information
    gradient = unit.gradient - unit.information @ (common - unit.reference)
    result[:, -1] += more * gradient
    return result


def _scatter(fit: JointFit, usual: tuple[float, float]) -> float:
    """Return the scatter of the views about the lens, board shapes held."""
    columns = fit.terms.columns
    at = np.ix_(columns, columns)
    total = fit.equations[at]
    return scatter_of(
        fit.information[:, columns[:, None], columns],
        fit.gradients[:, columns],
        fit.prior[at],
        total,
        fit.variance,
        usual,
    )


def _median_variance(squares: Array, unknowns: int) -> float:
    """Return the variance of a coordinate, px², from the median of the squared errors."""
    coordinates = 2 * len(squares)
    dof = coordinates - unknowns
    median = min(float(np.median(squares)), _LARGEST_SQUARE)
    variance = median / _MEDIAN_SQUARE * coordinates / max(dof, 1)
    return variance if dof >= _MIN_DOF else max(variance, DEFAULT_SIGMA_PX**2)


def scatter_of(
    information: Array,
    gradients: Array,
    prior: Array,
    total: Array,
    variance: float,
    usual: tuple[float, float] = _NO_SCATTER,
) -> float:
    """
    Return the chi-square per degree of freedom of the views' lenses, at least 1.

    information (V, n, n) and gradients (V, n) are the views' equations for the lens at their
    common optimum, prior (n, n) the rest, total (n, n) the sum; px². usual: degrees of freedom and
    scatter that are added. An error that all points of a
    view share (a rolling shutter, a lens outside the model) hardly changes its residuals, but
    shifts the lens that this view alone would have.
    """
    # One view alone would move the lens by (S + Λ)⁻¹ g: S and g are its information and gradient,
    # Λ is the prior's information. At the common optimum g has the covariance σ² (S - S T⁻¹ S),
    # T the total.
    alone = np.linalg.inv(information + prior)
    expected = information - information @ inverse_of_information(total) @ information
    squares = np.einsum('va,vab,vb->', gradients, alone, gradients) / variance
    freedom = np.einsum('vab,vba->', alone, expected)
    more, scatter = usual
    return max(1.0, float((more * scatter + squares) / (more + freedom)))


def keyframes_of(fit: JointFit) -> tuple[Keyframe, ...]:
    """Return the views of a fit with their poses and residuals."""
    camera = camera_from_lens(fit.lens, fit.views[0].view.center_px) if fit.views else None
    return tuple(
        _keyframe(view, row, camera, fit)
        for view, row in zip(fit.views, fit.poses, strict=True)
        if camera is not None
    )


def _keyframe(view: BoardView, row: Array, camera: DivisionCamera, fit: JointFit) -> Keyframe:
    observation = view.observation
    pose = observation.pose_from_row(row)
    points = view.shaped(fit.common).points_on_board
    residuals_px = camera.project(pose.transform(points)) - observation.image_points
    squares = np.sum(residuals_px**2, axis=1)
    inliers = squares < fit.limit
    return Keyframe(
        image_points=observation.image_points,
        board_points=observation.board_points,
        camera_from_board=pose,
        inliers=inliers,
        residuals_px=residuals_px,
        rms_px=math.sqrt(squares[inliers].mean()) if inliers.any() else math.nan,
        stamp=observation.stamp,
        board=view.name,
    )
