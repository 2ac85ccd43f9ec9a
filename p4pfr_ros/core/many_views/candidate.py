# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""A new view before it is used: by the camera of the other views, and by a camera of its own."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from .bundle_adjustment import squared_errors
from .joint_fit import fit_views, JointFit, stacked_views
from .view_by_fit import estimate_by_fit, view_by_fit, ViewByFit
from ..cameras.division import DivisionCamera
from ..geometry import Array
from ..model.lens import CX, CY, lens_from_camera
from ..model.observation import CenteredView
from ..model.prior import LensPrior
from ..one_view.estimate_pose import estimate_observation
from ..one_view.results import EstimateOptions, PoseEstimate

# A view agrees without further tests if this share of its points are inliers, and their squares
# are no more than this multiple of the noise.
_INLIER_RATIO = 0.85
_SQUARES = 1.5

# Two estimates of one camera cost more together than apart by χ² of its parameters, in variances
# of the noise and of the views' scatter: more than thirty is no chance. No lens is exactly in the
# model, so a view's squares may also grow by a quarter of the noise in each coordinate.
_NO_CHANCE = 30.0
_MODEL_SHARE = 0.5  # of a variance, for each point


def disagrees(excess: float, points: int, fit: JointFit) -> bool:
    """Return whether the excess cost, px², of a view by the fit's camera is more than chance."""
    return excess > (_NO_CHANCE * fit.scatter + _MODEL_SHARE * points) * fit.variance


@dataclass(frozen=True, eq=False)
class Candidate:
    """A view, and the fit of the others with its camera. Properties are computed on demand."""

    view: CenteredView
    fit: JointFit
    camera: DivisionCamera
    image_size: tuple[int, int]
    robust: EstimateOptions

    @cached_property
    def known(self) -> PoseEstimate:
        """The pose by the fit's camera."""
        return estimate_observation(self.view.observation, None, None, self.camera, self.robust)

    @cached_property
    def by_fit(self) -> ViewByFit | None:
        """The view by the fit's camera; None if that camera does not explain it."""
        if self.known.model is None:
            return None
        row = self.view.observation.row_from_pose(self.known.model.camera_from_board)
        return view_by_fit(self.view, row, self.fit)

    @cached_property
    def alone(self) -> PoseEstimate:
        """The estimate from the view alone, apart from the optical centre."""
        center_px = self.camera.center_px
        return estimate_observation(
            self.view.observation, self.image_size, center_px, None, self.robust
        )

    @cached_property
    def alone_row(self) -> Array | None:
        """The scaled board's pose (12,) from the view alone; None if there is none."""
        model = self.alone.model
        if model is None:
            return None
        return self.view.observation.row_from_pose(model.camera_from_board)

    @property
    def row(self) -> Array:
        """The pose (12,) by the fit's camera, or else from the view alone."""
        row = self.alone_row if self.by_fit is None else self.by_fit.row
        assert row is not None, 'only for views that some camera explains'
        return row

    @cached_property
    def own_cost(self) -> float:
        """The cost of the view by a camera of its own, px², by the fit's limit; or infinite."""
        costs = [np.inf]
        model, row = self.alone.model, self.alone_row
        if model is not None and row is not None:
            lens = lens_from_camera(model.camera, self.view.center_px)
            squares = np.empty(len(self.view))
            squared_errors(stacked_views([self.view]), row[None], lens, squares)
            costs.append(float(np.minimum(squares, self.fit.limit).sum()))
        if self.by_fit is not None:
            costs.append(self.by_fit.cost)
        return min(costs)

    @property
    def explained(self) -> bool:
        """Whether any camera explains the view."""
        return self.by_fit is not None or self.alone.model is not None

    @property
    def known_or_alone(self) -> PoseEstimate:
        """The estimate by the fit's camera, or else from the view alone."""
        return self.alone if self.known.model is None else self.known

    @cached_property
    def agrees(self) -> bool:
        """Whether the fit's camera explains the view as well as any camera does."""
        by_fit, fit = self.by_fit, self.fit
        if by_fit is None:
            return False
        many = by_fit.inliers >= _INLIER_RATIO * len(self.view)
        if many and by_fit.inlier_squares <= _SQUARES * 2.0 * fit.variance * by_fit.inliers:
            return True
        return not disagrees(by_fit.cost - self.own_cost, len(self.view), fit)

    def estimate_alone(self, typical: LensPrior) -> PoseEstimate:
        """
        Estimate from the view alone, with an uncertain optical centre.

        Four points are too few to estimate a centre; their result is ``alone``.
        """
        alone, row, view = self.alone, self.alone_row, self.view
        if alone.model is None or row is None or len(view) == 4:
            return alone
        mean = typical.mean.copy()
        mean[CX : CY + 1] = lens_from_camera(self.camera, view.center_px)[CX : CY + 1]
        prior = replace(typical, mean=mean)
        lens = lens_from_camera(alone.model.camera, view.center_px)
        fit = fit_views([view], row[None], lens, 1, prior, self.robust.sigma_px)
        by_fit = view_by_fit(view, fit.poses[0], fit)
        return estimate_by_fit(by_fit, alone, self.robust.threshold_px)
