# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""Synthetic views of one camera: boards and markers where it sees them, noise, and the truth."""

from __future__ import annotations

from collections.abc import Sequence
import math

import numpy as np
from p4pfr_ros.core.cameras.division import DivisionCamera
from p4pfr_ros.core.geometry import Array, Pose
from p4pfr_ros.core.many_views.joint_fit import fit_views
from p4pfr_ros.core.model.lens import camera_from_lens, lens_from_camera, LENS_SIZE
from p4pfr_ros.core.model.observation import observe
from p4pfr_ros.core.model.prior import LensPrior
from p4pfr_ros.scenes.instances import IMAGE_SIZE, tilted
from p4pfr_ros.scenes.single_view import View

_FOCAL_PX = (500.0, 1500.0)
_BEND = (-0.5, 0.0)  # k r² at the corner of the picture
_CORNER_PX = 0.5 * math.hypot(*IMAGE_SIZE)
_MIDDLE_PX = (0.5 * (IMAGE_SIZE[0] - 1.0), 0.5 * (IMAGE_SIZE[1] - 1.0))

# A noise whose gate no error is beyond, px.
_NO_GATE_PX = 1000.0

# Of the optical centre from the middle of the picture, as a share of its diagonal.
CENTER_SPREAD = 0.03


def drawn_camera(rng: np.random.Generator) -> DivisionCamera:
    """Draw a camera for pictures of ``IMAGE_SIZE``, its centre off the middle as lenses' are."""
    focal_px = math.exp(rng.uniform(*np.log(_FOCAL_PX)))
    x, y = rng.normal(_MIDDLE_PX, CENTER_SPREAD * math.hypot(*IMAGE_SIZE))
    return DivisionCamera(focal_px, (x, y), rng.uniform(*_BEND) * (focal_px / _CORNER_PX) ** 2)


def camera_view(
    rng: np.random.Generator,
    camera: DivisionCamera,
    board_points: Array,
    *,
    noise_px: float = 0.5,
    outlier_share: float = 0.0,
    tilt_deg: tuple[float, float] = (5.0, 65.0),
    distance: tuple[float, float] = (0.4, 3.0),
) -> View:
    """
    Draw a view of a board's points (N, 2), all of them in a picture of ``IMAGE_SIZE``.

    camera: or any other lens that projects and unprojects. distance: of the board's origin, in
    the board's units, least and most.
    """
    low, high = np.log(distance)
    points = np.pad(board_points, ((0, 0), (0, 1)))
    while True:
        ray = camera.unproject(rng.uniform((0, 0), IMAGE_SIZE))
        place = ray / np.linalg.norm(ray) * math.exp(rng.uniform(low, high))
        pose = Pose(tilted(*tilt_deg)(rng, 1)[0], place)
        seen = pose.transform(points)
        # From its front: its normal points towards the camera.
        if not (seen @ pose.rotation[:, 2] < 0.0).all():
            continue
        image = camera.project(seen)
        if ((image > 0.0) & (image < np.subtract(IMAGE_SIZE, 1))).all():  # NaN is outside
            break
    n = len(board_points)
    image = image + rng.normal(0.0, noise_px, image.shape)
    outlier = np.zeros(n, dtype=bool)
    outlier[rng.permutation(n)[: round(outlier_share * n)]] = True
    image[outlier] = rng.uniform((0, 0), IMAGE_SIZE, (int(outlier.sum()), 2))
    return View(image, board_points, outlier, camera, pose)


def grid(columns: int, rows: int) -> Array:
    """Return the points (columns * rows, 2) of a board, about its middle; one unit long."""
    x = np.linspace(-0.5, 0.5, columns)
    y = (np.arange(rows) - 0.5 * (rows - 1)) / (columns - 1)
    return np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2)


def fit_from_the_truth(views: Sequence[View]) -> DivisionCamera:
    """Return the best there is: full bundle adjustment from the truth, on the true inliers."""
    centered, rows = [], []
    for view in views:
        observation = observe(view.image_points[~view.outlier], view.board_points[~view.outlier])
        centered.append(observation.centered(_MIDDLE_PX, IMAGE_SIZE))
        rows.append(observation.row_from_pose(view.camera_from_board))
    no_prior = LensPrior.without_views(np.zeros(LENS_SIZE), np.zeros((LENS_SIZE, LENS_SIZE)))
    lens = lens_from_camera(views[0].camera, _MIDDLE_PX)
    fit = fit_views(centered, np.array(rows), lens, 1, no_prior, sigma_px=_NO_GATE_PX)
    return camera_from_lens(fit.lens, _MIDDLE_PX)
