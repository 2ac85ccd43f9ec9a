# SPDX-License-Identifier: Apache-2.0
"""How sure one view is: the covariance of its estimate, and what it cannot tell at all."""

from __future__ import annotations

from dataclasses import dataclass
import math

import numpy as np

from .geometry import Array
from .problem import POSE_AND_CAMERA
from .solution import G, H, Solution, TRANSLATION

# The noise of a corner where four points leave no residual to measure it by, px.
DEFAULT_SIGMA_PX = 0.5

# Eigenvalues of the scaled JᵀJ below this share of the largest are rounding, not information.
_NO_INFORMATION = 1e-13

# A quantity counts as observable while its standard deviation is below: a share of itself for
# focal length and distance, radians for the direction of the board, and for the distortion the
# change of k |d|² at the image's corner.
_MAX_SHARE = 0.3
_MAX_DIRECTION_RAD = 0.3
_MAX_BEND = 0.3


@dataclass(frozen=True, slots=True)
class Observability:
    """
    Which quantities a view determines.

    direction: the board's orientation; distance: its translation along the line of sight;
    focal: the focal length; distortion: k.
    """

    direction: bool = False
    distance: bool = False
    focal: bool = False
    distortion: bool = False


def noise_variance(squares: float, count: int, unknowns: int, sigma_px: float | None) -> float:
    """Return the variance of a coordinate, px²: given, or measured where points are to spare."""
    spare = 2 * count - unknowns
    if sigma_px is not None:
        return sigma_px**2
    return squares / spare if spare > 0 else DEFAULT_SIGMA_PX**2


def covariance_from(
    normal: Array, unknowns: int, variance: float, row: Array, board_mean: Array
) -> Array:
    """
    Return the (8, 8) covariance of x, y, z, rotation x, y, z, focal_px, k.

    normal is JᵀJ by rotation, translation of the centred board, g, h; where the camera is known
    (six unknowns) the rows and columns of focal_px and k are zero. board_mean (2,) is what was
    taken off the board's points to centre them.
    """
    inside = np.zeros((POSE_AND_CAMERA, POSE_AND_CAMERA))
    inside[:unknowns, :unknowns] = _inverse(normal[:unknowns, :unknowns])
    # From (ω, t of the centred board, g, h) to (t of the board's origin, ω, f, k):
    #     t = t_c - R m,   dt = dt_c - ω x R m,     k = g h.
    mx, my, mz = row[:TRANSLATION].reshape(3, 3)[:, :2] @ board_mean
    to_public = np.zeros((POSE_AND_CAMERA, POSE_AND_CAMERA))
    to_public[0:3, 0:3] = [[0.0, -mz, my], [mz, 0.0, -mx], [-my, mx, 0.0]]
    to_public[0:3, 3:6] = to_public[3:6, 0:3] = np.eye(3)
    to_public[6, 6] = 1.0
    to_public[7, 6:8] = row[H], row[G]
    covariance: Array = variance * (to_public @ inside @ to_public.T)
    return covariance


def _inverse(normal: Array) -> Array:
    """Invert JᵀJ; what it holds no information on gets a huge variance, not a made-up one."""
    scale = 1.0 / np.sqrt(np.maximum(np.diag(normal), 1e-300))
    values, vectors = np.linalg.eigh(normal * np.outer(scale, scale))
    values = np.maximum(values, _NO_INFORMATION * values[-1])
    inverse: Array = np.outer(scale, scale) * ((vectors / values) @ vectors.T)
    return inverse


def observability_of(model: Solution, covariance: Array, corner_px: float) -> Observability:
    """Judge by the standard deviations; corner_px is the image corner's distance from centre."""
    focal_px = model.camera.focal_px
    translation = model.camera_from_board.translation
    distance = float(np.linalg.norm(translation))
    along = translation / distance
    deviation_along = math.sqrt(along @ covariance[:3, :3] @ along)
    direction_rad = math.sqrt(float(np.linalg.eigvalsh(covariance[3:6, 3:6])[-1]))
    bend = math.sqrt(covariance[7, 7]) * (corner_px / focal_px) ** 2
    return Observability(
        direction=direction_rad < _MAX_DIRECTION_RAD,
        distance=deviation_along < _MAX_SHARE * distance,
        focal=math.sqrt(covariance[6, 6]) < _MAX_SHARE * focal_px,
        distortion=bend < _MAX_BEND,
    )
