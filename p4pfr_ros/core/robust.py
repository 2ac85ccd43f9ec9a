# SPDX-License-Identifier: Apache-2.0
"""``estimate_pose``: one view of a board, some points wrong, to a pose and how sure it is."""

from __future__ import annotations

from dataclasses import dataclass
import math

import numpy as np
from numpy.typing import ArrayLike

from .ambiguity import flipped_optimum
from .camera import DivisionCamera
from .estimate import PoseEstimate, RansacOptions, Stop
from .free_camera import Gates
from .geometry import Array, as_points
from .least_squares import minimise, normal_equations
from .problem import free_problem, hypotheses, known_problem, POSE, Problem, squared_errors
from .ransac import ransac_room, Search, search_best
from .roots import MAX_ROOTS
from .solution import G, H, ROW_SIZE, Solution, solution_from_row, TRANSLATION
from .uncertainty import covariance_from, noise_variance, Observability, observability_of

_STEPS = 100
_TOLERANCE = 1e-13


def estimate_pose(
    image_points: ArrayLike,
    board_points: ArrayLike,
    *,
    image_size: tuple[int, int] | None = None,
    center_px: tuple[float, float] | None = None,
    camera: DivisionCamera | None = None,
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
        (width, height), px: gives the default centre, and what the field of view is of.
    center_px
        Principal point and distortion centre; by default the middle of the image.
    camera
        The camera where it is known: pose only; the other two are then not needed.
    options
        How to search.

    Raises
    ------
    ValueError
        A wrong shape, a number that is not finite, or nothing that says where the centre is.

    """
    options = options or RansacOptions()
    image = as_points(image_points, 'image_points', (None, 2))
    board = as_points(board_points, 'board_points', (len(image), 2))
    if len(image) < 4:
        raise ValueError(f'image_points must be at least 4, got {len(image)}')
    center, corner_px = _center_and_corner(image, image_size, camera, center_px)
    mean = board.mean(axis=0)
    if _collinear(board - mean):
        return _nothing(Stop.COLLINEAR, len(image), 0)
    gates = _gates(corner_px, options)
    if camera is None:
        problem = free_problem(image - center, board - mean, gates)
        camera = DivisionCamera(1.0, (float(center[0]), float(center[1])))
    else:
        problem = known_problem(image - center, board - mean, gates, camera)
    estimation = _Estimation(problem, mean, camera, options)
    return estimation.from_four() if len(image) == 4 else estimation.from_many()


def _center_and_corner(
    image: Array,
    image_size: tuple[int, int] | None,
    camera: DivisionCamera | None,
    center_px: tuple[float, float] | None,
) -> tuple[Array, float]:
    """Return the centre (2,) and the distance of the farthest corner (or point) from it."""
    if camera is not None:
        center_px = camera.center_px
    corners = image
    if image_size is not None:
        width, height = as_points(image_size, 'image_size', (2,))
        if not (width >= 1.0 and height >= 1.0):
            raise ValueError(f'image_size must be positive, got {image_size}')
        corners = np.array([[0.0, 0.0], [width, 0.0], [0.0, height], [width, height]]) - 0.5
    elif center_px is None:
        raise ValueError('image_size, center_px or camera must say where the centre is')
    middle = (corners[0] + corners[3]) / 2.0 if center_px is None else center_px
    center = as_points(middle, 'center_px', (2,))
    return center, float(np.linalg.norm(corners - center, axis=1).max())


def _gates(corner_px: float, options: RansacOptions) -> Gates:
    return Gates(
        corner_px,
        math.radians(options.min_fov_deg) / 2.0,
        math.radians(options.max_fov_deg) / 2.0,
        options.max_distortion,
    )


def _collinear(centred: Array) -> bool:
    """Say whether points about their mean lie on one line, or on one spot."""
    sizes = np.linalg.svd(centred, compute_uv=False)
    return not sizes[1] > 1e-9 * sizes[0]


@dataclass(frozen=True, slots=True)
class _Estimation:
    """One call: the view as the kernels want it, and the way back to the caller's frame."""

    problem: Problem
    board_mean: Array
    camera: DivisionCamera  # known, or no more than the centre
    options: RansacOptions

    def from_four(self) -> PoseEstimate:
        """Rank every solution of exactly four points."""
        room = ransac_room()
        rows = np.empty((MAX_ROOTS, ROW_SIZE))
        count = hypotheses(self.problem, np.arange(4), rows, room.solver)
        if count == 0:
            return _nothing(Stop.NO_SOLUTION, 4, 1)
        if self.problem.unknowns == POSE:
            # Eight numbers for six unknowns: least squares over all four, none an outlier yet.
            minimise(rows[0], self.problem, math.inf, _STEPS, _TOLERANCE, room.refine)
            return self._describe(rows[0], None, Stop.FOUR_POINTS, 1)
        ranked = sorted(rows[:count], key=lambda row: _surprise(row, self.problem.gates.corner_px))
        return self._describe(ranked[0], ranked[1:], Stop.FOUR_POINTS, 1)

    def from_many(self) -> PoseEstimate:
        """Search, refine and look for the flip."""
        n = len(self.problem.image)
        options = self.options
        search = Search(
            options.threshold_px**2,
            options.confidence,
            min(options.min_iterations, math.comb(n, 4)),
            options.max_iterations,
            options.seed,
        )
        best = np.empty(ROW_SIZE)
        iterations, cost = search_best(self.problem, search, best, ransac_room())
        if not cost < math.inf:
            return _nothing(Stop.NO_SOLUTION, n, iterations)
        spent = iterations == options.max_iterations
        return self._describe(best, None, Stop.SPENT if spent else Stop.CONFIDENT, iterations)

    def _describe(
        self, row: Array, others: list[Array] | None, stop: Stop, iterations: int
    ) -> PoseEstimate:
        """Say of a row all that there is to say; others None: the flip is sought."""
        n = len(self.problem.image)
        limit = self.options.threshold_px**2
        squares = np.empty(n)
        squared_errors(row, self.problem, squares)
        inliers = squares < limit
        if inliers.sum() < min(n, self.options.min_inliers):
            return _nothing(Stop.NO_CONSENSUS, n, iterations)
        room = ransac_room().refine
        unknowns = self.problem.unknowns
        count = normal_equations(row, self.problem, limit, room)
        variance = noise_variance(
            float(squares[inliers].sum()), count, unknowns, self.options.sigma_px
        )
        covariance = covariance_from(room.normal[:, :8], unknowns, variance, row, self.board_mean)
        if others is None:
            cost = float(np.minimum(squares, limit).sum())
            flip = flipped_optimum(self.problem, row, cost, limit, variance, room)
            others = [] if flip is None else [flip]
        model = self._solution(row)
        return PoseEstimate(
            model=model,
            stop=stop,
            inliers=inliers,
            rms_px=float(np.sqrt(squares[inliers].mean())),
            iterations=iterations,
            covariance=covariance,
            alternatives=tuple(self._solution(other) for other in others),
            observable=observability_of(model, covariance, self.problem.gates.corner_px),
        )

    def _solution(self, row: Array) -> Solution:
        """Return to the board's own origin: R (X - m) + t = R X + (t - R m)."""
        moved = row.copy()
        rotation = row[:TRANSLATION].reshape(3, 3)
        moved[TRANSLATION:G] -= rotation[:, :2] @ self.board_mean
        solution = solution_from_row(moved, self.camera.center_px)
        if self.problem.unknowns == POSE:
            return Solution(self.camera, solution.camera_from_board)
        return solution


def _surprise(row: Array, corner_px: float) -> float:
    """Rank cameras by how common they are: a lens of about 60°, and little distortion."""
    # Squares of deviations in units of a plausible spread: a factor of 2 in the focal length,
    # 0.3 in the bend at the corner. Only the order of the answers hangs on them.
    by_focal = math.log2(row[G] / (corner_px / math.tan(math.radians(30.0))))
    by_bend = row[H] * corner_px**2 / row[G] / 0.3
    return float(by_focal**2 + by_bend**2)


def _nothing(stop: Stop, n: int, iterations: int) -> PoseEstimate:
    return PoseEstimate(
        model=None,
        stop=stop,
        inliers=np.zeros(n, dtype=bool),
        rms_px=math.nan,
        iterations=iterations,
        covariance=np.full((8, 8), np.nan),
        alternatives=(),
        observable=Observability(),
    )
