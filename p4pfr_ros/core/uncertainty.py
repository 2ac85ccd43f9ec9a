# SPDX-License-Identifier: Apache-2.0
"""How sure one view is: the covariance of its estimate, and what it cannot tell at all."""

from __future__ import annotations

from dataclasses import dataclass
import math

import numpy as np

from .geometry import Array
from .jit import jit
from .refine import normal_equations, squared_error, UNKNOWNS
from .solution import Solution

# The noise of a corner where four points leave no residual to measure it by, px.
DEFAULT_SIGMA_PX = 0.5

# Eigenvalues of the scaled JᵀJ below this share of the largest are rounding, not information.
_NO_INFORMATION = 1e-13

# A quantity is called observable while its standard deviation is below: share of itself for
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

    direction: bool
    distance: bool
    focal: bool
    distortion: bool


def nothing_observable() -> Observability:
    """Return the answer of a view without a model."""
    return Observability(False, False, False, False)


def covariance_of(
    row: Array, image: Array, board: Array, board_mean: Array, sigma_px: float | None
) -> Array:
    """
    Return the (8, 8) covariance of x, y, z, rotation x, y, z, focal_px, k.

    From the Jacobian over the given inliers (board centred; its mean is the board's own origin's
    offset) and the noise: sigma_px, or measured from the residuals where there are any to spare.
    """
    normal = np.empty((UNKNOWNS, UNKNOWNS + 1))
    count, squares = _information(row, image, board, normal)
    spare = 2 * count - UNKNOWNS
    if sigma_px is not None:
        variance = sigma_px**2
    elif spare > 0:
        variance = squares / spare
    else:
        variance = DEFAULT_SIGMA_PX**2
    # From (ω, t of the centred board, g, h) to (t of the board's origin, ω, f, k):
    #     t = t_c - R m,   dt = dt_c - ω x R m,     k = g h.
    mx, my, mz = row[:9].reshape(3, 3)[:, :2] @ board_mean
    to_public = np.zeros((UNKNOWNS, UNKNOWNS))
    to_public[0:3, 0:3] = [[0.0, -mz, my], [mz, 0.0, -mx], [-my, mx, 0.0]]
    to_public[0:3, 3:6] = to_public[3:6, 0:3] = np.eye(3)
    to_public[6, 6] = 1.0
    to_public[7, 6:8] = row[13], row[12]
    covariance: Array = variance * (to_public @ _inverse(normal[:, :UNKNOWNS]) @ to_public.T)
    return covariance


@jit
def _information(row: Array, image: Array, board: Array, normal: Array) -> tuple[int, float]:
    """Write JᵀJ; return the number of points and the sum of their squared errors, px²."""
    jacobian = np.empty((2, UNKNOWNS + 1))
    squares = 0.0
    count = normal_equations(row, image, board, math.inf, normal, jacobian)
    for i in range(len(image)):
        squares += squared_error(row, image, board, i)
    return count, squares


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
    t = model.camera_from_board.translation
    distance = float(np.linalg.norm(t))
    along = t / distance
    deviation_along = math.sqrt(along @ covariance[:3, :3] @ along)
    direction = math.sqrt(float(np.linalg.eigvalsh(covariance[3:6, 3:6])[-1]))
    bend = math.sqrt(covariance[7, 7]) * (corner_px / focal_px) ** 2
    return Observability(
        direction=direction < _MAX_DIRECTION_RAD,
        distance=deviation_along < _MAX_SHARE * distance,
        focal=math.sqrt(covariance[6, 6]) < _MAX_SHARE * focal_px,
        distortion=bend < _MAX_BEND,
    )
