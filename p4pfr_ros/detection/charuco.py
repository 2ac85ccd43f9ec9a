# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""
Detection of ChArUco boards: predict the chessboard corners from the markers, then refine them.

Each corner touches two markers. Each of them predicts the corner by its own homography, over a
distance so short that lens distortion is negligible. OpenCV's interpolation is not used: it
differs between versions and drops corners under strong distortion.

This module stands alone, as each finder of a family of boards does.
"""

from __future__ import annotations

from functools import lru_cache

import numpy as np
from numpy.typing import NDArray
from p4pfr_ros.boards import Charuco
from p4pfr_ros.core.geometry import Array, Ints, Mask
from p4pfr_ros.detection.candidates import BoardMarkers, find_board_markers
from p4pfr_ros.detection.explanations import explained
from p4pfr_ros.detection.saddles import refine_saddles, Saddles

# Predictions of one corner that differ by more, in squares, come from a misdetected marker.
_MAX_DISAGREEMENT_IN_SQUARES = 0.25
# Radius of the refinement patch, in distances from the corner to the nearest marker corner.
_RADIUS_IN_GAPS = 1.0
# A small gap leaves few pixels, and a fit that starts 2 px away may end beside the corner. In 400
# rendered views those with an error above 0.8 px had a misfit above 0.25, as 0.8 % of all had.
_MAX_MISFIT = 0.25
# Largest residual, in contrasts and in medians of the board. In 1,200 rendered views of 240x180 to
# 640x480 px, 3 of 16,301 corners have an error above 0.5 px, without this limit 11 of 16,425.
_MISFIT_OF_MODEL, _NOISE_IN_MEDIANS = 0.04, 1.5


def find_charuco(
    grey: NDArray[np.uint8], board: Charuco, min_marker_px: float
) -> tuple[Ints, Array, BoardMarkers]:
    """
    Find a board's corners in an image (h, w).

    Returns
    -------
    Ids (N,) (indices in the board's points), corners (N, 2) px, and the markers with what was
    rejected.

    """
    markers = explained(grey, board, find_board_markers(grey, board, min_marker_px))
    proper = _is_proper(markers.corners)
    ids, predicted, along, across = _predict(
        board, markers.corners[proper], markers.indices[proper]
    )
    if not len(ids):
        return ids, predicted, markers
    gap = 0.5 * (1.0 - board.marker_m / board.square_m) * np.sqrt(2.0)
    radius = min(_RADIUS_IN_GAPS * gap, 0.45)
    saddles = refine_saddles(grey, predicted, along, across, radius)
    good = _are_corners(saddles)
    return ids[good], saddles.points[good], markers


def _are_corners(saddles: Saddles) -> Mask:
    """Return (N,): whether each fit describes a corner of the board, and no other place."""
    good: Mask = saddles.good & (saddles.misfit < _MAX_MISFIT)
    if good.any():
        # Noise is the same all over a board; what the model lacks, such as blur, grows with the
        # contrast, which may be lower in a shadow.
        residual = saddles.misfit * saddles.contrast
        noise = np.median(residual[good])
        good &= residual < _MISFIT_OF_MODEL * saddles.contrast + _NOISE_IN_MEDIANS * noise
    return good


def _predict(board: Charuco, corners: Array, indices: Ints) -> tuple[Ints, Array, Array, Array]:
    """Return ids (N,), corners (N, 2) and the two sides of a square there, (N, 2) each, in px."""
    marker, corner = np.nonzero(_touching(board)[indices])
    homographies = _homographies(board.marker_corners[indices], corners)[marker]
    # Steps of a tenth of a square give the local directions of the sides.
    steps = 0.1 * board.square_m * np.array([[0, 0], [1, 0], [0, 1]])
    predicted = _apply(homographies, board.points[corner][:, None] + steps)
    ids, index, count = np.unique(corner, return_inverse=True, return_counts=True)
    mean = np.zeros((len(ids), 3, 2))
    np.add.at(mean, index, predicted)
    mean /= count[:, None, None]
    along, across = np.moveaxis(10.0 * (mean[:, 1:] - mean[:, :1]), 1, 0)
    # A corner touches two markers, so their predictions are equally far from the mean.
    disagreement_px = np.zeros(len(ids))
    off_mean_px = np.abs(predicted[:, 0] - mean[index, 0]).max(axis=1)
    np.maximum.at(disagreement_px, index, 2.0 * off_mean_px)
    side_px = np.minimum(np.linalg.norm(along, axis=1), np.linalg.norm(across, axis=1))
    good = disagreement_px < _MAX_DISAGREEMENT_IN_SQUARES * side_px
    return ids[good], mean[good, 0], along[good], across[good]


def _is_proper(corners: Array) -> Mask:
    """Return (M,): whether no three corners of a marker are collinear, so it has a homography."""
    side, next_side = np.roll(corners, -1, axis=1) - corners, np.roll(corners, 1, axis=1) - corners
    areas = side[..., 0] * next_side[..., 1] - side[..., 1] * next_side[..., 0]
    proper: Mask = np.abs(areas).min(axis=1, initial=np.inf) > 1e-3
    return proper


@lru_cache(maxsize=16)
def _touching(board: Charuco) -> Mask:
    """Return (M, N): whether each marker's square touches each corner."""
    centres = board.marker_corners.mean(axis=1)
    off_centre = np.abs(board.points - centres[:, None]).max(axis=2)
    touching: Mask = off_centre < 0.75 * board.square_m
    return touching


def _homographies(from_points: Array, to_points: Array) -> Array:
    """Return the homographies (M, 3, 3) between sets of four points, (M, 4, 2) each."""
    # With h₃₃ = 1:  h₁ · (x, y, 1) - u (h₃₁ x + h₃₂ y) = u,  and the same for v.
    (x, y), (u, v) = np.moveaxis(from_points, 2, 0), np.moveaxis(to_points, 2, 0)
    zero, one = np.zeros_like(x), np.ones_like(x)
    rows_u = np.stack([x, y, one, zero, zero, zero, -u * x, -u * y], axis=2)
    rows_v = np.stack([zero, zero, zero, x, y, one, -v * x, -v * y], axis=2)
    system = np.concatenate([rows_u, rows_v], axis=1)
    solved = np.linalg.solve(system, np.concatenate([u, v], axis=1)[..., None])[..., 0]
    return np.concatenate([solved, np.ones((len(solved), 1))], axis=1).reshape(-1, 3, 3)


def _apply(homographies: Array, points: Array) -> Array:
    """Map points (M, n, 2)."""
    padded = np.pad(points, ((0, 0), (0, 0), (0, 1)), constant_values=1.0)
    mapped = padded @ np.swapaxes(homographies, 1, 2)
    applied: Array = mapped[..., :2] / mapped[..., 2:]
    return applied
