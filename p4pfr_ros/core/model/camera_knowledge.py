# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""What is known of a camera before any view: what lenses are like, and what the caller knows."""

from __future__ import annotations

import math

import numpy as np

from .calibration_view import lens_of
from .lens import CX, CY, FOCAL, K, K2, K3, LENS_SIZE
from .prior import inverse_of, Knowledge
from ..cameras.division import DivisionCamera
from ..many_views.camera_estimate import CameraEstimate
from ..one_view.results import EstimateOptions

# Most cameras have a field of view of about 60° along the diagonal, give or take a factor, and
# bend the picture's corner by a share of about a third, by each term. This is so little that a
# handful of views overrules it, and enough that what they do not tell stays in its place.
_HALF_FOV_RAD = math.radians(30.0)
_FOCAL_SPREAD = 0.5
_BEND_SPREAD = 0.3


def common_camera(
    image_size: tuple[int, int], center_spread: float, robust: EstimateOptions
) -> Knowledge:
    """
    Return what most cameras are, and in its place what the caller's priors say.

    center_spread: how far the optical centre is from the middle, as a share of the diagonal.
    """
    diagonal_px = math.hypot(*image_size)
    corner_px = 0.5 * diagonal_px
    focal_px, focal_spread_px = robust.prior_focal_px, robust.prior_focal_sigma_px
    if focal_px is None or focal_spread_px is None:
        focal_px = corner_px / math.tan(_HALF_FOV_RAD)
        focal_spread_px = _FOCAL_SPREAD * focal_px
    corner2 = (corner_px / focal_px) ** 2
    mean, spread = np.zeros(LENS_SIZE), np.empty(LENS_SIZE)
    mean[FOCAL], mean[K] = focal_px, robust.prior_k
    spread[FOCAL] = focal_spread_px
    spread[CX] = spread[CY] = center_spread * diagonal_px
    spread[K] = robust.prior_k_sigma or _BEND_SPREAD / corner2
    spread[K2], spread[K3] = _BEND_SPREAD / corner2**2, _BEND_SPREAD / corner2**3
    return Knowledge.beforehand(mean, np.diag(spread**-2.0))


def saved_camera(
    estimate: CameraEstimate, middle_px: tuple[float, float], common: Knowledge
) -> Knowledge:
    """Return what an earlier calibration knows of its free terms, and the common camera's rest."""
    lens = lens_of(estimate.camera, middle_px)
    free = np.diag(estimate.covariance) > 0.0
    information = common.information.copy()
    information[np.ix_(free, free)] = inverse_of(estimate.covariance[np.ix_(free, free)])
    mean = np.where(free, lens, common.mean)
    return Knowledge.beforehand(mean, information, estimate.views)


def order_of(camera: DivisionCamera) -> int:
    """Return how many terms of the division polynomial a camera has; one at least."""
    return 3 if camera.k3 != 0.0 else 2 if camera.k2 != 0.0 else 1
