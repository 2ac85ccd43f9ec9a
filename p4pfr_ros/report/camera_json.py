# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""Cameras as JSON objects without NaN."""

from __future__ import annotations

import math
from typing import Any

from p4pfr_ros import BoardShape, CameraEstimate, CameraInfoModel


def camera_info_as_json(model: CameraInfoModel) -> dict[str, Any]:
    """Return a camera as in a CameraInfo message."""
    return {
        'distortion_model': model.distortion_model,
        'd': list(model.coefficients),
        'focal_px': list(model.focal_px),
        'center_px': list(model.center_px),
        'residual_px': model.residual_px,
        'residual_outside_px': model.residual_outside_px,
    }


def estimate_as_json(estimate: CameraEstimate) -> dict[str, Any]:
    """Return a self-calibrated camera; sigma: standard deviations, null for what is held."""
    camera, projection_px = estimate.camera, estimate.projection_sigma_px
    p1_sigma, p2_sigma = estimate.decentring_sigma
    return {
        'focal_px': camera.focal_px,
        'center_px': list(camera.center_px),
        'k': list(camera.terms[: camera.order]),
        'aspect': camera.aspect,
        'p1': camera.p1,
        'p2': camera.p2,
        'sigma': {
            'focal_px': _or_null(estimate.focal_sigma_px),
            'center_px': [_or_null(sigma) for sigma in estimate.center_sigma_px.tolist()],
            'k': [_or_null(sigma) for sigma in estimate.terms_sigma[: camera.order]],
            'aspect': _or_null(estimate.aspect_sigma),
            'p1': _or_null(p1_sigma),
            'p2': _or_null(p2_sigma),
        },
        'rms_px': estimate.rms_px,
        'views': estimate.views,
        'scatter': estimate.scatter,
        'projection_sigma_px': None if math.isnan(projection_px) else projection_px,
        'boards': {name: _shape_as_json(s) for name, s in estimate.board_shapes.items()},
    }


def _shape_as_json(shape: BoardShape) -> dict[str, float]:
    return {
        'bow_m': shape.bow,
        'bow_sigma_m': shape.bow_sigma,
        'stretch': shape.stretch,
        'stretch_sigma': shape.stretch_sigma,
        'skew_rad': shape.skew,
    }


def _or_null(sigma: float) -> float | None:
    """Replace the standard deviation 0 of a parameter that was held fixed by null."""
    return sigma or None
