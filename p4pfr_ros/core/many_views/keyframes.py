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

from .board_views import (
    board_view,
    BoardFrame,
    BoardView,
    MAX_BOARDS,
    number_of_shapes,
    place_of,
)
from .candidate import Candidate, disagrees, EvaluatedView
from .joint_fit import fit_views, JointFit, Start
from .lens_terms import ENOUGH_FOR_A_TERM, with_lens_terms
from ..cameras.division import DivisionCamera
from ..geometry import Array, Pose, POSE_SIZE, TRANSLATION
from ..jit import jit, kernel
from ..linalg import inverse_of_information
from ..model.board_shape import SHAPE_SIZE
from ..model.lens import FOCAL, lens_from_camera, LENS_SIZE, one_term_scale
from ..model.observation import Observation
from ..model.prior import (
    common_places,
    CommonPrior,
    FreeTerms,
    MAX_ORDER,
    shape_slice,
    TypicalCamera,
)
from ..one_view.estimate_pose import estimate_observation
from ..one_view.results import EstimateOptions, PoseEstimate, without_deviations

# Smallest rise of the information's log-determinant for a view to replace another, and for a new
# fit with marginalised views. A fit may wait: their information is in the prior.
_WORTH_A_PLACE = 0.2
_WORTH_A_FIT = 0.4

# Relative standard deviation of the focal length below which a view determines it.
_DETERMINED = 0.3

# A fit of fewer views may be a wrong optimum: the new view's solutions are tried as starts, too.
_FEW_VIEWS = 5

# Maximum number of solutions tried as starts; each view of four points has up to six.
_MOST_STARTS = 12


class Joined(NamedTuple):
    """A fit with the new view, and the prior with the view that it replaced, if any."""

    fit: JointFit
    prior: CommonPrior


def with_view(candidate: Candidate, prior: CommonPrior, max_views: int) -> Joined | None:
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
        prior = marginalised(
            prior, fit, fit.views[drop], fit.information[drop], fit.gradients[drop]
        )
        fit = fit.without(drop)
    boards, prior, common = _with_board(candidate, fit, prior)
    views = [*fit.views, board_view(candidate.view, candidate.board, boards)]
    if any(old is not new for old, new in zip(fit.boards, boards, strict=False)):
        views = [board_view(view.view, view.name, boards) for view in views]
    trials = _joined(candidate, fit, views, Start(fit.poses, common, boards, fit.limit), prior)
    if len(fit.views) < _FEW_VIEWS and candidate.alone_row is not None:
        rows, cameras = [*fit.poses, candidate.alone_row], cameras_of([candidate.alone])
        for terms in (FreeTerms(), FreeTerms(imperfect=True)):
            others = fits_from_cameras(
                views, rows, cameras, boards, terms, prior, candidate.robust
            )
            trials += [trial for trial in others if _agree(trial, fit, candidate)]
            if trials:
                break
    if not trials:
        return None
    return Joined(with_lens_terms(best_of(trials), prior, candidate.robust.sigma_px), prior)


def marginalised(
    prior: CommonPrior, fit: JointFit, view: BoardView, information: Array, gradient: Array
) -> CommonPrior:
    """Return the prior with the information (18, 18) and gradient (18,) of a view, at a fit."""
    prior = prior.for_boards(number_of_shapes(fit.boards))
    at = common_places(view.board)
    return prior.marginalise(information, gradient, fit.common, fit.variance, at)


def _with_board(
    candidate: Candidate, fit: JointFit, prior: CommonPrior
) -> tuple[tuple[BoardFrame, ...], CommonPrior, Array]:
    """
    Return the frames of boards with that of a new view's, and the prior and the start for them.

    A board that reaches beyond its frame gets a larger one; the shape in the old one is dropped.
    """
    points, boards = candidate.view.observation.board_points, fit.boards
    place = place_of(candidate.board, boards)
    common = np.zeros(LENS_SIZE + SHAPE_SIZE * number_of_shapes(boards))
    common[: len(fit.common)] = fit.common
    if place is None:
        if len(boards) < MAX_BOARDS:
            boards = (*boards, BoardFrame.of(candidate.board, points))
    elif not boards[place].covers(points) and boards[place].may_reach(points):
        wider = boards[place].with_points(points)
        boards = (*boards[:place], wider, *boards[place + 1 :])
        prior = prior.without_board(place)
        common[shape_slice(place)] = 0.0
    return boards, prior, common


def fit_candidates(candidates: Sequence[Candidate], prior: CommonPrior) -> JointFit:
    """Fit a new camera to views that together disagree with the previous one."""
    robust, boards = candidates[0].robust, candidates[0].fit.boards
    views = [board_view(candidate.view, candidate.board, boards) for candidate in candidates]
    rows = [candidate.row for candidate in candidates]
    cameras = cameras_of(candidate.alone for candidate in candidates)
    fits = fits_from_cameras(views, rows, cameras, boards, FreeTerms(), prior, robust)
    return with_lens_terms(best_of(fits), prior, robust.sigma_px)


def fit_boards(candidates: Sequence[Candidate], typical: TypicalCamera) -> JointFit:
    """Fit the same views with the previous camera, and boards of which nothing is known."""
    fit, robust = candidates[-1].fit, candidates[0].robust
    views = [board_view(candidate.view, candidate.board, fit.boards) for candidate in candidates]
    rows = np.array([candidate.row for candidate in candidates])
    prior = CommonPrior.of_calibration(typical, fit.lens, fit.covariance, len(fit.views))
    start = Start(rows, fit.common, fit.boards)
    return fit_views(views, start, fit.terms, prior, robust.sigma_px)


def _joined(
    candidate: Candidate,
    fit: JointFit,
    views: Sequence[BoardView],
    start: Start,
    prior: CommonPrior,
) -> list[JointFit]:
    """Fit all views, starting from the current fit; try further terms until the views agree."""
    start = start._replace(poses=np.vstack([start.poses, candidate.row]))
    for terms in _tried_terms(fit.terms):
        trial = fit_views(views, start, terms, prior, candidate.robust.sigma_px)
        if _agree(trial, fit, candidate):
            return [trial]
        if trial.dof < ENOUGH_FOR_A_TERM:
            break
    return []


def _tried_terms(terms: FreeTerms) -> list[FreeTerms]:
    """Return the terms that may explain a view that seems to disagree, the present ones first."""
    tried = [terms]
    if not terms.imperfect:
        tried.append(terms._replace(imperfect=True))
        tried.append(FreeTerms(MAX_ORDER, imperfect=True))
    return tried


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
    views: Sequence[BoardView],
    rows: Sequence[Array],
    cameras: Iterable[DivisionCamera],
    boards: tuple[BoardFrame, ...],
    terms: FreeTerms,
    prior: CommonPrior,
    options: EstimateOptions,
) -> list[JointFit]:
    """
    Fit all views, starting from each of the cameras.

    Several starts are needed because a start from few views may lead to a wrong optimum. rows: a
    pose (12,) of each view, used if a camera gives none.
    """
    fits, middle_px = [], views[0].view.center_px
    for camera in cameras:
        poses = [
            _row_with_camera(view, row, camera, options)
            for view, row in zip(views, rows, strict=True)
        ]
        start = Start(np.array(poses), lens_from_camera(camera, middle_px), boards)
        fits.append(fit_views(views, start, terms, prior, options.sigma_px))
    return fits


def best_of(fits: Sequence[JointFit]) -> JointFit:
    """Return the fit with the smallest cost, all truncated at the widest of their limits."""
    limit = max(fit.limit for fit in fits)
    return min(fits, key=lambda fit: fit.cost_within(limit))


def _row_with_camera(
    view: BoardView, row: Array, camera: DivisionCamera, options: EstimateOptions
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
    if camera.order == 1 and camera.aspect == 1.0 and not camera.is_decentred:
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
    s = one_term_scale(z, k, x * x + y * y)
    return s * x, s * y


def least_informative(fit: JointFit, new: Array) -> int | None:
    """
    Return the index of the view to drop for a new one; None if the new one adds too little.

    new (18, 18), px²: the new view's information about lens and board. The remaining views have
    the largest determinant of the information about the lens, that is, the smallest volume of
    uncertainty, for given shapes of the boards.
    """
    free = fit.terms.columns
    information = np.concatenate([fit.information, new[None]])[:, free[:, None], free]
    prior = fit.prior[np.ix_(free, free)]
    volumes = _log_volumes(prior + information.sum(axis=0) - information)
    best = int(np.argmax(volumes))
    return best if volumes[best] > volumes[-1] + _WORTH_A_PLACE else None


def is_worth_a_fit(fit: JointFit, information: Array) -> bool:
    """Return whether additional information (C, C), px², is worth another fit."""
    free = np.ix_(fit.terms.columns, fit.terms.columns)
    before = fit.equations[free]
    before, after = _log_volumes(np.array([before, before + information[free]]))
    return bool(after > before + _WORTH_A_FIT)


def _log_volumes(information: Array) -> Array:
    """Return the logarithms of determinants (V,) of matrices (V, n, n), all in the same units."""
    size = np.sqrt(np.diag(information[0]))
    sign, volumes = np.linalg.slogdet(information / np.outer(size, size))
    positive: Array = np.where(sign > 0.0, volumes, -np.inf)
    return positive


def determines_focal(evaluated: EvaluatedView, typical: TypicalCamera) -> bool:
    """Return whether a view alone, with a typical camera's prior, determines the focal length."""
    fit = evaluated.fit
    free = fit.terms.columns
    prior = fit.variance * typical.information(fit.lens[FOCAL], fit.terms)[free]
    inverse = inverse_of_information(evaluated.information[np.ix_(free, free)] + np.diag(prior))
    return bool(fit.variance * inverse[FOCAL, FOCAL] < (_DETERMINED * fit.lens[FOCAL]) ** 2)
