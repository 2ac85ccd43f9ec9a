# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""OpenCV, and so image_proc, undistorts with our camera models as we do."""

from board_views import HEAD_ON
import cv2
from fisheyes import equidistant_fit
import numpy as np
from p4pfr_ros import DivisionCamera, Pose
from p4pfr_ros.boards import Chessboard
from p4pfr_ros.core.cameras.camera_info import CameraInfoModel
from p4pfr_ros.detection import detect
from p4pfr_ros.rendering import render
import pytest

SIZE = (1280, 960)
CENTER = (639.5, 479.5)
BOARD = Chessboard(columns=11, rows=8, square_m=0.1)


def matrix(focal_px, center_px):
    return np.array([[focal_px[0], 0, center_px[0]], [0, focal_px[1], center_px[1]], [0, 0, 1.0]])


def rectifying_maps(model, rectified_focal_px):
    """Return the maps (960, 1280) from rectified to raw pixels, as image_proc computes them."""
    is_fisheye = model.distortion_model == 'equidistant'
    make = cv2.fisheye.initUndistortRectifyMap if is_fisheye else cv2.initUndistortRectifyMap
    k = matrix(model.focal_px, model.center_px)
    p = matrix((rectified_focal_px, rectified_focal_px), model.center_px)
    return make(k, np.array(model.coefficients), np.eye(3), p, SIZE, cv2.CV_32FC1)


@pytest.mark.parametrize(
    ('f', 'k', 'k2', 'k3', 'kind', 'within_px'),
    [
        (1000, -0.15, 0.0, 0.0, 'rational_polynomial', 0.001),
        (700, -0.20, 0.0, 0.0, 'rational_polynomial', 0.01),
        (600, -0.25, 0.0, 0.0, 'rational_polynomial', 0.05),
        (600, -0.35, 0.0, 0.0, 'rational_polynomial', 0.1),
        (700, -0.25, 0.02, -0.003, 'rational_polynomial', 0.01),
        (1000, 0.1, 0.0, 0.0, 'rational_polynomial', 0.001),
        (600, -0.45, 0.0, 0.0, 'equidistant', 0.1),
        (400, -0.25, 0.0, 0.0, 'equidistant', 0.01),
        (300, -0.25, 0.0, 0.0, 'equidistant', 0.02),
    ],
)
def test_opencv_undistorts_like_the_division_camera(f, k, k2, k3, kind, within_px):
    """OpenCV maps each rectified pixel to the division camera's projection of its ray."""
    camera = DivisionCamera(f, CENTER, k, k2, k3)
    model = camera.to_camera_info_model(SIZE)
    assert model.distortion_model == kind
    # The rectified image contains the corners of the raw image, but at most 85 degrees.
    corner = camera.unproject([-0.5, -0.5])
    farthest = np.hypot(*corner[:2]) / corner[2] if corner[2] > 0.09 else 11.4
    focal_px = 800.0 / farthest
    mapped = np.stack(rectifying_maps(model, focal_px), axis=-1).astype(float)
    x, y = np.meshgrid(
        (np.arange(1280) - CENTER[0]) / focal_px, (np.arange(960) - 479.5) / focal_px
    )
    expected = camera.project(np.stack([x, y, np.ones_like(x)], axis=-1))
    inside = (np.abs(expected - CENTER) <= (640.0, 480.0)).all(axis=-1)
    assert (np.ptp(expected[inside], axis=0) > (1050.0, 950.0)).all()
    error_px = np.linalg.norm(mapped - expected, axis=-1)[inside]
    assert error_px.max() < within_px
    assert error_px.max() < model.residual_px + 2e-4  # OpenCV computes in single precision


@pytest.mark.parametrize(
    ('f', 'k', 'distance_m', 'zoom'),
    [(600.0, -0.25, 0.6, 0.8), (600.0, -0.35, 0.5, 0.6), (400.0, -0.25, 0.32, 0.6)],
)
def test_a_rectified_grid_has_straight_lines(f, k, distance_m, zoom):
    camera = DivisionCamera(f, CENTER, k)
    pose = Pose.from_rotation_vector((0.15, -0.1, 0.05), (0.0, 0.0, distance_m)) @ HEAD_ON
    raw = render(BOARD, camera, pose, SIZE, blur_sigma_px=0.7)
    maps = rectifying_maps(camera.to_camera_info_model(SIZE), zoom * f)
    rectified = cv2.remap(raw, *maps, cv2.INTER_CUBIC)
    assert bend_px(raw) > 20.0
    assert bend_px(rectified) < 0.1


def bend_px(image):
    """Return the largest distance of a corner from the straight line of its row or column."""
    detection = detect(image, BOARD)
    assert len(detection.ids) == BOARD.columns * BOARD.rows
    grid = detection.image_points[np.argsort(detection.ids)].reshape(BOARD.rows, BOARD.columns, 2)
    lines = [line - line.mean(axis=0) for line in (*grid, *grid.swapaxes(0, 1))]
    return max(np.abs(line @ np.linalg.svd(line)[2][1]).max() for line in lines)


@pytest.mark.parametrize(
    ('kind', 'coefficients'),
    [
        ('plumb_bob', (-0.3, 0.12, 1e-3, -8e-4, -0.02)),
        ('plumb_bob', (0.1, 0.05, -2e-3, 1e-3, 0.01)),
        ('rational_polynomial', (0.8, 0.13, 4e-4, -3e-4, 0.002, 1.05, 0.27, 0.013)),
        ('equidistant', (-0.02, 0.005, -0.003, 5e-4)),
    ],
)
def test_undistorted_points_are_projected_back_by_opencv(kind, coefficients):
    """Our unprojection inverts OpenCV's projection."""
    model = CameraInfoModel(kind, coefficients, (900.0, 905.0), (650.0, 470.0), 0.0, SIZE)
    points = np.random.default_rng(4).uniform((0, 0), SIZE, (500, 2))
    rays = model.unproject(points)
    rays /= rays[:, 2:]
    project = cv2.fisheye.projectPoints if kind == 'equidistant' else cv2.projectPoints
    k, d = matrix(model.focal_px, model.center_px), np.array(coefficients)
    back = project(rays[:, None], np.zeros(3), np.zeros(3), k, d)[0][:, 0]
    np.testing.assert_allclose(back, points, atol=1e-9)


@pytest.mark.parametrize('fov_deg', [140, 185])
def test_opencv_undistorts_a_fisheye_where_it_was_seen(fov_deg):
    """And gives every pixel of the dark corners a ray, farther from the axis than those inside."""
    camera, seen_px = equidistant_fit(fov_deg)
    model = camera.to_camera_info_model(SIZE, seen_px)
    k, d = matrix(model.focal_px, model.center_px), np.array(model.coefficients)
    x, y = np.meshgrid(np.linspace(-0.5, 1279.5, 60), np.linspace(-0.5, 959.5, 45))
    pixels = np.stack([x, y], axis=-1).reshape(-1, 2)
    radius_px = np.linalg.norm(pixels - camera.center_px, axis=1)
    rays = model.unproject(pixels)
    assert np.isfinite(rays).all()
    # OpenCV's fisheye points are on the plane in front: at most 85 degrees.
    front = rays[:, 2] > np.cos(np.radians(85.0))
    flat = cv2.fisheye.undistortPoints(pixels[front, None], k, d)[:, 0]
    np.testing.assert_allclose(flat, rays[front, :2] / rays[front, 2:], rtol=1e-3, atol=1e-4)
    seen = camera.project(np.column_stack([flat, np.ones(len(flat))]))
    inside = radius_px[front] < seen_px
    assert np.linalg.norm(seen - pixels[front], axis=1)[inside].max() < 0.06


@pytest.mark.parametrize('f', [1000.0, 1500.0])
def test_opencv_undistorts_a_camera_with_aspect_and_decentring(f):
    camera = DivisionCamera(f, CENTER, -0.15, aspect=1.04, p1=5e-4, p2=-3e-4)
    model = camera.to_camera_info_model(SIZE)
    assert model.distortion_model == 'rational_polynomial'
    mapped = np.stack(rectifying_maps(model, f), axis=-1).astype(float)
    x, y = np.meshgrid((np.arange(1280) - CENTER[0]) / f, (np.arange(960) - CENTER[1]) / f)
    expected = camera.project(np.stack([x, y, np.ones_like(x)], axis=-1))
    error_px = np.linalg.norm(mapped - expected, axis=-1)
    inside = (np.abs(expected - CENTER) <= (640.0, 480.0)).all(axis=-1)
    assert error_px[inside].max() < 0.1
