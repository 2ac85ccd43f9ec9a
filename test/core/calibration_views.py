# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""Views to calibrate from."""

import numpy as np
from p4pfr_ros import SelfCalibration
from p4pfr_ros.core.jit import COMPILED
from p4pfr_ros.core.model.lens import lens_from_camera
from p4pfr_ros.scenes.camera_views import board_grid, draw_camera, draw_camera_view
from p4pfr_ros.scenes.instances import IMAGE_SIZE
import pytest

takes_long = pytest.mark.skipif(not COMPILED, reason='takes minutes interpreted')

MIDDLE_PX = (639.5, 479.5)
BOARD = board_grid(6, 4)
MARKER = np.array([[-0.5, 0.5], [0.5, 0.5], [0.5, -0.5], [-0.5, -0.5]])


def views_of(camera, count, seed=0, board=BOARD, **how):
    """Draw views of a camera."""
    rng = np.random.default_rng([seed, 1])
    return [draw_camera_view(rng, camera, board, **how) for _ in range(count)]


def drawn(seed):
    """Draw a camera."""
    return draw_camera(np.random.default_rng([seed, 0]))


def calibrated(views, calibration=None, **options):
    """Feed views to a calibration."""
    calibration = calibration or SelfCalibration(IMAGE_SIZE, **options)
    for view in views:
        calibration.update(view.image_points, view.board_points)
    return calibration


def verdicts(calibration, views):
    """Feed views to a calibration and return what became of each."""
    found = []
    for view in views:
        calibration.update(view.image_points, view.board_points)
        found.append(calibration.verdict)
    return found


def error(camera, truth):
    """Return the difference of two cameras' numbers (6,): focal_px, centre px, k, k2, k3."""
    return lens_from_camera(camera, MIDDLE_PX) - lens_from_camera(truth, MIDDLE_PX)
