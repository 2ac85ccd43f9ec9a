# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""
How well a camera is known where it was seen, and what is missing.

The projection uncertainty is the standard deviation, in px, of the pixel that sees a given
direction. A turn of the camera is not counted: the poses of the boards turn with it, so no
observation can tell it, and no user of the camera notices it.

This module stands alone because it judges a fit; ``self_calibration`` decides what follows.
"""

from __future__ import annotations

from dataclasses import dataclass
import math

import numpy as np

from .joint_fit import JointFit
from .results import CalibrationOptions, CalibrationState, COVERAGE_SHAPE, LARGEST_VARIANCE
from ..cameras.division import DivisionCamera
from ..geometry import Array, Mask, POSE_SIZE
from ..jit import jit
from ..model.lens import (
    camera_from_lens,
    CX,
    CY,
    FOCAL,
    LENS_END,
    lens_from_camera,
    LENS_SIZE,
    linearise_rotated,
)
from ..model.observation import image_center_px

# With a larger standard deviation of the focal length (relative), or of a projection, as a share
# of the focal length, the camera is UNCALIBRATED.
_ROUGH_FOCAL = 0.15
_ROUGH_PROJECTION = 0.15

# Parts of the image in which points must have been seen.
_FEWEST_SPOTS = 2

# Boards that are tilted less hardly determine the focal length.
_SOME_TILT_DEG = 15.0


class Coverage:
    """The parts of the image in which points were seen, and the outermost of them."""

    def __init__(self, image_size: tuple[int, int], seen: Mask | bool = False) -> None:
        self._image_size = image_size
        self.seen: Mask = np.zeros(COVERAGE_SHAPE, dtype=bool) | seen

    def add(self, pixels: Array) -> None:
        """Add points (N, 2), px of the image."""
        rows, columns = COVERAGE_SHAPE
        width, height = self._image_size
        x = np.clip((pixels[:, 0] + 0.5) * columns / width, 0, columns - 1).astype(int)
        y = np.clip((pixels[:, 1] + 0.5) * rows / height, 0, rows - 1).astype(int)
        self.seen[y, x] = True

    def pixels(self, center_px: tuple[float, float], radius_px: float) -> Array:
        """Return the middles (n, 2) of the parts in which points were seen, within a radius."""
        rows, columns = COVERAGE_SHAPE
        width, height = self._image_size
        y, x = np.nonzero(self.seen)
        middles = np.stack(
            [(x + 0.5) * width / columns - 0.5, (y + 0.5) * height / rows - 0.5], axis=-1
        )
        off = middles - center_px
        radii = np.linalg.norm(off, axis=1, keepdims=True)
        inside: Array = center_px + off * np.minimum(1.0, radius_px / np.maximum(radii, 1e-9))
        return inside


@dataclass(frozen=True, slots=True)
class Uncertainty:
    """
    How well a camera is known.

    focal: standard deviation of the focal length, as a share of it; center: of the centre, as a
    share of the diagonal; projection_px: largest one of a projection where points were seen.
    """

    focal: float
    center: float
    projection_px: float


def uncertainty_of(
    fit: JointFit, coverage: Coverage, seen_radius_px: float, image_size: tuple[int, int]
) -> Uncertainty | None:
    """Return how well the camera of a fit is known; None if that is not known."""
    covariance = fit.full_covariance[:LENS_SIZE, :LENS_SIZE]
    variances = np.diag(covariance)
    # Rounding may leave negative variances if the numbers are extreme.
    if not (variances >= 0.0).all() or not variances.max() < LARGEST_VARIANCE:
        return None
    camera = camera_from_lens(fit.lens, image_center_px(image_size))
    pixels = coverage.pixels(camera.center_px, seen_radius_px)
    sigmas = projection_sigmas_px(camera, covariance, pixels)
    largest_px = float(sigmas.max(initial=0.0))
    # From one spot a turn of the camera explains all.
    if len(sigmas) < _FEWEST_SPOTS or not math.isfinite(largest_px):
        return None
    return Uncertainty(
        math.sqrt(variances[FOCAL]) / fit.lens[FOCAL],
        math.sqrt(max(variances[CX], variances[CY])) / math.hypot(*image_size),
        largest_px,
    )


def state_of(
    uncertainty: Uncertainty | None, focal_px: float, views: int, options: CalibrationOptions
) -> CalibrationState:
    """Return the state of a camera that is known so well, from so many views."""
    if uncertainty is None or not (
        uncertainty.focal < _ROUGH_FOCAL
        and uncertainty.projection_px < _ROUGH_PROJECTION * focal_px
    ):
        return CalibrationState.UNCALIBRATED
    calibrated = (
        views >= options.min_views
        and uncertainty.focal < options.focal_tolerance
        and uncertainty.center < options.center_tolerance
        and uncertainty.projection_px < options.projection_tolerance_px
    )
    return CalibrationState.CALIBRATED if calibrated else CalibrationState.CONVERGING


def projection_sigmas_px(
    camera: DivisionCamera, covariance: Array, pixels: Array, seen: Array | None = None
) -> Array:
    """
    Return the standard deviations (n,) of projections at pixels (n, 2), in the worst direction.

    covariance (10, 10) of the camera, as that of ``CameraEstimate``. Error in the rotation of the
    camera is taken out: of D δ, the displacement by an error δ of the camera, the part R ω that a
    turn ω explains, R (RᵀR)⁻¹ Rᵀ D δ. seen (m, 2): the pixels at which the turn explains most, by
    default the same.
    """
    turns, by_lens = _derivatives(camera, pixels)
    seen_turns, seen_by_lens = (turns, by_lens) if seen is None else _derivatives(camera, seen)
    by_lens = by_lens - turns @ np.linalg.lstsq(seen_turns, seen_by_lens, rcond=None)[0]
    each = by_lens.reshape(len(pixels), 2, LENS_SIZE)
    with np.errstate(all='ignore'):  # of extreme cameras it is infinite
        variances = each @ covariance @ each.transpose(0, 2, 1)
        a, b, d = variances[:, 0, 0], variances[:, 0, 1], variances[:, 1, 1]
        largest = 0.5 * (a + d) + np.sqrt((0.5 * (a - d)) ** 2 + b**2)
        sigmas: Array = np.nan_to_num(np.sqrt(np.maximum(largest, 0.0)), nan=np.inf)
    return sigmas


def _derivatives(camera: DivisionCamera, pixels: Array) -> tuple[Array, Array]:
    """Return the derivatives of pixels by a turn (2 n, 3) and by the lens (2 n, 10)."""
    n = len(pixels)
    rays = camera.unproject(pixels)
    rays = rays / np.linalg.norm(rays, axis=1, keepdims=True)
    lens = lens_from_camera(camera, camera.center_px)
    rows = np.empty((n, 2, LENS_END))
    _project_rows(rays, lens, pixels - camera.center_px, rows)
    flat = np.nan_to_num(rows.reshape(2 * n, LENS_END), posinf=0.0, neginf=0.0)
    return flat[:, :3], flat[:, LENS_END - LENS_SIZE :]


@jit
def _project_rows(rays: Array, lens: Array, pixels: Array, rows: Array) -> None:
    """Write the derivatives (n, 2, 16) of the pixels of rays by a turn, and by the lens."""
    at_origin = np.zeros(POSE_SIZE)
    for i in range(len(rays)):
        x, y, z = rays[i]
        linearise_rotated(x, y, z, at_origin, lens, pixels[i, 0], pixels[i, 1], rows[i])


def missing_views(
    fit: JointFit,
    coverage: Coverage,
    uncertainty: Uncertainty | None,
    options: CalibrationOptions,
) -> tuple[str, ...]:
    """Return what would make the camera known better, as advice to the person with the board."""
    views = len(fit.views)
    if uncertainty is None or views == 0:
        return ('show the board',)
    advice = []
    tilts = [_tilt_deg(row) for row in fit.poses]
    if max(tilts) < _SOME_TILT_DEG or (
        uncertainty.focal >= options.focal_tolerance and np.median(tilts) < _SOME_TILT_DEG
    ):
        advice.append('tilt the board by 30 to 60 degrees')
    advice += _empty_parts(coverage.seen)
    if views < options.min_views:
        more = options.min_views - views
        advice.append(f'{more} more different view{"s" if more > 1 else ""}')
    if uncertainty.center >= options.center_tolerance:
        advice.append('rotate the camera or the board by 90 degrees about the optical axis')
    if uncertainty.focal >= options.focal_tolerance and len(advice) == 0:
        advice.append('tilt the board in other directions')
    if uncertainty.projection_px >= options.projection_tolerance_px and len(advice) == 0:
        advice.append('move the board closer, so that it fills the image')
    return tuple(advice)


def _tilt_deg(row: Array) -> float:
    """Return the angle of the board against the image plane."""
    return math.degrees(math.acos(min(abs(float(row[8])), 1.0)))


def _empty_parts(seen: Mask) -> list[str]:
    """Return the thirds of the image without points."""
    empty = []
    for j, vertical in enumerate(('upper', 'middle', 'lower')):
        for i, horizontal in enumerate(('left', 'middle', 'right')):
            rows = np.array_split(np.arange(COVERAGE_SHAPE[0]), 3)[j]
            columns = np.array_split(np.arange(COVERAGE_SHAPE[1]), 3)[i]
            if not seen[np.ix_(rows, columns)].any():
                name = f'{vertical} {horizontal}'.replace('middle middle', 'middle')
                empty.append(f'no points in the {name} third of the image')
    return empty
