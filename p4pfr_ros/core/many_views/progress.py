# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""How far a calibration is, by the standard deviations of its camera; and that camera."""

from __future__ import annotations

import math

import numpy as np

from .camera_estimate import CameraEstimate
from .joint_fit import JointFit
from .results import CalibrationOptions, CalibrationState
from ..cameras.division import DivisionCamera
from ..geometry import Array
from ..model.lens import CX, FOCAL, K, LENS_SIZE

# Rougher than this, a share of the focal length or a bend of the corner, a camera is a guess.
_GUESS = 0.15


def progress_of(
    fit: JointFit,
    camera: DivisionCamera,
    others: int,
    image_size: tuple[int, int],
    options: CalibrationOptions,
    adopted: CameraEstimate | None,
) -> tuple[CalibrationState, CameraEstimate | None]:
    """
    Return how far a fit has come, and its camera, where that is more than a guess.

    others is how many views are remembered besides those that are fitted; adopted is the camera
    that was begun with, which knows how good its own fit was, while there is no view.
    """
    views, covariance = len(fit.views) + others, fit.covariance
    state = state_of(fit.lens, covariance, 0.5 * math.hypot(*image_size), views, options)
    if state is CalibrationState.UNCALIBRATED:
        return state, None
    if math.isnan(fit.rms_px):
        return state, adopted
    return state, CameraEstimate(camera, covariance, fit.rms_px, views)


def state_of(
    lens: Array, covariance: Array, corner_px: float, views: int, options: CalibrationOptions
) -> CalibrationState:
    """Judge a lens (6,) and its covariance (6, 6); corner_px is half the picture's diagonal."""
    # Numbers of next to nothing and of next to everything may leave rounding alone.
    if not (np.diag(covariance) >= 0.0).all():
        return CalibrationState.UNCALIBRATED
    focal_share = math.sqrt(covariance[FOCAL, FOCAL]) / lens[FOCAL]
    center_share = math.sqrt(np.diag(covariance)[CX:K].max()) / (2.0 * corner_px)
    # At the corner the ray's depth is  1 + k q + k2 q² + k3 q³,  q = |d|².
    q = (corner_px / lens[FOCAL]) ** 2
    by_terms = np.zeros(LENS_SIZE)
    by_terms[K:] = q, q**2, q**3
    bend = math.sqrt(by_terms @ covariance @ by_terms)
    if not (focal_share < _GUESS and bend < _GUESS):
        return CalibrationState.UNCALIBRATED
    sure = (
        views >= options.min_views
        and focal_share < options.focal_tolerance
        and center_share < options.center_tolerance
        and bend < options.bend_tolerance
    )
    return CalibrationState.CALIBRATED if sure else CalibrationState.CONVERGING
