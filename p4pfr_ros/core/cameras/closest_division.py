# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""
Conversion from a CameraInfo model to the closest division camera.

This module stands alone because ``division`` converts the other way: in ``camera_info`` the two
modules would import each other.
"""

from __future__ import annotations

import math

import numpy as np

from .camera_info import CameraInfoModel, corner_radius_px, lens_map
from .division import DivisionCamera
from ..geometry import Array

# The number of terms is the smallest whose residual is below this, px.
_GOOD_ENOUGH_PX = 0.1
_TERMS = 4
_ANGLES = 400
_ALONG_A_SIDE = 33


def division_camera_from_model(model: CameraInfoModel) -> tuple[DivisionCamera, float]:
    """
    Return the division camera closest to a model, and its largest error, px.

    The error is the largest over the pixels that have a ray. The camera has the smallest number
    of terms with an error of at most 0.1 px, and decentring. The error is infinite if no division
    camera covers the image.
    """
    focal_px = model.focal_px[0]
    angle, p = _radial_profile(model, focal_px)
    pixels = _pixels(model.image_size)
    rays = model.unproject(pixels)
    candidates: list[tuple[float, int, DivisionCamera]] = []
    for terms in range(1, _TERMS + 1):
        camera = _fitted(angle, p, terms, model)
        if camera is None:
            continue
        error_px = np.linalg.norm(camera.project(rays) - pixels, axis=1)[~np.isnan(rays[:, 2])]
        residual_px = float(np.nan_to_num(error_px, nan=np.inf).max(initial=0.0))
        candidates.append((residual_px, terms, camera))
        if residual_px <= _GOOD_ENOUGH_PX:
            break
    if not candidates:
        aspect = model.focal_px[1] / focal_px
        return DivisionCamera(focal_px, model.center_px, aspect=aspect), math.inf
    residual_px, _, camera = min(candidates)
    return camera, residual_px


def _radial_profile(model: CameraInfoModel, focal_px: float) -> tuple[Array, Array]:
    """Return angles to the axis (n,) and their radii in px (n,), out to the farthest corner."""
    lens = lens_map(model.distortion_model, model.coefficients)
    corner = corner_radius_px(model.image_size, model.center_px) / focal_px
    radii = corner * (np.arange(_ANGLES) + 1.0) / _ANGLES
    # By the angle to the axis and not by x, where tangential terms would count as radial.
    ray = lens.undistort(np.stack([radii, np.zeros_like(radii)], axis=1))
    angle = np.arctan2(np.linalg.norm(ray[:, :2], axis=1), ray[:, 2])
    angle = angle[~np.isnan(angle)]
    return angle, focal_px * lens.radii(angle)


def _fitted(angle: Array, p: Array, terms: int, model: CameraInfoModel) -> DivisionCamera | None:
    """Fit  f + f k (p/f)² + ... = p cot θ,  a linear problem, with errors weighted to pixels."""
    if len(angle) <= terms + 1:
        return None
    focal_px = model.focal_px[0]
    # A change G of the left side changes p at the same angle by  sin²θ / (p θ') G.
    with np.errstate(all='ignore'):
        weight = np.sin(angle) ** 2 / (p * np.gradient(angle, p))
    if not np.isfinite(weight).all():
        return None
    powers = (p[:, None] / focal_px) ** (2.0 * np.arange(terms + 1))
    g = np.linalg.lstsq(weight[:, None] * powers, weight * p / np.tan(angle), rcond=None)[0]
    if not g[0] > 0.0:
        return None
    # g_i (p / focal_px)²ⁱ = f k_i (p / f)²ⁱ
    ratio = (g[0] / focal_px) ** (2.0 * np.arange(terms + 1))
    k = (g * ratio / g[0])[1:].tolist()
    k += [0.0] * (_TERMS - terms)
    p1 = p2 = 0.0
    if model.distortion_model != 'equidistant':
        # The model's decentring moves the pixel, the division camera's the ray: with both focal
        # lengths about equal, one is the other's inverse to first order.
        scale = focal_px / float(g[0])
        p1, p2 = (-number * scale for number in model.coefficients[2:4])
    aspect = model.focal_px[1] / focal_px
    try:
        return DivisionCamera(float(g[0]), model.center_px, k[0], k[1], k[2], k[3], aspect, p1, p2)
    except ValueError:  # a coefficient is extreme
        return None


def _pixels(image_size: tuple[int, int]) -> Array:
    """Return pixels (n, 2) over the whole image, its outer edges included."""
    x, y = (np.linspace(-0.5, size - 0.5, _ALONG_A_SIDE) for size in image_size)
    return np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2)
