# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""A new view, looked at twice: through the camera of the others, and by itself."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from .bundle import squared_errors
from .joint_fit import JointFit
from .view_by_fit import seen_by_fit, SeenByFit
from ..cameras.division import DivisionCamera
from ..geometry import Array
from ..model.calibration_view import bundle_of, CalibrationView, lens_of
from ..one_view.estimate_pose import estimate_pose
from ..one_view.results import EstimateOptions, PoseEstimate

# A view is beyond doubt where so many of its points are inliers, and their squares are no more
# than so many times what the noise's are.
_INLIER_SHARE = 0.85
_SQUARES = 1.5

# Two estimates of one camera, put together, cost more than apart by χ² of its parameters, in
# variances of the noise and of the views' scatter: thirty is beyond chance. No lens is quite of
# the model, so the squares of a view's coordinates may grow by a quarter of the noise's besides.
_BEYOND_CHANCE = 30.0
_MODEL_SHARE = 0.5  # of a variance, for each point


def disagrees(excess: float, points: int, fit: JointFit) -> bool:
    """Say whether a view costs too much more, px², by the fit's camera than by one of its own."""
    return excess > (_BEYOND_CHANCE * fit.scatter + _MODEL_SHARE * points) * fit.variance


@dataclass(frozen=True, eq=False)
class Sighting:
    """A view, and the fit of the others with its camera; what is not asked is not computed."""

    view: CalibrationView
    fit: JointFit
    camera: DivisionCamera
    image_size: tuple[int, int]
    robust: EstimateOptions

    @cached_property
    def known(self) -> PoseEstimate:
        """The pose by the fit's camera."""
        view = self.view
        return estimate_pose(
            view.image_points, view.board_points, camera=self.camera, options=self.robust
        )

    @cached_property
    def by_fit(self) -> SeenByFit | None:
        """The view through the fit's camera; None where that does not explain it at all."""
        if self.known.model is None:
            return None
        row = self.view.row_from_pose(self.known.model.camera_from_board)
        return seen_by_fit(self.view, row, self.fit)

    @cached_property
    def alone(self) -> PoseEstimate:
        """The estimate from the view alone, but for the optical centre."""
        view = self.view
        return estimate_pose(
            view.image_points,
            view.board_points,
            image_size=self.image_size,
            center_px=self.camera.center_px,
            options=self.robust,
        )

    @cached_property
    def alone_row(self) -> Array | None:
        """The pose (12,) of the scaled board from the view alone, where there is one."""
        model = self.alone.model
        return None if model is None else self.view.row_from_pose(model.camera_from_board)

    @property
    def row(self) -> Array:
        """The pose (12,) by the fit's camera, or where that has none, by the view alone."""
        row = self.alone_row if self.by_fit is None else self.by_fit.row
        assert row is not None, 'nobody asks where no camera explains the view'
        return row

    @cached_property
    def own_cost(self) -> float:
        """What the view costs by a camera of its own, px², by the fit's limit; infinite: none."""
        costs = [np.inf]
        model, row = self.alone.model, self.alone_row
        if model is not None and row is not None:
            lens = lens_of(model.camera, self.view.scaled.center_px)
            squares = np.empty(len(self.view))
            squared_errors(bundle_of([self.view]), row[None], lens, squares)
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
        """The estimate by the fit's camera; where that has none, by the view alone."""
        return self.alone if self.known.model is None else self.known

    @cached_property
    def agrees(self) -> bool:
        """Whether the fit's camera explains the view, as well as any does."""
        seen, fit = self.by_fit, self.fit
        if seen is None:
            return False
        many = seen.inliers >= _INLIER_SHARE * len(self.view)
        if many and seen.inlier_squares <= _SQUARES * 2.0 * fit.variance * seen.inliers:
            return True
        return not disagrees(seen.cost - self.own_cost, len(self.view), fit)
