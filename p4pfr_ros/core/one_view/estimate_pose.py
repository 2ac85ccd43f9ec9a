# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""``estimate_pose``: the pose of a board from one view, with outliers among its points."""

from __future__ import annotations

from dataclasses import replace
import functools

import numpy as np
from numpy.typing import ArrayLike

from .describe import Answering, no_estimate
from .estimation import Estimation
from .results import EstimateOptions, PoseEstimate, Status
from ..cameras.camera_info import CameraInfoModel
from ..cameras.closest_division import division_camera_from_model
from ..cameras.division import DivisionCamera
from ..geometry import as_points
from ..model.observation import prepare

_DEFAULTS = EstimateOptions()
_FEWEST_POINTS = 4


def estimate_pose(
    image_points: ArrayLike,
    board_points: ArrayLike,
    *,
    image_size: tuple[int, int] | None = None,
    center_px: tuple[float, float] | None = None,
    camera: DivisionCamera | CameraInfoModel | None = None,
    options: EstimateOptions | None = None,
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
        The camera if it is known: only the pose is estimated, and image_size and center_px are
        not needed. With a CameraInfoModel, ``model.camera`` of the result is the division camera
        closest to it.
    options
        How to search.

    Raises
    ------
    ValueError
        A wrong shape, a number that is not finite, or nothing that says where the centre is.

    """
    if isinstance(camera, CameraInfoModel):
        return _by_camera_info(image_points, board_points, camera, options)
    view = prepare(image_points, board_points, image_size, center_px, camera)
    if view.collinear:
        return no_estimate(Status.COLLINEAR, len(view.image), 0)
    return Estimation(Answering(view, camera, options or _DEFAULTS)).run()


def _by_camera_info(
    image_points: ArrayLike,
    board_points: ArrayLike,
    model: CameraInfoModel,
    options: EstimateOptions | None,
) -> PoseEstimate:
    """
    Estimate the pose by a camera of another model than ours.

    Each pixel's ray is exact by that model. It is projected by the closest division camera, so
    that threshold, rms_px and covariance are in raw pixels (but for the residual between the two
    models) at the rim of wide lenses too, where an undistorted plane would stretch them.
    """
    raw = as_points(image_points, 'image_points', (None, 2))
    board = as_points(board_points, 'board_points', (len(raw), 2))
    if len(raw) < _FEWEST_POINTS:
        raise ValueError(f'image_points must be at least {_FEWEST_POINTS}, got {len(raw)}')
    camera = _closest(model)
    moved = camera.project(model.unproject(raw))
    seen = ~np.isnan(moved).any(axis=1)
    if np.count_nonzero(seen) < _FEWEST_POINTS:
        return no_estimate(Status.NO_SOLUTION, len(raw), 0)
    estimate = estimate_pose(
        moved[seen], board[seen], image_size=model.image_size, camera=camera, options=options
    )
    inliers = np.zeros(len(raw), dtype=bool)
    inliers[seen] = estimate.inliers
    return replace(estimate, inliers=inliers)


@functools.lru_cache(maxsize=16)
def _closest(model: CameraInfoModel) -> DivisionCamera:
    """Return the closest division camera, kept from view to view."""
    return division_camera_from_model(model)[0]
