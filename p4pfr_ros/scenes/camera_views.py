# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""
Synthetic views of one camera, with noise, outliers and ground truth.

This module stands alone because only tests and benchmarks use it: they draw views of a camera.
"""

from __future__ import annotations

from collections.abc import Sequence
import math

import numpy as np
from p4pfr_ros.core.cameras.division import DivisionCamera
from p4pfr_ros.core.geometry import Array, Pose
from p4pfr_ros.core.many_views.board_views import board_view
from p4pfr_ros.core.many_views.joint_fit import fit_views, Start
from p4pfr_ros.core.model.lens import camera_from_lens, lens_from_camera
from p4pfr_ros.core.model.observation import observe
from p4pfr_ros.core.model.prior import CommonPrior, FreeTerms, TypicalCamera
from p4pfr_ros.scenes.instances import draw_rotations, IMAGE_SIZE
from p4pfr_ros.scenes.single_view import add_noise_and_outliers, SyntheticView

_FOCAL_RANGE_PX = (500.0, 1500.0)
_CORNER_BEND = (-0.5, 0.0)  # k r² at the image corner
_CORNER_PX = 0.5 * math.hypot(*IMAGE_SIZE)
_MIDDLE_PX = (0.5 * (IMAGE_SIZE[0] - 1.0), 0.5 * (IMAGE_SIZE[1] - 1.0))

# A noise level so large that its outlier gate accepts every inlier, px.
_NO_GATE_PX = 3.0

# Standard deviation of a prior that says nothing: beside it the noise level above is small.
_VAGUE = 1e9

# Standard deviation of the distortion centre from the middle of the image, in image diagonals.
CENTER_SIGMA = 0.03


def draw_camera(rng: np.random.Generator) -> DivisionCamera:
    """Draw a camera for ``IMAGE_SIZE``, with the centre off the middle as in real lenses."""
    focal_px = math.exp(rng.uniform(*np.log(_FOCAL_RANGE_PX)))
    x, y = rng.normal(_MIDDLE_PX, CENTER_SIGMA * math.hypot(*IMAGE_SIZE))
    return DivisionCamera(
        focal_px, (x, y), rng.uniform(*_CORNER_BEND) * (focal_px / _CORNER_PX) ** 2
    )


def draw_camera_view(
    rng: np.random.Generator,
    camera: DivisionCamera,
    board_points: Array,
    *,
    noise_px: float = 0.5,
    outlier_share: float = 0.0,
    tilt_deg: tuple[float, float] = (5.0, 65.0),
    distance: tuple[float, float] = (0.4, 3.0),
) -> SyntheticView:
    """
    Draw a view of board points (N, 2), all of them inside an image of ``IMAGE_SIZE``.

    camera: a DivisionCamera, or another object that projects and unprojects. distance: range of
    the distance of the board's origin, in the board's units.
    """
    low, high = np.log(distance)
    points = np.pad(board_points, ((0, 0), (0, 1)))
    while True:
        ray = camera.unproject(rng.uniform((0, 0), IMAGE_SIZE))
        origin = ray / np.linalg.norm(ray) * math.exp(rng.uniform(low, high))
        pose = Pose(draw_rotations(rng, 1, tilt_deg)[0], origin)
        in_camera = pose.transform(points)
        # Reject views of the back: the board's normal must point towards the camera.
        if not (in_camera @ pose.rotation[:, 2] < 0.0).all():
            continue
        image = camera.project(in_camera)
        if ((image > 0.0) & (image < np.subtract(IMAGE_SIZE, 1))).all():  # false for NaN
            break
    image, outlier = add_noise_and_outliers(rng, image, noise_px, outlier_share)
    return SyntheticView(image, board_points, outlier, camera, pose)


def board_grid(columns: int, rows: int) -> Array:
    """Return the points (columns * rows, 2) of a centred board that is one unit wide."""
    x = np.linspace(-0.5, 0.5, columns)
    y = (np.arange(rows) - 0.5 * (rows - 1)) / (columns - 1)
    return np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2)


def fit_from_ground_truth(views: Sequence[SyntheticView]) -> DivisionCamera:
    """Return the optimum: bundle adjustment from the ground truth, on the true inliers."""
    centered, rows = [], []
    for view in views:
        observation = observe(view.image_points[~view.outlier], view.board_points[~view.outlier])
        centered.append(board_view(observation.centered(_MIDDLE_PX, IMAGE_SIZE), '', ()))
        rows.append(observation.row_from_pose(view.camera_from_board))
    camera = views[0].camera
    vague = TypicalCamera(
        corner_px=_CORNER_PX,
        center_sigma_px=_VAGUE,
        focal_px=camera.focal_px,
        focal_sigma_px=_VAGUE,
        k_sigma=_VAGUE,
    )
    start = Start(np.array(rows), lens_from_camera(camera, _MIDDLE_PX), ())
    prior = CommonPrior.without_views(vague)
    fit = fit_views(centered, start, FreeTerms(), prior, sigma_px=_NO_GATE_PX)
    return camera_from_lens(fit.lens, _MIDDLE_PX)
