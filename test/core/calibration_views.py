# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""Drawn cameras and their views, and calibrations from them."""

import math

import numpy as np
from p4pfr_ros import SelfCalibration
from p4pfr_ros.core.jit import COMPILED
from p4pfr_ros.core.model.lens import lens_from_camera
from p4pfr_ros.scenes.camera_views import board_grid, draw_camera, draw_camera_view
from p4pfr_ros.scenes.instances import IMAGE_SIZE
import pytest

compiled_only = pytest.mark.skipif(not COMPILED, reason='takes minutes interpreted')

MIDDLE_PX = (639.5, 479.5)
BOARD = board_grid(6, 4)
MARKER = np.array([[-0.5, 0.5], [0.5, 0.5], [0.5, -0.5], [-0.5, -0.5]])


class Equidistant:
    """A fisheye lens: the radius in the image is proportional to the angle from the axis."""

    def __init__(self, fov_deg, radius_px, center_px=(646.0, 472.0)):
        self.half_rad = math.radians(0.5 * fov_deg)
        self.focal_px = radius_px / self.half_rad
        self.center_px = center_px

    def project(self, points_in_camera):
        """Project points (..., 3); NaN beyond the field of view."""
        points = np.asarray(points_in_camera)
        rho = np.linalg.norm(points[..., :2], axis=-1, keepdims=True)
        angle = np.arctan2(rho, points[..., 2:])
        seen = np.where(angle < self.half_rad, angle, np.nan)
        return self.focal_px * seen / rho * points[..., :2] + self.center_px

    def unproject(self, points_px):
        """Return rays (..., 3)."""
        d = (np.asarray(points_px) - self.center_px) / self.focal_px
        angle = np.linalg.norm(d, axis=-1, keepdims=True)
        return np.concatenate([np.sinc(angle / np.pi) * d, np.cos(angle)], axis=-1)


def draw_views(camera, count, seed=0, board=BOARD, **options):
    """Draw views of a camera."""
    rng = np.random.default_rng([seed, 1])
    return [draw_camera_view(rng, camera, board, **options) for _ in range(count)]


def seeded_camera(seed):
    """Draw the camera of a seed."""
    return draw_camera(np.random.default_rng([seed, 0]))


def calibrate(views, calibration=None, board='', **options):
    """Update a calibration, by default a new one, with views; return it."""
    calibration = calibration or SelfCalibration(IMAGE_SIZE, **options)
    for view in views:
        calibration.update(view.image_points, view.board_points, board=board)
    return calibration


def verdicts(calibration, views):
    """Update a calibration with views; return the verdict on each."""
    result = []
    for view in views:
        calibration.update(view.image_points, view.board_points)
        result.append(calibration.verdict)
    return result


def lens_error(camera, truth):
    """Return a camera's errors (10,), in the order of ``CameraEstimate.covariance``."""
    return lens_from_camera(camera, MIDDLE_PX) - lens_from_camera(truth, MIDDLE_PX)
