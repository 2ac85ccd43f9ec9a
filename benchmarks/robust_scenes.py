# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""One cell of the robust benchmark: ``estimate_pose`` and the ideal fit on the same scenes."""

from __future__ import annotations

from dataclasses import dataclass
import math

import numpy as np
from p4pfr_ros import Solution
from p4pfr_ros.core.geometry import Array, rotation_angle_rad, TRANSLATION
from p4pfr_ros.core.minimal.solution import G, H, ROW_SIZE, solutions_from_rows
from p4pfr_ros.core.one_view.free_camera import Gates
from p4pfr_ros.core.one_view.least_squares import free_problem, least_squares_work, minimise
from p4pfr_ros.scenes.single_view import draw_view, SyntheticView

from .opencv import estimate, options_for

_ANY_CAMERA = Gates(800.0, 0.0, math.pi, math.inf)
_STEPS = 200
_TOLERANCE = 1e-14


@dataclass(frozen=True, slots=True)
class Errors:
    """Errors of n scenes, (n,) each: rotation (degrees), focal length and position (percent)."""

    rotation_deg: Array
    focal: Array
    position: Array

    @property
    def success(self) -> float:
        """Percentage of scenes with rotation within 1° and focal length within 5 %."""
        return 100.0 * float(np.mean((self.rotation_deg < 1.0) & (self.focal < 5.0)))

    @property
    def medians(self) -> tuple[float, float, float]:
        """Median errors: rotation (degrees), focal length and position (percent)."""
        rotation, focal, position = (
            float(np.median(e)) for e in (self.rotation_deg, self.focal, self.position)
        )
        return rotation, focal, position


@dataclass(frozen=True, slots=True)
class Cell:
    """The results over the scenes of one cell."""

    n_points: int
    outlier_percent: int
    truth: Errors  # least squares from ground truth on the true inliers
    ideal: Errors  # estimate_pose without deviations
    default: Errors  # estimate_pose with default options
    iterations: float


def measure_cell(n_points: int, outlier_percent: int, scenes: int) -> Cell:
    """Draw the scenes of a cell and estimate each of them."""
    rng = np.random.default_rng([n_points, outlier_percent])
    views = [
        draw_view(rng, n_points, outlier_share=outlier_percent / 100.0) for _ in range(scenes)
    ]
    ideal, default = (
        [estimate(view, options_for(outlier_percent, ideal=ideal)) for view in views]
        for ideal in (True, False)
    )
    return Cell(
        n_points,
        outlier_percent,
        _errors([fit_from_ground_truth(v) for v in views], views),
        _errors([each.model for each in ideal], views),
        _errors([each.model for each in default], views),
        float(np.median([each.iterations for each in ideal])),
    )


def fit_from_ground_truth(drawn: SyntheticView) -> Solution:
    """Refine ground truth on the true inliers: the best result possible without a prior."""
    inlier = ~drawn.outlier
    image = np.ascontiguousarray(drawn.image_points[inlier] - drawn.camera.center_px)
    board = np.ascontiguousarray(drawn.board_points[inlier])
    row = np.empty(ROW_SIZE)
    row[:TRANSLATION] = drawn.camera_from_board.rotation.ravel()
    row[TRANSLATION:G] = drawn.camera_from_board.translation
    row[G], row[H] = drawn.camera.focal_px, drawn.camera.k / drawn.camera.focal_px
    problem = free_problem(image, board, _ANY_CAMERA)
    minimise(row, problem, math.inf, _STEPS, _TOLERANCE, least_squares_work())
    return solutions_from_rows(row[None], drawn.camera.center_px)[0]


def _errors(models: list[Solution | None], views: list[SyntheticView]) -> Errors:
    each = [_error(model, v) for model, v in zip(models, views, strict=True)]
    return Errors(*np.array(each).T)


def _error(model: Solution | None, drawn: SyntheticView) -> tuple[float, float, float]:
    if model is None:
        return math.inf, math.inf, math.inf
    pose, truth = model.camera_from_board, drawn.camera_from_board
    distance = np.linalg.norm(pose.translation - truth.translation)
    return (
        math.degrees(rotation_angle_rad(pose.rotation, truth.rotation)),
        100.0 * abs(model.camera.focal_px / drawn.camera.focal_px - 1.0),
        100.0 * float(distance / np.linalg.norm(truth.translation)),
    )
