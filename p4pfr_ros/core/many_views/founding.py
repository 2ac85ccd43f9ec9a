# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""A camera from few views, where one start may lead to a wrong optimum: several are tried."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

import numpy as np

from .fit_views import fit_views
from .joint_fit import JointFit
from ..cameras.division import DivisionCamera
from ..geometry import Array
from ..model.calibration_view import CalibrationView, lens_of
from ..model.prior import Knowledge
from ..one_view.estimate_pose import estimate_pose
from ..one_view.results import EstimateOptions, PoseEstimate

# Four points have up to six solutions; of more views' solutions, the likeliest few.
_MOST_STARTS = 12


def cameras_of(estimates: Iterable[PoseEstimate]) -> list[DivisionCamera]:
    """Return the cameras of some views' estimates and their alternatives."""
    solutions = [s for e in estimates if e.model for s in (e.model, *e.alternatives)]
    return [solution.camera for solution in solutions[:_MOST_STARTS]]


def found(
    views: Sequence[CalibrationView],
    rows: Sequence[Array],
    cameras: Iterable[DivisionCamera],
    knowledge: Knowledge,
    options: EstimateOptions,
) -> list[JointFit]:
    """
    Fit all views, once from each camera.

    rows: a pose (12,) of each view, for where a camera has none for it.
    """
    fits, middle_px = [], views[0].scaled.center_px
    for camera in cameras:
        poses = [
            _row_by_camera(view, row, camera, options)
            for view, row in zip(views, rows, strict=True)
        ]
        lens = lens_of(camera, middle_px)
        fits.append(fit_views(views, np.array(poses), lens, 1, knowledge, options.sigma_px))
    return fits


def best_of(fits: Sequence[JointFit]) -> JointFit:
    """Return the fit with the smallest truncated cost, all by the widest of their limits."""
    limit = max(fit.limit for fit in fits)
    return min(fits, key=lambda fit: fit.cost_within(limit))


def _row_by_camera(
    view: CalibrationView, row: Array, camera: DivisionCamera, options: EstimateOptions
) -> Array:
    """Return the pose (12,) of a view by a camera; where there is none, the row."""
    estimate = estimate_pose(view.image_points, view.board_points, camera=camera, options=options)
    return row if estimate.model is None else view.row_from_pose(estimate.model.camera_from_board)
