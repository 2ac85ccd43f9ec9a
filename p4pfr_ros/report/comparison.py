# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""
Compares two cameras: by how many pixels their projections of the same directions differ.

A turn between the two is taken out: the poses of the boards turn with the camera, so no
observation can tell it. mrcal compares cameras in the same way.
"""

from __future__ import annotations

from dataclasses import dataclass
import math

import numpy as np
from p4pfr_ros import CameraEstimate, CameraInfoModel, DivisionCamera, Pose
from p4pfr_ros.core.geometry import Array
from p4pfr_ros.report.maps import cell_middles, seen_pixels, sees

# Steps to the best turn, and the size of a numerical derivative, radians.
_STEPS, _TURN_RAD = 10, 1e-6


@dataclass(frozen=True, slots=True, eq=False)
class CameraDifference:
    """
    The difference of two cameras in each cell of the image.

    Parameters
    ----------
    vectors_px : (rows, columns, 2) array
        Where the other camera sees the direction that a pixel of the camera sees, minus the pixel.
        NaN where one of them sees nothing.
    turn_deg
        The turn that was taken out, degrees.
    largest_px, rms_px
        Over the part of the image in which points were seen.

    """

    vectors_px: Array
    turn_deg: float
    largest_px: float
    rms_px: float

    @property
    def lengths_px(self) -> Array:
        """The lengths (rows, columns) of the vectors."""
        lengths: Array = np.linalg.norm(self.vectors_px, axis=-1)
        return lengths


def compare_cameras(
    estimate: CameraEstimate,
    other: DivisionCamera | CameraInfoModel,
    image_size: tuple[int, int],
    shape: tuple[int, int],
) -> CameraDifference:
    """
    Compare a camera with another one, in cells of the image (rows, columns).

    The turn between them is the one that explains most where points were seen.
    """
    seen = seen_pixels(estimate, image_size)
    turn = _best_turn(estimate.camera, other, seen)
    pixels = cell_middles(image_size, shape)
    vectors = _difference(estimate.camera, other, pixels, turn)
    vectors[~sees(estimate.camera, pixels)] = np.nan
    squares = np.sum(_difference(estimate.camera, other, seen, turn) ** 2, axis=1)
    return CameraDifference(
        vectors.reshape(*shape, 2),
        math.degrees(float(np.linalg.norm(turn))),
        math.sqrt(float(np.nanmax(squares, initial=0.0))),
        math.sqrt(float(np.nanmean(squares))) if np.isfinite(squares).any() else math.nan,
    )


def _best_turn(
    camera: DivisionCamera, other: DivisionCamera | CameraInfoModel, seen: Array
) -> Array:
    """Return the rotation vector (3,), radians, that minimises the difference at pixels (n, 2)."""
    turn = np.zeros(3)
    for _ in range(_STEPS):
        residuals = _difference(camera, other, seen, turn)
        columns = [
            (_difference(camera, other, seen, turn + _TURN_RAD * axis) - residuals) / _TURN_RAD
            for axis in np.eye(3)
        ]
        jacobian = np.stack(columns, axis=-1)
        valid = np.isfinite(residuals).all(axis=1) & np.isfinite(jacobian).all(axis=(1, 2))
        if valid.sum() < 2:
            break
        step = np.linalg.lstsq(
            jacobian[valid].reshape(-1, 3), -residuals[valid].ravel(), rcond=None
        )[0]
        turn = turn + step
        if np.abs(step).max() < _TURN_RAD:
            break
    return turn


def _difference(
    camera: DivisionCamera, other: DivisionCamera | CameraInfoModel, pixels: Array, turn: Array
) -> Array:
    rotation = Pose.from_rotation_vector(turn, np.zeros(3)).rotation
    difference: Array = other.project(camera.unproject(pixels) @ rotation.T) - pixels
    return difference
