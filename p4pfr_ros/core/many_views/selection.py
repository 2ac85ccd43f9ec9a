# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""Which views are worth keeping: those that are new, and tell most of the camera together."""

from __future__ import annotations

from collections.abc import Sequence
import math

import numpy as np

from .bundle_adjustment import POSE_SIZE
from .joint_fit import JointFit
from .view_by_fit import SeenByFit
from ..cameras.division import DivisionCamera
from ..geometry import Array, Pose
from ..jit import jit, kernel
from ..minimal.solution import TRANSLATION
from ..model.lens import closed_form, FOCAL, K
from ..model.prior import inverse_of, Knowledge

# The log-determinant of the information must rise by so much: for a view to take another's place,
# and for what was remembered of many to be fitted. Nothing is lost by waiting.
_WORTH_A_PLACE = 0.2
_WORTH_A_FIT = 0.4

# A view tells the focal length that it knows to this share.
_TOLD = 0.3


def distance_to_views_px(
    board_points: Array, camera_from_board: Pose, kept: Array, camera: DivisionCamera
) -> float:
    """
    Return how far a view is from the nearest kept one: root mean square of its corners' ways.

    kept are the poses (V, 12), in board units. The corners are those of the rectangle about the
    view's board points. Another board in the same place counts as the same view, which it nearly
    is.
    """
    (left, bottom), (right, top) = board_points.min(axis=0), board_points.max(axis=0)
    corners = np.array([[left, bottom], [right, bottom], [right, top], [left, top]])
    poses = np.vstack([rows_of([camera_from_board]), kept])
    if camera.k2 == 0.0 and camera.k3 == 0.0:
        return camera.focal_px * math.sqrt(nearest(corners, poses, camera.k))
    rotations, places = poses[:, :TRANSLATION].reshape(-1, 3, 3), poses[:, TRANSLATION:]
    seen_px = camera.project(corners @ rotations[:, :, :2].transpose(0, 2, 1) + places[:, None])
    ways2 = np.sum((seen_px[1:] - seen_px[0]) ** 2, axis=-1).mean(axis=-1)
    # A corner that no pixel sees is not where the kept view has it.
    return math.sqrt(np.nan_to_num(ways2, nan=np.inf).min(initial=np.inf))


def poses_of(fit: JointFit) -> Array:
    """Return the poses (V, 12) of a fit's views, in board units."""
    pairs = zip(fit.views, fit.poses, strict=True)
    return rows_of([view.pose_from_row(row) for view, row in pairs])


def rows_of(poses: Sequence[Pose]) -> Array:
    """Return the numbers (V, 12) of poses: rotations, row by row, and translations."""
    rows = [np.concatenate([pose.rotation.ravel(), pose.translation]) for pose in poses]
    return np.array(rows).reshape(-1, POSE_SIZE)


@jit
def nearest(corners: Array, poses: Array, k: float) -> float:
    """
    Return the mean square of the corners' ways from the first pose (12,) to the nearest other.

    Of a lens of one parameter, in squares of its focal length; infinite where there is no other,
    or each has a corner where no pixel sees it.
    """
    best = math.inf
    for v in range(1, len(poses)):
        total = 0.0
        for i in range(len(corners)):
            x, y = _seen(poses[0], corners[i, 0], corners[i, 1], k)
            x_there, y_there = _seen(poses[v], corners[i, 0], corners[i, 1], k)
            total += (x_there - x) ** 2 + (y_there - y) ** 2
        if total < best:
            best = total
    return best / len(corners)


@kernel
def _seen(pose: Array, bx: float, by: float, k: float) -> tuple[float, float]:
    x = pose[0] * bx + pose[1] * by + pose[TRANSLATION]
    y = pose[3] * bx + pose[4] * by + pose[TRANSLATION + 1]
    z = pose[6] * bx + pose[7] * by + pose[TRANSLATION + 2]
    s = closed_form(z, k, x * x + y * y)
    return s * x, s * y


def least_telling(fit: JointFit, told_anew: Array) -> int | None:
    """
    Return which of a fit's views to give up for a new one; None: the new one is not worth it.

    told_anew (6, 6), px², is what the new one tells of the lens. What is left must have the
    largest determinant of its information: the smallest volume of uncertainty.
    """
    free = slice(K + fit.order)
    told = np.concatenate([fit.told, told_anew[None]])[:, free, free]
    volumes = _log_volumes(fit.prior[free, free] + told.sum(axis=0) - told)
    best = int(np.argmax(volumes))
    return best if volumes[best] > volumes[-1] + _WORTH_A_PLACE else None


def is_worth_a_fit(fit: JointFit, information: Array) -> bool:
    """Say whether so much more information (6, 6), px², is worth fitting again."""
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


def tells_focal(seen: SeenByFit, common: Knowledge) -> bool:
    """Say whether a view alone tells the focal length of a camera of which no more is known."""
    told = seen.told + common.weighed(seen.fit.variance).information
    free = K + seen.fit.order
    variance = seen.fit.variance * inverse_of(told[:free, :free])[FOCAL, FOCAL]
    return bool(variance < (_TOLD * seen.fit.lens[FOCAL]) ** 2)
