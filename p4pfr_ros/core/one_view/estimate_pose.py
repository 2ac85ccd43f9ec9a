# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""``estimate_pose``: pose and camera from one view of a board, outliers rejected."""

from __future__ import annotations

from dataclasses import replace
import functools
import math
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from .ambiguity import same_optimum
from .camera_fit import compared, free_options, is_bad
from .describe import (
    FoundPoses,
    MAX_RATIO,
    PoseSearch,
    refine_all,
    solve_four,
    ViewProblem,
)
from .free_camera import NO_PRIOR
from .full_estimate import FullViewProblem
from .known_camera import weak_perspective_rows
from .least_squares import known_problem, plausible, POSE, Problem, truncated_cost
from .ransac import is_mirrored, Search, search_best
from .results import EstimateOptions, no_estimate, PoseEstimate, Status
from ..cameras.camera_info import CameraInfoModel, checked_image_size
from ..cameras.closest_division import division_camera_from_model
from ..cameras.division import DivisionCamera
from ..geometry import Array, as_points
from ..minimal.solution import G, H, MAX_SOLUTIONS, ROW_SIZE
from ..model.board_shape import BoardShape
from ..model.observation import (
    CenteredView,
    FEWEST_POINTS,
    image_center_px,
    Observation,
    observe,
)

_DEFAULTS = EstimateOptions()

# Factor of the threshold on squared errors in a search with a typical camera, whose inliers may be
# off by some pixels.
_WIDE = 100.0


def estimate_pose(
    image_points: ArrayLike,
    board_points: ArrayLike,
    *,
    image_size: tuple[int, int] | None = None,
    center_px: tuple[float, float] | None = None,
    camera: DivisionCamera | CameraInfoModel | None = None,
    board_shape: BoardShape | None = None,
    options: EstimateOptions | None = None,
) -> PoseEstimate:
    """
    Estimate pose, focal length and distortion from one view of a plane.

    Parameters
    ----------
    image_points : (N, 2) array, N ≥ 4
        Raw pixels; pixel centres are integers. OpenCV's (N, 1, 2) is accepted too.
    board_points : (N, 2) array
        The same points on the board's plane Z = 0, metres (or any unit; the translation has the
        same): x right, y up, as the viewer sees the front of the board. OpenCV's (N, 3) with
        Z = 0 is accepted too. If y points down, the points lie in the order of the back: pass
        ``options`` with ``two_sided``, or negate y.
    image_size
        (width, height), px: gives the default centre, and the image's corners.
    center_px
        Principal point and distortion centre; by default the middle of the image.
    camera
        The camera if it is known: only the pose is estimated, and image_size and center_px are
        not needed; with image_size a wrong centre is noticed, too. If the view shows that the
        camera does not fit, there is no estimate, with status MISFIT. With a CameraInfoModel,
        ``model.camera`` of the result is the division camera closest to it.
    board_shape
        How the board deviates from its specification, from a calibration with it.
    options
        Options of the search.

    Raises
    ------
    ValueError
        A wrong shape, a number that is not finite, or neither image_size, center_px nor camera.
    TypeError
        camera, board_shape or options is of another type.

    """
    options = _checked_options(options)
    observation = _on_real_board(observe(image_points, board_points), board_shape)
    size = None if image_size is None else checked_image_size(image_size)
    if isinstance(camera, CameraInfoModel):
        size = camera.image_size
        estimate, camera = _estimate_by_model(observation, camera, options), _closest(camera)
    elif camera is not None and not isinstance(camera, DivisionCamera):
        raise TypeError(
            f'camera must be a DivisionCamera or a CameraInfoModel, got {type(camera).__name__}'
        )
    else:
        if camera is None and center_px is not None:
            x, y = as_points(center_px, 'center_px', (2,)).tolist()
            center_px = x, y
        estimate = estimate_observation(observation, size, center_px, camera, options)
    if camera is None or observation.collinear or not is_bad(estimate):
        return estimate
    # Does another camera explain the view?
    center_px = camera.center_px if size is None else None
    free = estimate_observation(observation, size, center_px, None, free_options(options))
    return compared(estimate, free, camera, size)


def estimate_observation(
    observation: Observation,
    image_size: tuple[float, float] | None,
    center_px: tuple[float, float] | None,
    camera: DivisionCamera | None,
    options: EstimateOptions,
    *,
    center_known: bool = True,
) -> PoseEstimate:
    """
    Estimate as `estimate_pose` does, from an observation that has been checked and scaled.

    center_known: whether a given center_px is exact, not only the mean of the prior on it.

    Raises
    ------
    ValueError
        Neither image_size, center_px nor camera is given; coordinates beyond 1e20 px.

    """
    center_known = center_known and center_px is not None
    if camera is not None:
        center_px = camera.center_px
    elif center_px is None:
        if image_size is None:
            raise ValueError('image_size, center_px or camera must be given: they fix the centre')
        center_px = image_center_px(image_size)
    view = observation.centered(center_px, image_size)
    if observation.collinear:
        return no_estimate(Status.COLLINEAR, len(view.image), 0)
    if not options.two_sided and is_mirrored(view.image, view.board, options.threshold_px**2):
        return no_estimate(Status.SEEN_FROM_BEHIND, len(view.image), 0)
    problem = ViewProblem(view, camera, options)
    is_full = options.has_deviations or observation.heights is not None
    if is_full:
        problem = FullViewProblem(view, camera, options, center_known)
    four = len(view.image) == 4
    estimate = _estimate_from_four(problem) if four else _estimate_from_many(problem)
    # Full fits that show the back have been dropped.
    return estimate if is_full else _of_visible_side(estimate, options)


def search_poses(
    view: CenteredView, camera: DivisionCamera, options: EstimateOptions
) -> FoundPoses:
    """Return the poses of a view, relative to a known camera's centre, without deviations."""
    mirrored = is_mirrored(view.image, view.board, options.threshold_px**2)
    if view.observation.collinear:
        return FoundPoses([], Status.COLLINEAR, 0)
    if mirrored and not options.two_sided:
        return FoundPoses([], Status.SEEN_FROM_BEHIND, 0)
    problem = PoseSearch(view, camera, options)
    found: Any = _estimate_from_four if len(view.image) == 4 else _estimate_from_many
    result = found(problem)
    if isinstance(result, FoundPoses):
        return result
    return FoundPoses([], result.status, result.iterations)


def _of_visible_side(estimate: PoseEstimate, options: EstimateOptions) -> PoseEstimate:
    """Drop the poses that show the back of the board, unless it is two-sided."""
    if options.two_sided or estimate.model is None:
        return estimate
    if estimate.model.camera_from_board.shows_back:
        n = len(estimate.inliers)
        return no_estimate(Status.SEEN_FROM_BEHIND, n, estimate.iterations)
    front = tuple(s for s in estimate.alternatives if not s.camera_from_board.shows_back)
    dropped = len(front) < len(estimate.alternatives)
    return replace(estimate, alternatives=front) if dropped else estimate


def _on_real_board(observation: Observation, shape: BoardShape | None) -> Observation:
    """Return the points where they are on the real board."""
    if shape is None or observation.collinear:
        return observation
    if not isinstance(shape, BoardShape):
        raise TypeError(f'board_shape must be a BoardShape, got {type(shape).__name__}')
    moved = shape.points(observation.board_points)
    moved[:, :2] -= observation.board_points
    return observation.displaced(moved / observation.board_size)


def _checked_options(options: EstimateOptions | None) -> EstimateOptions:
    if options is None:
        return _DEFAULTS
    if not isinstance(options, EstimateOptions):
        raise TypeError(f'options must be EstimateOptions, got {type(options).__name__}')
    return options


def _estimate_by_model(
    observation: Observation, model: CameraInfoModel, options: EstimateOptions
) -> PoseEstimate:
    """
    Estimate the pose with a camera in a CameraInfo model.

    Each pixel is replaced by the projection of its exact ray with the closest division camera.
    Threshold, rms_px and covariance stay in raw pixels (up to the residual between the two
    models), even at the rim of a wide lens, which an undistorted image would stretch.
    """
    camera = _closest(model)
    pixels = camera.project(model.unproject(observation.image_points))
    visible = ~np.isnan(pixels[:, 0])
    if np.count_nonzero(visible) < FEWEST_POINTS:
        return no_estimate(Status.NO_SOLUTION, len(observation), 0)
    replaced = observation.with_pixels(pixels, visible)
    estimate = estimate_observation(replaced, model.image_size, None, camera, options)
    inliers = np.zeros(len(observation), dtype=bool)
    inliers[visible] = estimate.inliers
    return replace(estimate, inliers=inliers)


@functools.lru_cache(maxsize=16)
def _closest(model: CameraInfoModel) -> DivisionCamera:
    """Return the closest division camera; cached for the next view."""
    # The rays are exact, so the pixels of a camera without skew may stand for those with skew.
    return division_camera_from_model(replace(model, skew_px=0.0))[0]


def _estimate_from_four(view: ViewProblem) -> PoseEstimate:
    """Estimate from exactly four points: rank all solutions."""
    problem = view.problem()
    rows = np.empty((MAX_SOLUTIONS + 1, ROW_SIZE))
    costs = np.empty(MAX_SOLUTIONS + 1)
    count = solve_four(problem, rows)
    if problem.unknowns == POSE:
        return _pose_of_four(view, problem, rows[:count])
    start = _typical_start(view) if count == 0 or view.has_focal_prior else None
    if start is not None:
        rows[count] = start
        count += 1
    if count == 0:
        return no_estimate(Status.NO_SOLUTION, 4, 1)
    # All four are inliers: without a prior a free camera fits them exactly.
    refine_all(rows, count, problem, math.inf, costs)
    rows, costs = rows[:count], costs[:count]
    if not isinstance(view, FullViewProblem):  # otherwise the full fits are judged
        within = [i for i in range(count) if plausible(rows[i], problem)]
        rows, costs = rows[within], costs[within]
    if len(rows) == 0:
        return no_estimate(Status.NO_SOLUTION, 4, 1)
    if len(rows) == 1:
        return view.describe(rows[0], problem, None, Status.FOUR_POINTS, 1)
    ranked = _ranked(rows, costs, view, problem.prior != NO_PRIOR)
    return view.describe(ranked[0], problem, ranked[1:], Status.FOUR_POINTS, 1)


def _pose_of_four(view: ViewProblem, problem: Problem, rows: Array) -> PoseEstimate:
    """Estimate with a known camera: start from the closed form, or from weak perspective."""
    costs = np.empty(2)
    refine_all(rows, len(rows), problem, math.inf, costs)
    if len(rows) == 0 or not costs[0] < view.options.threshold_px**2:
        rows = weak_perspective_rows(problem.rays, problem.board)
        refine_all(rows, len(rows), problem, math.inf, costs)
    if len(rows) == 0:
        return no_estimate(Status.NO_SOLUTION, 4, 1)
    best = rows[np.argmin(costs[: len(rows)])]
    return view.describe(best, problem, None, Status.FOUR_POINTS, 1)


def _estimate_from_many(view: ViewProblem) -> PoseEstimate:
    """Estimate from more than four points: search the best row, and describe it."""
    best = np.empty(ROW_SIZE)
    search = _search(view, 1.0)
    problem = view.problem()
    iterations, cost = search_best(problem, search, best)
    if view.has_focal_prior:
        # The samples of a fronto-parallel view have arbitrary focal lengths: try the prior's, too.
        start = _typical_start(view)
        if start is not None:
            start_cost = truncated_cost(start, problem, search.limit, cost)
            best, cost = (start, start_cost) if start_cost < cost else (best, cost)
    status = Status.SPENT if iterations == search.max_iterations else Status.CONFIDENT
    estimate = None
    if cost < math.inf:
        estimate = view.describe(best, problem, None, status, iterations)
        if estimate.model is not None:
            return estimate
    for start in () if view.has_focal_prior else _other_starts(view):
        other = view.describe(start, problem, None, status, iterations)
        if other.model is not None:
            return other
    return estimate or no_estimate(Status.NO_SOLUTION, len(problem.image), iterations)


def _other_starts(view: ViewProblem) -> Array:
    """Return start rows (n, ROW_SIZE) for a view whose samples did not lead to an estimate."""
    if view.camera is None:
        start = _typical_start(view)
        return np.empty((0, ROW_SIZE)) if start is None else start[None]
    problem = view.problem()
    rows = weak_perspective_rows(problem.rays, problem.board)
    refine_all(rows, len(rows), problem, math.inf, np.empty(len(rows)))
    return rows


def _search(view: ViewProblem, widen: float) -> Search:
    options = view.options
    return Search(
        widen * options.threshold_px**2,
        view.fewest_inliers,
        options.confidence,
        min(options.min_iterations, math.comb(len(view.view.image), 4)),
        options.max_iterations,
        options.seed,
    )


def _typical_start(view: ViewProblem) -> Array | None:
    """Return a row with the camera of the priors, else a typical one, as a prior; or None."""
    typical = view.problem(typical_focal=True, typical_k=True)
    focal_px, k = typical.prior.focal_px, typical.prior.k
    lens = DivisionCamera(focal_px, (0.0, 0.0), k)
    known = known_problem(typical.image, typical.board, typical.gates, lens)
    row = np.empty(ROW_SIZE)
    search = _search(view, _WIDE)
    if not search_best(known, search, row)[1] < math.inf:
        return None
    row[G], row[H] = focal_px, k / focal_px
    # Far from the optimum, at first with a wide limit.
    for limit in (search.limit, view.options.threshold_px**2):
        refine_all(row[None], 1, typical, limit, np.empty(1))
    return row


def _ranked(rows: Array, costs: Array, view: ViewProblem, by_cost: bool) -> Array:
    """Sort by cost, or by how typical the cameras are if all fit exactly; drop duplicates."""
    if by_cost:
        order = np.argsort(costs, kind='stable')
        order = order[costs[order] - costs.min() <= MAX_RATIO * view.sigma_px**2]
    else:
        order = np.argsort([view.atypicality(row) for row in rows], kind='stable')
    different: list[Array] = []
    for row in rows[order]:
        if not any(same_optimum(row, other) for other in different):
            different.append(row)
    return np.array(different)
