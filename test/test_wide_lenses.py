# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""Calibration of fisheye lenses (OpenCV's equidistant model, not ours) from synthetic views."""

import math

import cv2
import numpy as np
from p4pfr_ros import CalibrationState, estimate_pose, EstimateOptions, SelfCalibration
from p4pfr_ros.boards import Chessboard
from p4pfr_ros.detection import detect
from p4pfr_ros.rendering import Renderer
from p4pfr_ros.scenes.camera_views import board_grid, draw_camera_view
from p4pfr_ros.scenes.instances import IMAGE_SIZE
import pytest

BOARD = board_grid(20, 10)
NOISE_PX = 0.3
CORNER_PX = 800.0


class Fisheye:
    """OpenCV's fisheye lens: image radius proportional to the angle from the axis."""

    def __init__(self, fov_deg, center_px=(646.0, 472.0)):
        self.half_rad = math.radians(0.5 * fov_deg)
        self.focal_px = CORNER_PX / self.half_rad
        self.center_px = center_px

    def project(self, points_in_camera):
        """Project points (..., 3); NaN beyond the field of view."""
        points = np.asarray(points_in_camera, dtype=np.float64)
        angle = np.arctan2(np.hypot(points[..., 0], points[..., 1]), points[..., 2])
        safe = np.where((angle < self.half_rad)[..., None], points, (0.0, 0.0, 1.0))
        f, (x, y) = self.focal_px, self.center_px
        k = np.array([[f, 0.0, x], [0.0, f, y], [0.0, 0.0, 1.0]])
        zero = np.zeros(3)
        pixels, _ = cv2.fisheye.projectPoints(safe.reshape(-1, 1, 3), zero, zero, k, np.zeros(4))
        visible = (angle < self.half_rad)[..., None]
        return np.where(visible, pixels.reshape(*points.shape[:-1], 2), np.nan)

    def unproject(self, points_px):
        """Return rays (..., 3)."""
        d = (np.asarray(points_px) - self.center_px) / self.focal_px
        angle = np.linalg.norm(d, axis=-1, keepdims=True)
        return np.concatenate([np.sinc(angle / np.pi) * d, np.cos(angle)], axis=-1)


def views_of(lens, count, seed):
    rng = np.random.default_rng(seed)
    ranges = {'noise_px': NOISE_PX, 'tilt_deg': (0.0, 60.0), 'distance': (0.35, 1.2)}
    return [draw_camera_view(rng, lens, BOARD, **ranges) for _ in range(count)]


@pytest.mark.parametrize(('fov_deg', 'times'), [(100, 1.3), (130, 1.35), (150, 1.6)])
@pytest.mark.parametrize('seed', [0, 1])
def test_a_fisheye_lens_is_calibrated_with_more_lens_terms(fov_deg, times, seed):
    lens = Fisheye(fov_deg)
    calibration = SelfCalibration(IMAGE_SIZE)
    for view in views_of(lens, 18, seed):
        calibration.update(view.image_points, view.board_points)
    camera = calibration.fused.camera
    assert calibration.state is CalibrationState.CALIBRATED
    assert camera.k2 != 0.0
    assert camera.focal_px == pytest.approx(lens.focal_px, rel=0.01)
    assert abs(camera.focal_px - lens.focal_px) < 4.0 * calibration.fused.focal_sigma_px
    squares = []
    for view in views_of(lens, 10, 100 + seed):  # not used in the fit
        estimate = estimate_pose(
            view.image_points,
            view.board_points,
            camera=camera,
            options=EstimateOptions(threshold_px=50.0),
        )
        points = np.pad(view.board_points, ((0, 0), (0, 1)))
        projected = camera.project(estimate.model.camera_from_board.transform(points))
        squares.append(np.sum((projected - view.image_points) ** 2, axis=1))
    assert np.sqrt(np.mean(squares)) < times * math.sqrt(2.0) * NOISE_PX


# At a smaller distance the sheet of 1 m seldom fits into the image of the narrow lens.
@pytest.mark.parametrize(
    ('fov_deg', 'distance'), [(100, (0.7, 1.1)), (130, (0.4, 0.8)), (150, (0.4, 0.8))]
)
def test_rendered_images_calibrate_a_fisheye_lens(fov_deg, distance):
    lens = Fisheye(fov_deg)
    board = Chessboard(columns=9, rows=6, square_m=0.1)
    renderer = Renderer(lens, IMAGE_SIZE)
    calibration = SelfCalibration(IMAGE_SIZE)
    # The whole sheet is inside the image.
    half = 0.5 * np.array(board.sheet_size_m)
    sheet = half * np.array([[-1, -1], [1, -1], [1, 1], [-1, 1], [0, 0]])
    rng = np.random.default_rng(0)
    for _ in range(12):
        view = draw_camera_view(
            rng, lens, sheet, noise_px=0.0, tilt_deg=(10, 45), distance=distance
        )
        image = renderer.render(
            board, view.camera_from_board, noise_sigma=2.0, blur_sigma_px=0.5, seed=1
        )
        detection = detect(image, board)
        if not detection.reason:
            calibration.update(detection.image_points, detection.board_points)
    assert len(calibration.views) >= 8
    assert calibration.fused.rms_px < 0.2
    assert calibration.fused.camera.focal_px == pytest.approx(lens.focal_px, rel=0.01)
    assert np.abs(np.subtract(calibration.fused.camera.center_px, lens.center_px)).max() < 1.0
