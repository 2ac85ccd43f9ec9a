# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""Selection of keyframes: new views that together determine the camera best."""

from __future__ import annotations

import math

import numpy as np

from .candidate import EvaluatedView
from .joint_fit import JointFit
from ..cameras.division import DivisionCamera
from ..geometry import Array, Pose, POSE_SIZE, TRANSLATION
from ..jit import jit, kernel
from ..linalg import inverse_of_information
from ..model.lens import closed_form, FOCAL, K
from ..model.observation import Observation
from ..model.prior import LensPrior

# Smallest rise of the information's log-determinant for a view to replace another, and for a new
# fit with marginalised views. A fit may wait: their information is in the prior.
_WORTH_A_PLACE = 0.2
_WORTH_A_FIT = 0.4

# Relative standard deviation of the focal length below which a view determines it.
_DETERMINED = 0.3


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
