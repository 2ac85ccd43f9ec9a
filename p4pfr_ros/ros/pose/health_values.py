# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""Numbers of a camera and of a view as /diagnostics lists them: always the same names."""

from __future__ import annotations

import math

import numpy as np
from p4pfr_ros import DivisionCamera, PoseEstimate
from p4pfr_ros.core.many_views.results import CameraEstimate

UNKNOWN = 'unknown'

# Places in a PoseEstimate's covariance.
_FOCAL, _K = 6, 7


def number(value: float, digits: int) -> str:
    """Write a number with so many digits after the point; what is not finite is unknown."""
    return f'{value:.{digits}f}' if math.isfinite(value) else UNKNOWN


def camera_values(fused: CameraEstimate | None, estimate: PoseEstimate | None) -> dict[str, str]:
    """List the fused camera, or where there is none what the last view tells of it."""
    focal = k = center_x = center_y = rms = (math.nan, math.nan)
    camera: DivisionCamera | None = None
    if fused is not None:
        camera = fused.camera
        focal, k = (camera.focal_px, fused.focal_sigma_px), (camera.k, fused.k_sigma)
        # A centre that has not been freed yet has no deviation: it is assumed, not known.
        sigma_x, sigma_y = (sigma or math.nan for sigma in fused.center_sigma_px.tolist())
        center_x, center_y = (camera.center_px[0], sigma_x), (camera.center_px[1], sigma_y)
        rms = (fused.rms_px, math.nan)
    elif estimate is not None and estimate.model is not None:
        camera = estimate.model.camera
        if estimate.observable.focal:
            focal = (camera.focal_px, _sigma(estimate, _FOCAL))
        if estimate.observable.distortion:
            k = (camera.k, _sigma(estimate, _K))
        center_x, center_y = (camera.center_px[0], math.nan), (camera.center_px[1], math.nan)
    return {
        'focal_px': number(focal[0], 2),
        'focal_sigma_px': number(focal[1], 2),
        'k': number(k[0], 5),
        'k_sigma': number(k[1], 5),
        'k2': number(camera.k2, 5) if camera is not None else UNKNOWN,
        'k3': number(camera.k3, 5) if camera is not None else UNKNOWN,
        'distortion_order': str(_order(camera)) if camera is not None else UNKNOWN,
        'center_x_px': number(center_x[0], 2),
        'center_x_sigma_px': number(center_x[1], 2),
        'center_y_px': number(center_y[0], 2),
        'center_y_sigma_px': number(center_y[1], 2),
        'calibration_rms_px': number(rms[0], 3),
    }


def view_values(estimate: PoseEstimate | None) -> dict[str, str]:
    """List what the last view was like."""
    if estimate is None:
        return dict.fromkeys(('inlier_ratio', 'rms_px', 'alternatives', 'stop'), UNKNOWN)
    return {
        'inlier_ratio': number(float(np.mean(estimate.inliers)), 3),
        'rms_px': number(estimate.rms_px, 3),
        'alternatives': str(len(estimate.alternatives)),
        'stop': estimate.status.value,
    }


def _sigma(estimate: PoseEstimate, place: int) -> float:
    variance = float(estimate.covariance[place, place])
    return math.sqrt(variance) if variance >= 0.0 else math.nan


def _order(camera: DivisionCamera) -> int:
    """Return how many coefficients the lens has."""
    if camera.k3 != 0.0:
        return 3
    return 2 if camera.k2 != 0.0 else 1
