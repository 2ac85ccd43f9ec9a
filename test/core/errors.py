# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""Image points of a board, and the error of an estimate from them."""

import numpy as np


def estimate_error(solution, truth):
    """Return estimate minus truth (8,) in the order of the covariance."""
    relative = solution.camera_from_board.rotation @ truth.camera_from_board.rotation.T
    axial = [
        relative[2, 1] - relative[1, 2],
        relative[0, 2] - relative[2, 0],
        relative[1, 0] - relative[0, 1],
    ]
    offset = solution.camera_from_board.translation - truth.camera_from_board.translation
    focal_px = solution.camera.focal_px - truth.camera.focal_px
    return np.array(
        [*offset, *np.multiply(0.5, axial), focal_px, solution.camera.k - truth.camera.k]
    )


def project_board(camera, pose, board, noise_px=0.0, seed=0):
    """Return the image points (N, 2) of a board, with noise."""
    image = camera.project(pose.transform(np.column_stack([board, np.zeros(len(board))])))
    return image + np.random.default_rng(seed).normal(0.0, noise_px, image.shape)
