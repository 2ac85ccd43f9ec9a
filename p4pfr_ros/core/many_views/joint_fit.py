# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""``JointFit``: one lens fitted to many views; its noise, covariance and statistical tests."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
import math
from typing import NamedTuple

import numpy as np

from .bundle_adjustment import (
    adjust,
    adjustment_work,
    AdjustmentWork,
    fill_blocks,
    lens_equations,
    squared_errors,
    StackedViews,
    view_equations,
)
from .results import Keyframe
from ..cameras.division import DivisionCamera
from ..geometry import Array, Ints, POSE_SIZE
from ..linalg import inverse_of_information
from ..model.lens import camera_from_lens, K, LENS_SIZE, POSE_COLUMNS
from ..model.observation import CenteredView
from ..model.prior import LensPrior, WeightedPrior
from ..model.uncertainty import DEFAULT_SIGMA_PX, noise_variance, posterior_variance

# Points beyond this many standard deviations of a coordinate (0.03 % of normal errors) are
# outliers, but no points within the second limit, px.
_GATE_SIGMAS = 4.0
_SMALLEST_GATE_PX = 0.1

# Additional degrees of freedom with a scatter of 1: few views do not measure it.
_SCATTER_FREEDOM = 4.0

# The median of the squared length of a normal error is 2 ln 2 variances of a coordinate.
_MEDIAN_SQUARE = 2.0 * math.log(2.0)

# Upper limit of the median, px²: it is infinite if most points are not visible.
_LARGEST_SQUARE = 1e6

# With fewer degrees of freedom the residuals do not measure the noise.
_MIN_DOF = 20

# Each round measures the noise for its gate and adjusts: maximum number of steps, tolerance.
_ROUNDS = ((20, 1e-2), (10, 1e-4), (20, 1e-7))

# Lenses have one to three terms.
MAX_ORDER = 3

# χ² above which a term is freed, and below which it is fixed again: five and three standard
# deviations, since the test is repeated at each view and residuals are not exactly normal.
_FREED = 25.0
_FIXED = 9.0


@dataclass(frozen=True, eq=False)
class JointFit:
    """
    One lens and the poses of all views.

    lens (6,)
    order: number of free terms of k, k2, k3
    poses (V, 12) of the scaled boards
    squares (M,): squared errors of all points, px²; limit: points beyond it are outliers, px²
    variance of a coordinate, px²; dof: degrees of freedom; measured: whether from the residuals
    scatter: chi-square per degree of freedom of the views' lenses, at least 1
    equations (6, 7): normal equations of the lens: views, prior and marginalised views, px²
    prior (6, 6): information in them that is from the prior, not from marginalised views, px²
    information (V, 6, 6), gradients (V, 6): information and negative gradient of each view, px²
    """

    views: tuple[CenteredView, ...]
    lens: Array
    order: int
    poses: Array
    squares: Array
    limit: float
    variance: float
    dof: int
    measured: bool
    scatter: float
    equations: Array
    prior: Array
    information: Array
    gradients: Array

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

    def without(self, v: int) -> JointFit:
        """Return the fit without a view; the lens is not fitted again."""
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
        Return the lens (6,) and its covariance (6, 6) without what a view tells, if it is fitted.

        With them as its prior, the view is not counted twice.
        """
        fitted = [v for v, other in enumerate(self.views) if other is view]
        if not fitted:
            return self.lens, self.covariance
        # The negative gradients of all views and the prior cancel: without g of this view the
        # step is -(T - S)⁻¹ g, T the information of all, and S of the view.
        free = slice(K + self.order)
        rest = self.equations[free, free] - self.information[fitted[0]][free, free]
        inverse = inverse_of_information(rest)
        lens, covariance = self.lens.copy(), np.zeros((LENS_SIZE, LENS_SIZE))
        lens[free] -= inverse @ self.gradients[fitted[0]][free]
        covariance[free, free] = self.posterior_variance * inverse
        return lens, covariance

    @cached_property
    def covariance(self) -> Array:
        """The covariance (6, 6) of the lens; zero for fixed terms."""
        # With T = S + Λ, the information of the views and of the prior (px²), the error is T⁻¹ g.
        # Its gradient g has the covariance v S from the noise plus σ² Λ from the error of the
        # prior: v is the posterior variance. Marginalised views belong to S.
        free = slice(K + self.order)
        inverse = inverse_of_information(self.equations[free, free])
        prior = self.prior[free, free]
        of_noise = self.posterior_variance * (self.equations[free, free] - prior)
        covariance = np.zeros((LENS_SIZE, LENS_SIZE))
        covariance[free, free] = inverse @ (of_noise + self.variance * prior) @ inverse
        return 0.5 * (covariance + covariance.T)

    @cached_property
    def posterior_variance(self) -> float:
        """The variance that turns an inverse JᵀJ into a covariance, px²."""
        dof = self.dof if self.measured else 0
        return self.scatter * posterior_variance(self.variance, dof, self.limit)


def gate_of(variance: float) -> float:
    """Return the squared error, px², beyond which a point is an outlier."""
    return max(_GATE_SIGMAS**2 * variance, _SMALLEST_GATE_PX**2)


def fit_of_prior(prior: LensPrior, order: int) -> JointFit:
    """Return a fit without views: the prior."""
    variance = DEFAULT_SIGMA_PX**2
    information = variance * prior.information
    return JointFit(
        views=(),
        lens=prior.mean.copy(),
        order=order,
        poses=np.empty((0, POSE_SIZE)),
        squares=np.empty(0),
        limit=gate_of(variance),
        variance=variance,
        dof=0,
        measured=False,
        scatter=1.0,
        equations=np.column_stack([information, np.zeros(LENS_SIZE)]),
        prior=information,
        information=np.empty((0, LENS_SIZE, LENS_SIZE)),
        gradients=np.empty((0, LENS_SIZE)),
    )


def fit_views(
    views: Sequence[CenteredView],
    poses: Array,
    lens: Array,
    order: int,
    prior: LensPrior,
    sigma_px: float | None = None,
) -> JointFit:
    """
    Fit one lens to the views, starting from poses (V, 12) and lens (6,).

    sigma_px: the standard deviation of a coordinate; None: it is measured.
    """
    points = stacked_views(views)
    poses, lens = poses.copy(), lens.copy()
    lens[K + order :] = 0.0
    squares = np.empty(len(points.image))
    work = adjustment_work(len(views))
    unknowns = POSE_COLUMNS * len(views) + K + order
    variance = limit = 0.0
    for steps, tolerance in _ROUNDS:
        squared_errors(points, poses, lens, squares)
        variance = sigma_px**2 if sigma_px else _median_variance(squares, unknowns)
        limit = gate_of(variance)
        weighted = WeightedPrior(prior.mean, variance * prior.information)
        adjust(points, poses, lens, order, weighted, limit, steps, tolerance, work)
    fitted = _Fitted(tuple(views), points, lens, order, poses, limit, variance, work)
    return _result_of(fitted, prior, measured=sigma_px is None)


class _Fitted(NamedTuple):
    """The outcome of the adjustment, and its workspace."""

    views: tuple[CenteredView, ...]
    points: StackedViews
    lens: Array
    order: int
    poses: Array
    limit: float
    variance: float
    work: AdjustmentWork


def _result_of(fitted: _Fitted, prior: LensPrior, measured: bool) -> JointFit:
    """Measure the noise, unless it is given, linearise at the optimum, and make the result."""
    views, points, lens, order, poses, limit, variance, work = fitted
    squares = np.empty(len(points.image))
    squared_errors(points, poses, lens, squares)
    inlier = squares < limit
    dof = 2 * int(inlier.sum()) - POSE_COLUMNS * len(views) - K - order
    measured = measured and dof >= _MIN_DOF
    if measured:
        variance = noise_variance(float(squares[inlier].sum()), dof, limit)
    equations = np.empty((len(views), LENS_SIZE, LENS_SIZE + 1))
    weighted = WeightedPrior(prior.mean, variance * prior.information)
    fill_blocks(points, poses, lens, limit, work)
    view_equations(len(views), work, equations)
    lens_equations(len(views), lens, weighted, 0.0, work)
    free, scatter = slice(K + order), 1.0
    if measured:
        scatter = scatter_of(
            equations[:, free, free],
            equations[:, free, LENS_SIZE],
            weighted.information[free, free],
            work.reduced[free, free],
            variance,
        )
    return JointFit(
        views=views,
        lens=lens,
        order=order,
        poses=poses,
        squares=squares,
        limit=limit,
        variance=variance,
        dof=dof,
        measured=measured,
        scatter=scatter,
        equations=work.reduced,
        prior=variance * (prior.information - prior.marginalised),
        information=equations[:, :, :LENS_SIZE],
        gradients=equations[:, :, LENS_SIZE],
    )


def _median_variance(squares: Array, unknowns: int) -> float:
    """Return the variance of a coordinate, px², from the median of the squared errors."""
    coordinates = 2 * len(squares)
    dof = coordinates - unknowns
    median = min(float(np.median(squares)), _LARGEST_SQUARE)
    variance = median / _MEDIAN_SQUARE * coordinates / max(dof, 1)
    return variance if dof >= _MIN_DOF else max(variance, DEFAULT_SIGMA_PX**2)


def stacked_views(views: Sequence[CenteredView]) -> StackedViews:
    """Stack the points of views, one view after the other."""
    if len(views) == 1:
        [view] = views
        return StackedViews(view.image, view.board, np.array([0, len(view.image)]))
    starts = np.zeros(len(views) + 1, dtype=np.int64)
    np.cumsum([len(view.image) for view in views], out=starts[1:])
    return StackedViews(
        np.concatenate([view.image for view in views]),
        np.concatenate([view.board for view in views]),
        starts,
    )


def scatter_of(
    information: Array, gradients: Array, prior: Array, total: Array, variance: float
) -> float:
    """
    Return the chi-square per degree of freedom of the views' lenses, at least 1.

    information (V, n, n) and gradients (V, n) are the views' equations for the lens at their
    common optimum, prior (n, n) the rest, total (n, n) the sum; px². An error that all points of a
    view share (a bent board, a lens outside the model) hardly changes its residuals, but shifts
    the lens that this view alone would have.
    """
    # One view alone would move the lens by (S + Λ)⁻¹ g: S and g are its information and gradient,
    # Λ is the prior's information. At the common optimum g has the covariance σ² (S - S T⁻¹ S),
    # T the total.
    alone = np.linalg.inv(information + prior)
    expected = information - information @ inverse_of_information(total) @ information
    squares = np.einsum('va,vab,vb->', gradients, alone, gradients) / variance
    freedom = np.einsum('vab,vba->', alone, expected)
    return max(1.0, float((_SCATTER_FREEDOM + squares) / (_SCATTER_FREEDOM + freedom)))


def requires_next_term(fit: JointFit) -> bool:
    """
    Return whether the residuals require the next term: Rao's score test, which needs no fit.

    If the true value of the next term is zero, its gradient after elimination of the free terms is
    normal with the variance of its information. The square over that variance is χ² with one
    degree of freedom.
    """
    free = K + fit.order
    if fit.order == MAX_ORDER:
        return False
    information, gradient = fit.equations[:, :LENS_SIZE], fit.equations[:, LENS_SIZE]
    by_free = np.linalg.solve(information[:free, :free], information[:free, free])
    information_after = information[free, free] - by_free @ information[:free, free]
    gradient_after = gradient[free] - by_free @ gradient[:free]
    return bool(gradient_after**2 > _FREED * information_after * fit.variance)


def needs_last_term(fit: JointFit) -> bool:
    """Return whether the last free term differs significantly from zero."""
    last = K + fit.order - 1
    return fit.order == 1 or bool(fit.lens[last] ** 2 > _FIXED * fit.covariance[last, last])


def keyframes_of(fit: JointFit) -> tuple[Keyframe, ...]:
    """Return the views of a fit with their poses and residuals."""
    camera = camera_from_lens(fit.lens, fit.views[0].center_px) if fit.views else None
    return tuple(
        _keyframe(view, row, camera, fit.limit)
        for view, row in zip(fit.views, fit.poses, strict=True)
        if camera is not None
    )


def _keyframe(view: CenteredView, row: Array, camera: DivisionCamera, limit: float) -> Keyframe:
    observation = view.observation
    pose = observation.pose_from_row(row)
    points = np.pad(observation.board_points, ((0, 0), (0, 1)))
    residuals_px = camera.project(pose.transform(points)) - observation.image_points
    squares = np.sum(residuals_px**2, axis=1)
    inliers = squares < limit
    return Keyframe(
        image_points=observation.image_points,
        board_points=observation.board_points,
        camera_from_board=pose,
        inliers=inliers,
        residuals_px=residuals_px,
        rms_px=math.sqrt(squares[inliers].mean()) if inliers.any() else math.nan,
        stamp=observation.stamp,
    )
