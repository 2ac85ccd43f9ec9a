# SPDX-License-Identifier: Apache-2.0
"""``estimate_pose``: one view of a board, some points wrong, to a pose and how sure it is."""

from __future__ import annotations

from dataclasses import dataclass
import math

import numpy as np
from numpy.typing import ArrayLike

from .estimate import PoseEstimate, RansacOptions, Stop
from .geometry import Array, as_points
from .ransac import all_minimal, Gates, ransac_room, Search, search_pose
from .refine import squared_error
from .sextic import MAX_ROOTS
from .solution import ROW_SIZE, Solution, solution_from_row
from .uncertainty import covariance_of, nothing_observable, observability_of


def estimate_pose(
    image_points: ArrayLike,
    board_points: ArrayLike,
    *,
    image_size: tuple[int, int] | None = None,
    center_px: tuple[float, float] | None = None,
    options: RansacOptions | None = None,
) -> PoseEstimate:
    """
    Estimate pose, focal length and distortion from one view of a plane.

    Parameters
    ----------
    image_points : (N, 2) array, N ≥ 4
        Raw pixels; pixel centres are integers.
    board_points : (N, 2) array
        The same points on the board's plane Z = 0, metres (or any unit; translation shares it).
    image_size
        (width, height), px: gives the default centre and what the field of view is of.
    center_px
        Principal point and distortion centre; by default the middle of the image.
    options
        How to search.

    Raises
    ------
    ValueError
        A wrong shape, a number that is not finite, or neither image_size nor center_px.

    """
    options = options or RansacOptions()
    image = as_points(image_points, 'image_points', (None, 2))
    board = as_points(board_points, 'board_points', (len(image), 2))
    if len(image) < 4:
        raise ValueError(f'image_points must be at least 4, got {len(image)}')
    center, corner_px = _center_and_corner(image, image_size, center_px)
    problem = _Problem(image - center, board - board.mean(axis=0), board.mean(axis=0), center)
    if _collinear(problem.board):
        return _nothing(Stop.COLLINEAR, len(image), 0)
    gates = Gates(
        corner_px,
        math.radians(options.min_fov_deg) / 2.0,
        math.radians(options.max_fov_deg) / 2.0,
        options.max_distortion,
    )
    if len(image) == 4:
        return _from_four(problem, gates, options)
    return _from_many(problem, gates, options)


@dataclass(frozen=True, slots=True)
class _Problem:
    """Points about their centres, as the kernels want them."""

    image: Array
    board: Array
    board_mean: Array
    center_px: Array

    def solution(self, row: Array) -> Solution:
        """Return to the board's own origin: R (X - m) + t = R X + (t - R m)."""
        moved = row.copy()
        moved[9:12] -= row[:9].reshape(3, 3)[:, :2] @ self.board_mean
        return solution_from_row(moved, (float(self.center_px[0]), float(self.center_px[1])))


def _center_and_corner(
    image: Array, image_size: tuple[int, int] | None, center_px: tuple[float, float] | None
) -> tuple[Array, float]:
    """Return the centre (2,) and the distance of the farthest corner (or point) from it."""
    if image_size is None and center_px is None:
        raise ValueError('image_size or center_px must be given: distortion is about a centre')
    corners = image
    if image_size is not None:
        width, height = as_points(image_size, 'image_size', (2,))
        if not (width >= 1.0 and height >= 1.0):
            raise ValueError(f'image_size must be positive, got {image_size}')
        corners = np.array([[0.0, 0.0], [width, 0.0], [0.0, height], [width, height]]) - 0.5
    center = corners[[0, 3]].mean(axis=0) if center_px is None else np.asarray(center_px, float)
    center = as_points(center, 'center_px', (2,))
    return center, float(np.linalg.norm(corners - center, axis=1).max())


def _collinear(centred: Array) -> bool:
    """Say whether points about their mean lie on one line, or on one spot."""
    sizes = np.linalg.svd(centred, compute_uv=False)
    return not sizes[1] > 1e-9 * sizes[0]


def _from_four(problem: _Problem, gates: Gates, options: RansacOptions) -> PoseEstimate:
    rows = np.empty((MAX_ROOTS, ROW_SIZE))
    count = all_minimal(problem.image, problem.board, gates, rows, ransac_room())
    if count == 0:
        return _nothing(Stop.NO_SOLUTION, 4, 1)
    ranked = sorted(rows[:count], key=lambda row: _surprise(row, gates.corner_px))
    return _estimate(problem, ranked, Stop.FOUR_POINTS, 1, gates, options)


def _surprise(row: Array, corner_px: float) -> float:
    """Rank cameras by how common they are: a lens of about 60°, and little distortion."""
    # Squares of deviations in units of a plausible spread: a factor of 2 in the focal length,
    # 0.3 in the bend at the corner. Only the order of the answers hangs on them.
    focal, h = row[12], row[13]
    by_focal = math.log2(focal / (corner_px / math.tan(math.radians(30.0))))
    by_bend = h * corner_px**2 / focal / 0.3
    return float(by_focal**2 + by_bend**2)


def _from_many(problem: _Problem, gates: Gates, options: RansacOptions) -> PoseEstimate:
    n = len(problem.image)
    search = Search(
        options.threshold_px**2,
        options.confidence,
        options.min_iterations,
        options.max_iterations,
        options.seed,
    )
    best = np.empty(ROW_SIZE)
    iterations, cost = search_pose(
        problem.image, problem.board, gates, search, best, ransac_room()
    )
    if not cost < math.inf:
        return _nothing(Stop.NO_SOLUTION, n, iterations)
    stop = Stop.SPENT if iterations == options.max_iterations else Stop.CONFIDENT
    estimate = _estimate(problem, [best], stop, iterations, gates, options)
    if estimate.inliers.sum() < min(n, options.min_inliers):
        return _nothing(Stop.NO_CONSENSUS, n, iterations)
    return estimate


def _estimate(
    problem: _Problem,
    rows: list[Array],
    stop: Stop,
    iterations: int,
    gates: Gates,
    options: RansacOptions,
) -> PoseEstimate:
    """Describe the first of the rows, the others being its alternatives."""
    row = rows[0]
    errors = np.array(
        [squared_error(row, problem.image, problem.board, i) for i in range(len(problem.image))]
    )
    inliers = errors < options.threshold_px**2
    model = problem.solution(row)
    covariance = covariance_of(
        row, problem.image[inliers], problem.board[inliers], problem.board_mean, options.sigma_px
    )
    return PoseEstimate(
        model=model,
        stop=stop,
        inliers=inliers,
        rms_px=float(np.sqrt(errors[inliers].mean())) if inliers.any() else math.nan,
        iterations=iterations,
        covariance=covariance,
        alternatives=tuple(problem.solution(other) for other in rows[1:]),
        observable=observability_of(model, covariance, gates.corner_px),
    )


def _nothing(stop: Stop, n: int, iterations: int) -> PoseEstimate:
    return PoseEstimate(
        model=None,
        stop=stop,
        inliers=np.zeros(n, dtype=bool),
        rms_px=math.nan,
        iterations=iterations,
        covariance=np.full((8, 8), np.nan),
        alternatives=(),
        observable=nothing_observable(),
    )
