# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""
The keyframes: whether a view is new, which view a new one replaces, and fits with a new view.

This module stands alone because it has no state: ``SelfCalibration`` holds the camera and decides;
these functions compute what it decides between.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
import math
from typing import NamedTuple

import numpy as np

from .candidate import Candidate, disagrees, EvaluatedView
from .joint_fit import fit_views, JointFit, MAX_ORDER, needs_last_term, requires_next_term
from ..cameras.division import DivisionCamera
from ..geometry import Array, Pose, POSE_SIZE, TRANSLATION
from ..jit import jit, kernel
from ..linalg import inverse_of_information
from ..model.lens import closed_form, FOCAL, K, lens_from_camera
from ..model.observation import CenteredView, Observation
from ..model.prior import LensPrior
from ..one_view.estimate_pose import estimate_observation
from ..one_view.results import EstimateOptions, PoseEstimate, without_deviations

# Smallest rise of the information's log-determinant for a view to replace another, and for a new
# fit with marginalised views. A fit may wait: their information is in the prior.
_WORTH_A_PLACE = 0.2
_WORTH_A_FIT = 0.4

# Relative standard deviation of the focal length below which a view determines it.
_DETERMINED = 0.3

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


def distance_to_views_px(
    board_points: Array, camera_from_board: Pose, others: Array, camera: DivisionCamera
) -> float:
    """
    Return the distance in the image of a view from the nearest of other poses, rms px.

    others are poses (V, 12), in board units. The distance is over the corners of the rectangle
    around the view's board points, so another board in the same place counts as the same view.
    """
    (left, bottom), (right, top) = board_points.min(axis=0), board_points.max(axis=0)
    corners = np.array([[left, bottom], [right, bottom], [right, top], [left, top]])
    poses = np.vstack(
        [np.append(camera_from_board.rotation, camera_from_board.translation), others]
    )
    if camera.k2 == 0.0 and camera.k3 == 0.0:
        return camera.focal_px * math.sqrt(_nearest(corners, poses, camera.k))
    rotations, places = poses[:, :TRANSLATION].reshape(-1, 3, 3), poses[:, TRANSLATION:]
    corners_px = camera.project(corners @ rotations[:, :, :2].transpose(0, 2, 1) + places[:, None])
    squares = np.sum((corners_px[1:] - corners_px[0]) ** 2, axis=-1).mean(axis=-1)
    # The distance of a corner that no pixel sees is infinite.
    return math.sqrt(np.nan_to_num(squares, nan=np.inf).min(initial=np.inf))


def poses_of(fit: JointFit) -> Array:
    """Return the poses (V, 12) of a fit's views, in board units."""
    rows = [
        unscaled_row(row, view.observation) for row, view in zip(fit.poses, fit.views, strict=True)
    ]
    return np.array(rows).reshape(-1, POSE_SIZE)


def unscaled_row(row: Array, observation: Observation) -> Array:
    """Return the pose (12,) in board units from that of the scaled board."""
    unscaled = row.copy()
    unscaled[TRANSLATION:] = observation.board_size * row[TRANSLATION:]
    unscaled[TRANSLATION:] -= row[:TRANSLATION].reshape(3, 3)[:, :2] @ observation.board_mean
    return unscaled


@jit
def _nearest(corners: Array, poses: Array, k: float) -> float:
    """
    Return the mean squared distance of the corners between the first pose and the nearest other.

    poses (V, 12); for a lens with one term, in squared focal lengths. Infinite if there is no
    other pose, or each has a corner that no pixel sees.
    """
    best = math.inf
    for v in range(1, len(poses)):
        total = 0.0
        for i in range(len(corners)):
            x, y = _project(poses[0], corners[i, 0], corners[i, 1], k)
            x_there, y_there = _project(poses[v], corners[i, 0], corners[i, 1], k)
            total += (x_there - x) ** 2 + (y_there - y) ** 2
        if total < best:
            best = total
    return best / len(corners)


@kernel
def _project(pose: Array, bx: float, by: float, k: float) -> tuple[float, float]:
    x = pose[0] * bx + pose[1] * by + pose[TRANSLATION]
    y = pose[3] * bx + pose[4] * by + pose[TRANSLATION + 1]
    z = pose[6] * bx + pose[7] * by + pose[TRANSLATION + 2]
    s = closed_form(z, k, x * x + y * y)
    return s * x, s * y


def least_informative(fit: JointFit, new: Array) -> int | None:
    """
    Return the index of the view to drop for a new one; None if the new one adds too little.

    new (6, 6), px²: the new view's information about the lens. The remaining views have the
    largest determinant of the information, that is, the smallest volume of uncertainty.
    """
    free = slice(K + fit.order)
    information = np.concatenate([fit.information, new[None]])[:, free, free]
    volumes = _log_volumes(fit.prior[free, free] + information.sum(axis=0) - information)
    best = int(np.argmax(volumes))
    return best if volumes[best] > volumes[-1] + _WORTH_A_PLACE else None


def is_worth_a_fit(fit: JointFit, information: Array) -> bool:
    """Return whether additional information (6, 6), px², is worth another fit."""
    free = slice(K + fit.order)
    before = fit.equations[free, free]
    before, after = _log_volumes(np.array([before, before + information[free, free]]))
    return bool(after > before + _WORTH_A_FIT)


def _log_volumes(information: Array) -> Array:
    """Return the logarithms of determinants (V,) of matrices (V, n, n), all in the same units."""
    size = np.sqrt(np.diag(information[0]))
    sign, volumes = np.linalg.slogdet(information / np.outer(size, size))
    positive: Array = np.where(sign > 0.0, volumes, -np.inf)
    return positive


def determines_focal(evaluated: EvaluatedView, typical: LensPrior) -> bool:
    """Return whether a view alone, with a typical camera's prior, determines the focal length."""
    fit = evaluated.fit
    information = evaluated.information + fit.variance * typical.information
    free = K + fit.order
    inverse = inverse_of_information(information[:free, :free])
    return bool(fit.variance * inverse[FOCAL, FOCAL] < (_DETERMINED * fit.lens[FOCAL]) ** 2)
