# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""The joint fit of one camera to many views, and what it says of itself."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
import math

import numpy as np

from .bundle_adjustment import (
    POSE_SIZE,
)
from ..geometry import Array, Ints
from ..model.calibration_view import CalibrationView
from ..model.lens import K, LENS_SIZE
from ..model.prior import inverse_of, Knowledge
from ..model.uncertainty import DEFAULT_SIGMA_PX, posterior_variance

# A point whose error is beyond this many standard deviations of a coordinate is an outlier: of
# normal errors three in ten thousand are. And no corner is that good, px.
_GATE_SIGMAS = 4.0
_SMALLEST_GATE_PX = 0.1


@dataclass(frozen=True, eq=False)
class JointFit:
    """
    One lens and the poses of all views.

    lens (6,); order, how many of k, k2, k3 are free; poses (V, 12); squares (M,), the squared
    errors of all points, px², and limit, beyond which one is an outlier's; variance of a
    coordinate, px², with the coordinates to spare, and whether it was measured by them; scatter,
    by how much the views differ over the lens, in units of what the noise explains (1 at least);
    equations (6, 7), the normal equations of the lens, with all that is known besides; prior
    (6, 6), what of that was known beforehand, px²; told (V, 6, 6) and pulls (V, 6), what each
    view adds to them: its information, and where it would have the lens go.
    """

    views: tuple[CalibrationView, ...]
    lens: Array
    order: int
    poses: Array
    squares: Array
    limit: float
    variance: float
    spare: int
    measured: bool
    scatter: float
    equations: Array
    prior: Array
    told: Array
    pulls: Array

    @property
    def cost(self) -> float:
        """The sum of the squared errors, each cut off at the limit, px²."""
        return self.cost_within(self.limit)

    def cost_within(self, limit: float) -> float:
        """Return the same with another limit, px²."""
        return float(np.minimum(self.squares, limit).sum())

    @property
    def rms_px(self) -> float:
        """Root of the mean squared distance between the inliers and their reprojections."""
        inliers = self.squares[self.squares < self.limit]
        return math.sqrt(inliers.mean()) if inliers.size else math.nan

    @property
    def starts(self) -> Ints:
        """Where each view's points begin and end in the squares, (V + 1,)."""
        return np.concatenate([[0], np.cumsum([len(view) for view in self.views], dtype=np.int64)])

    def without(self, v: int) -> JointFit:
        """Return what is left when a view is taken out: the same lens, not fitted again."""
        keep = np.arange(len(self.views)) != v
        first, last = self.starts[v : v + 2]
        return replace(
            self,
            views=tuple(view for view, kept in zip(self.views, keep, strict=True) if kept),
            poses=self.poses[keep],
            squares=np.delete(self.squares, np.arange(first, last)),
            told=self.told[keep],
            pulls=self.pulls[keep],
        )

    @cached_property
    def covariance(self) -> Array:
        """The lens's covariance (6, 6); zero for what is not free."""
        # With T = S + Λ, the views' information and the prior's (px²), the estimate is off by T⁻¹
        # times the pull of the noise, of covariance v S, and of the prior's own error, σ² Λ.
        # Remembered views are views.
        free = slice(K + self.order)
        inverse = inverse_of(self.equations[free, free])
        prior = self.prior[free, free]
        pulls = self.posterior_variance * (self.equations[free, free] - prior)
        covariance = np.zeros((LENS_SIZE, LENS_SIZE))
        covariance[free, free] = inverse @ (pulls + self.variance * prior) @ inverse
        return 0.5 * (covariance + covariance.T)

    @cached_property
    def posterior_variance(self) -> float:
        """The variance that turns an inverse JᵀJ into a covariance, px²."""
        spare = self.spare if self.measured else 0
        return self.scatter * posterior_variance(self.variance, spare, self.limit)


def unfitted(knowledge: Knowledge, order: int) -> JointFit:
    """Return the fit of no views at all: what is known beforehand."""
    variance = DEFAULT_SIGMA_PX**2
    information = knowledge.weighed(variance).information
    return JointFit(
        views=(),
        lens=knowledge.mean.copy(),
        order=order,
        poses=np.empty((0, POSE_SIZE)),
        squares=np.empty(0),
        limit=gate_of(variance),
        variance=variance,
        spare=0,
        measured=False,
        scatter=1.0,
        equations=np.column_stack([information, np.zeros(LENS_SIZE)]),
        prior=information,
        told=np.empty((0, LENS_SIZE, LENS_SIZE)),
        pulls=np.empty((0, LENS_SIZE)),
    )


def gate_of(variance: float) -> float:
    """Return the squared error, px², beyond which a point is an outlier."""
    return max(_GATE_SIGMAS**2 * variance, _SMALLEST_GATE_PX**2)
