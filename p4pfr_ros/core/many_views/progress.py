# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""
The state of a calibration, from the standard deviations of its camera.

This module stands alone because it is the one place that defines "calibrated".
"""

from __future__ import annotations

import math

import numpy as np

from .joint_fit import JointFit
from .results import CalibrationOptions, CalibrationState, CameraEstimate
from ..cameras.division import DivisionCamera
from ..geometry import Array
from ..model.lens import CX, FOCAL, K, LENS_SIZE

# With larger uncertainties, relative to the focal length or of the bend at the corner, there is no
# camera yet.
_ROUGH = 0.15


def progress_of(
    fit: JointFit,
    camera: DivisionCamera,
    marginalised: int,
    image_size: tuple[int, int],
    options: CalibrationOptions,
    loaded: CameraEstimate | None,
) -> tuple[CalibrationState, CameraEstimate | None]:
    """
    Return the state of a fit, and its camera unless that is too rough.

    marginalised: the number of views that are not fitted any more; loaded: the camera that the
    calibration started from, which has the quality of its own fit while there is no view.
    """
    views, covariance = len(fit.views) + marginalised, fit.covariance
    state = state_of(fit.lens, covariance, 0.5 * math.hypot(*image_size), views, options)
    if state is CalibrationState.UNCALIBRATED:
        return state, None
    if math.isnan(fit.rms_px):
        return state, loaded
    return state, CameraEstimate(camera, covariance, fit.rms_px, views)


def state_of(
    lens: Array, covariance: Array, corner_px: float, views: int, options: CalibrationOptions
) -> CalibrationState:
    """Judge a lens (6,) and its covariance (6, 6); corner_px is half the image diagonal."""
    # With extreme numbers only rounding may be left.
    if not (np.diag(covariance) >= 0.0).all():
        return CalibrationState.UNCALIBRATED
    focal_share = math.sqrt(covariance[FOCAL, FOCAL]) / lens[FOCAL]
    center_share = math.sqrt(np.diag(covariance)[CX:K].max()) / (2.0 * corner_px)
    # At the corner the ray's depth is  1 + k q + k2 q² + k3 q³,  q = |d|².
    q = (corner_px / lens[FOCAL]) ** 2
    by_terms = np.zeros(LENS_SIZE)
    by_terms[K:] = q, q**2, q**3
    bend = math.sqrt(by_terms @ covariance @ by_terms)
    if not (focal_share < _ROUGH and bend < _ROUGH):
        return CalibrationState.UNCALIBRATED
    calibrated = (
        views >= options.min_views
        and focal_share < options.focal_tolerance
        and center_share < options.center_tolerance
        and bend < options.bend_tolerance
    )
    return CalibrationState.CALIBRATED if calibrated else CalibrationState.CONVERGING
