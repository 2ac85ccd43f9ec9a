# SPDX-License-Identifier: Apache-2.0
"""Which views are worth keeping: those that are new, and tell most of the camera together."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from .camera import DivisionCamera
from .fused_answer import SeenByFit
from .geometry import Array, Pose
from .information import inverse_of, Knowledge
from .joint_fit import JointFit
from .lens import FOCAL, K

# A view must raise the information's log-determinant by this to take another's place: less is
# not worth a fit.
_WORTH_A_FIT = 0.05

# A view tells the focal length that it knows to this share.
_TOLD = 0.3


def distance_to_views_px(
    board_points: Array, camera_from_board: Pose, kept: Sequence[Pose], camera: DivisionCamera
) -> float:
    """
    Return how far a view is from the nearest kept one: root mean square of its corners' ways.

    The corners are those of the rectangle about the view's board points. Another board in the
    same place counts as the same view, which it nearly is.
    """
    if not kept:
        return np.inf
    (left, bottom), (right, top) = board_points.min(axis=0), board_points.max(axis=0)
    corners = np.array([[left, bottom, 0], [right, bottom, 0], [right, top, 0], [left, top, 0]])
    rotations = np.array([pose.rotation for pose in (camera_from_board, *kept)])
    places = np.array([pose.translation for pose in (camera_from_board, *kept)])
    seen_px = camera.project(corners @ rotations.transpose(0, 2, 1) + places[:, None])
    ways2 = np.sum((seen_px[1:] - seen_px[0]) ** 2, axis=-1).mean(axis=-1)
    # A corner that no pixel sees is not where the kept view has it.
    return float(np.sqrt(np.nan_to_num(ways2, nan=np.inf).min()))


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
    return best if volumes[best] > volumes[-1] + _WORTH_A_FIT else None


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
