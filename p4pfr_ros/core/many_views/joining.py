# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""
Trial fits: of all views with a new one, or of the views of a camera that has changed.

This module stands alone because it has no state: ``SelfCalibration`` holds the camera and decides;
these functions compute the fits to decide between.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import NamedTuple

import numpy as np

from .candidate import Candidate, disagrees
from .joint_fit import fit_views, JointFit, MAX_ORDER, needs_last_term, requires_next_term
from .selection import least_informative
from ..cameras.division import DivisionCamera
from ..geometry import Array
from ..model.lens import lens_from_camera
from ..model.observation import CenteredView
from ..model.prior import LensPrior
from ..one_view.estimate_pose import estimate_observation
from ..one_view.results import EstimateOptions, PoseEstimate, without_deviations

# With fewer degrees of freedom, another term would explain any disagreement.
_ENOUGH_FOR_A_TERM = 60

# A fit of fewer views may be a wrong optimum: the new view's solutions are tried as starts, too.
_FEW_VIEWS = 5

# Maximum number of solutions tried as starts; each view of four points has up to six.
_MOST_STARTS = 12


class Joined(NamedTuple):
    """A fit with the new view, and the prior with the view that it replaced, if any."""

    fit: JointFit
    prior: LensPrior


def with_view(candidate: Candidate, prior: LensPrior, max_views: int) -> Joined | None:
    """
    Fit the keyframes and a new view, which becomes the last.

    With more than max_views the least informative view is marginalised. Return None if the new
    view does not agree with the others, or is the least informative one.
    """
    fit = candidate.fit
    if len(fit.views) >= max_views:
        drop = (
            None
            if candidate.evaluated is None
            else least_informative(fit, candidate.evaluated.information)
        )
        if drop is None:
            return None
        prior = prior.marginalise(
            fit.information[drop], fit.gradients[drop], fit.lens, fit.variance
        )
        fit = fit.without(drop)
    trials = _joined(candidate, fit, prior)
    if len(fit.views) < _FEW_VIEWS and candidate.alone_row is not None:
        rows = [*fit.poses, candidate.alone_row]
        views, cameras = (*fit.views, candidate.view), cameras_of([candidate.alone])
        others = fits_from_cameras(views, rows, cameras, prior, candidate.robust)
        trials += [trial for trial in others if _agree(trial, fit, candidate)]
    if not trials:
        return None
    return Joined(with_lens_order(best_of(trials), prior, candidate.robust.sigma_px), prior)


def fit_candidates(candidates: Sequence[Candidate], prior: LensPrior) -> JointFit:
    """Fit a new camera to views that together disagree with the previous one."""
    robust = candidates[0].robust
    views = [candidate.view for candidate in candidates]
    rows = [candidate.row for candidate in candidates]
    cameras = cameras_of(candidate.alone for candidate in candidates)
    best = best_of(fits_from_cameras(views, rows, cameras, prior, robust))
    return with_lens_order(best, prior, robust.sigma_px)


def with_lens_order(fit: JointFit, prior: LensPrior, sigma_px: float | None) -> JointFit:
    """Fit again with the number of lens terms that the data require."""
    if not needs_last_term(fit):
        return fit_views(fit.views, fit.poses, fit.lens, fit.order - 1, prior, sigma_px)
    while fit.dof >= _ENOUGH_FOR_A_TERM and requires_next_term(fit):
        fit = fit_views(fit.views, fit.poses, fit.lens, fit.order + 1, prior, sigma_px)
    return fit


def _joined(candidate: Candidate, fit: JointFit, prior: LensPrior) -> list[JointFit]:
    """Fit all views, starting from the current fit; try further terms until the views agree."""
    sigma_px = candidate.robust.sigma_px
    views, poses = (*fit.views, candidate.view), np.vstack([fit.poses, candidate.row])
    for order in range(fit.order, MAX_ORDER + 1):
        trial = fit_views(views, poses, fit.lens, order, prior, sigma_px)
        if _agree(trial, fit, candidate):
            return [trial]
        if trial.dof < _ENOUGH_FOR_A_TERM:
            break
    return []


def _agree(trial: JointFit, fit: JointFit, candidate: Candidate) -> bool:
    """Return whether the trial fit costs little more than separate fits of view and others."""
    if candidate.agrees:
        return True
    excess = trial.cost_within(fit.limit) - fit.cost - candidate.own_cost
    return not disagrees(excess, len(candidate.view.image), fit)


def cameras_of(estimates: Iterable[PoseEstimate]) -> list[DivisionCamera]:
    """Return the cameras of estimates and of their alternatives."""
    solutions = [s for e in estimates if e.model for s in (e.model, *e.alternatives)]
    return [solution.camera for solution in solutions[:_MOST_STARTS]]


def fits_from_cameras(
    views: Sequence[CenteredView],
    rows: Sequence[Array],
    cameras: Iterable[DivisionCamera],
    prior: LensPrior,
    options: EstimateOptions,
) -> list[JointFit]:
    """
    Fit all views, starting from each of the cameras.

    Several starts are needed because a start from few views may lead to a wrong optimum. rows: a
    pose (12,) of each view, used if a camera gives none.
    """
    fits, middle_px = [], views[0].center_px
    for camera in cameras:
        poses = [
            _row_with_camera(view, row, camera, options)
            for view, row in zip(views, rows, strict=True)
        ]
        lens = lens_from_camera(camera, middle_px)
        fits.append(fit_views(views, np.array(poses), lens, 1, prior, options.sigma_px))
    return fits


def best_of(fits: Sequence[JointFit]) -> JointFit:
    """Return the fit with the smallest cost, all truncated at the widest of their limits."""
    limit = max(fit.limit for fit in fits)
    return min(fits, key=lambda fit: fit.cost_within(limit))


def _row_with_camera(
    view: CenteredView, row: Array, camera: DivisionCamera, options: EstimateOptions
) -> Array:
    """Return the pose (12,) of a view with a known camera, or else the given row."""
    options = without_deviations(options)
    estimate = estimate_observation(view.observation, None, None, camera, options)
    if estimate.model is None:
        return row
    return view.observation.row_from_pose(estimate.model.camera_from_board)
