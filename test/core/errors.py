# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""How far an estimate is from the truth, in the covariance's order."""

import numpy as np


def deviation(found, truth):
    """Return estimate minus truth (8,): x, y, z, rotation x, y, z, focal_px, k."""
    turn = found.camera_from_board.rotation @ truth.camera_from_board.rotation.T
    axial = [turn[2, 1] - turn[1, 2], turn[0, 2] - turn[2, 0], turn[1, 0] - turn[0, 1]]
    moved = found.camera_from_board.translation - truth.camera_from_board.translation
    focal_px = found.camera.focal_px - truth.camera.focal_px
    return np.array([*moved, *np.multiply(0.5, axial), focal_px, found.camera.k - truth.camera.k])


def look(camera, pose, board, noise_px=0.0, seed=0):
    """Return the image points (N, 2) of a board seen by a camera."""
    seen = camera.project(pose.transform(np.column_stack([board, np.zeros(len(board))])))
    return seen + np.random.default_rng(seed).normal(0.0, noise_px, seen.shape)
