# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""Covariances hold for cameras and boards that deviate."""

import numpy as np
from p4pfr_ros import DivisionCamera, estimate_pose, EstimateOptions, Pose
from p4pfr_ros.core.geometry import rotation_angle_rad
from p4pfr_ros.core.jit import COMPILED
from p4pfr_ros.scenes.deviating_view import Deviations, draw_deviating_view, draw_lens
import pytest

pytestmark = pytest.mark.skipif(not COMPILED, reason='takes minutes interpreted')

DEFAULT = EstimateOptions()
SIZE = (640, 480)
MIDDLE = np.array([319.5, 239.5])
HALF_DIAGONAL_PX = 400.0
MARKER = 0.075 * np.array([[-1.0, 1.0], [1.0, 1.0], [1.0, -1.0], [-1.0, -1.0]])
COLUMNS, ROWS = np.meshgrid(np.arange(9.0), np.arange(6.0)[::-1])
BOARD = 0.025 * np.column_stack([COLUMNS.ravel() - 4.0, ROWS.ravel() - 2.5])


def facing(rng, tilt_deg):
    """Return a rotation of a board that faces the camera, tilted about a random axis."""
    roll, axis = rng.uniform(-np.pi, np.pi, 2)
    tilt = np.radians(rng.uniform(*tilt_deg))
    turns = [[0.0, 0.0, roll], [tilt * np.cos(axis), tilt * np.sin(axis), 0.0], [np.pi, 0.0, 0.0]]
    a, b, c = (Pose.from_rotation_vector(turn, np.zeros(3)).rotation for turn in turns)
    return b @ a @ c


def draw(rng, project, board, depth, tilt_deg, noise_px, points=None):
    """Return pixels and pose of a drawn view whose points are all in the image."""
    points = np.pad(board, ((0, 0), (0, 1))) if points is None else points
    while True:
        z = rng.uniform(*depth)
        translation = [*(rng.uniform(-0.25, 0.25, 2) * z), z]
        pose = Pose(facing(rng, tilt_deg), translation)
        pixels = project(pose.transform(points))
        if np.isfinite(pixels).all() and (pixels > 3.0).all() and (pixels < [636.0, 476.0]).all():
            return pixels + rng.normal(0.0, noise_px, pixels.shape), pose


def off_centre(rng):
    focal_px = HALF_DIAGONAL_PX / np.tan(np.radians(rng.uniform(25.0, 50.0)))
    center = MIDDLE + rng.normal(0.0, 0.03 * 2.0 * HALF_DIAGONAL_PX, 2)
    k = rng.uniform(-0.35, 0.05)
    return DivisionCamera(focal_px, tuple(center), k).project, focal_px


def brown_conrady(rng):
    focal_px = HALF_DIAGONAL_PX / np.tan(np.radians(rng.uniform(25.0, 40.0)))
    k1 = rng.uniform(-0.25, 0.05)

    def project(points):
        x, y = points[:, 0] / points[:, 2], points[:, 1] / points[:, 2]
        r2 = x**2 + y**2
        radial = 1.0 + k1 * r2 - 0.3 * k1 * r2**2
        return MIDDLE + focal_px * radial[:, None] * np.column_stack([x, y])

    return project, focal_px


def equidistant(rng):
    focal_px = rng.uniform(250.0, 500.0)

    def project(points):
        rho = np.hypot(points[:, 0], points[:, 1])
        return MIDDLE + focal_px * (np.arctan2(rho, points[:, 2]) / rho)[:, None] * points[:, :2]

    return project, focal_px


def beyond(estimate, pose, sigmas=5.0):
    """Return whether a component of the pose is further off than so many standard deviations."""
    estimated = estimate.model.camera_from_board
    turned = Pose(estimated.rotation @ pose.rotation.T, np.zeros(3)).rotation_vector
    error = np.concatenate([estimated.translation - pose.translation, turned])
    return bool((np.abs(error) > sigmas * np.sqrt(np.diag(estimate.covariance)[:6])).any())


@pytest.mark.parametrize('lens', [off_centre, brown_conrady, equidistant])
@pytest.mark.parametrize('board', [MARKER, BOARD], ids=['marker', 'board'])
def test_one_view_of_an_unknown_camera_is_not_confidently_wrong(lens, board):
    rng = np.random.default_rng(1)
    noise_px = 0.3 if len(board) == 4 else 0.2
    published = wrong = 0
    for _ in range(150):
        project, _ = lens(rng)
        pixels, pose = draw(rng, project, board, (0.3, 1.0), (10.0, 50.0), noise_px)
        estimate = estimate_pose(pixels, board, image_size=SIZE, options=DEFAULT)
        if estimate.model is None or not estimate.observable.pose:
            continue
        published += 1
        wrong += beyond(estimate, pose)
        distance = np.linalg.norm(estimate.model.camera_from_board.translation)
        assert 0.1 < distance / np.linalg.norm(pose.translation) < 10.0
    assert published >= 50
    assert wrong <= 0.02 * published


# Markers of 150 mm in an image with the centre in the middle: pixels, size, true focal length.
UNBOUNDED = [
    (
        (1280, 720),
        [[622.68, 565.74], [636.05, 212.35], [989.39, 224.34], [976.42, 577.13]],
        1566.0,
    ),
    ((640, 480), [[434.61, 128.30], [468.04, 97.99], [492.01, 136.85], [458.17, 163.48]], 593.0),
    ((640, 480), [[75.36, 163.55], [145.89, 106.72], [199.00, 167.73], [126.95, 228.98]], 457.0),
]


@pytest.mark.parametrize(('size', 'pixels', 'focal_px'), UNBOUNDED)
def test_four_points_never_state_a_focal_length_far_off(size, pixels, focal_px):
    estimate = estimate_pose(pixels, MARKER, image_size=size, options=DEFAULT)
    camera = estimate.model.camera
    assert 0.1 < camera.focal_px / focal_px < 10.0
    if estimate.observable.focal:
        assert abs(camera.focal_px - focal_px) < 3.0 * estimate.focal_sigma_px


CAMERA = DivisionCamera(500.0, tuple(MIDDLE), -0.1)


def rolling_shutter(points):
    pixels = CAMERA.project(points)
    return np.column_stack([pixels[:, 0] + 0.01 * (pixels[:, 1] - MIDDLE[1]), pixels[:, 1]])


WIDE_PRINT = np.column_stack([1.01 * BOARD[:, 0], BOARD[:, 1], np.zeros(54)])
BOWED = np.column_stack([BOARD, 0.001 * (1.0 - (BOARD[:, 0] / 0.1) ** 2)])
DEVIATING = {
    'rolling shutter': (rolling_shutter, None, 0.2),
    'wide print': (CAMERA.project, WIDE_PRINT, 0.2),
    'bowed': (CAMERA.project, BOWED, 0.2),
    'noisy': (CAMERA.project, None, 1.0),
}


@pytest.mark.parametrize('deviation', DEVIATING)
def test_a_known_camera_has_the_covariance_that_a_deviating_view_asks_for(deviation):
    project, points, noise_px = DEVIATING[deviation]
    rng = np.random.default_rng(2)
    wrong = wrong_without = 0
    for _ in range(60):
        pixels, pose = draw(rng, project, BOARD, (0.35, 1.2), (0.0, 12.0), noise_px, points)
        estimate = estimate_pose(pixels, BOARD, camera=CAMERA, options=DEFAULT)
        assert estimate.model.camera == CAMERA
        estimated = estimate.model.camera_from_board
        ratio = np.linalg.norm(estimated.translation) / np.linalg.norm(pose.translation)
        assert ratio == pytest.approx(1.0, abs=0.1)
        angle = rotation_angle_rad(estimated.rotation, pose.rotation)
        gross = angle > np.radians(5.0)
        wrong += gross and beyond(estimate, pose)
        ideal = estimate_pose(pixels, BOARD, camera=CAMERA, options=EstimateOptions.ideal())
        wrong_without += beyond(ideal, pose)
    assert wrong <= 2
    if deviation in ('rolling shutter', 'wide print'):
        assert wrong_without > 30


def test_where_one_view_frees_the_aspect_ratio_its_focal_length_is_not_far_off():
    """The image is scaled: its pixels are 18 % from square."""
    rng, stretched = np.random.default_rng(5), Deviations(aspect=1.18)
    stated = wrong = 0
    for _ in range(100):
        lens = draw_lens(rng, SIZE)
        view = draw_deviating_view(rng, lens, SIZE, BOARD, stretched)
        estimate = estimate_pose(view.image_points, view.board_points, image_size=SIZE)
        if estimate.model is None or not estimate.observable.focal:
            continue
        if abs(estimate.model.camera.aspect - 1.0) < 0.03:
            continue
        stated += 1
        error_px = estimate.model.camera.focal_px - view.focal_px / np.sqrt(1.18)
        wrong += abs(error_px) > 3.0 * estimate.focal_sigma_px
    assert stated >= 40
    assert wrong <= 0.05 * stated


def test_limits_are_the_shares_of_the_priors():
    rng = np.random.default_rng(4)
    pixels, _ = draw(rng, CAMERA.project, BOARD, (0.4, 0.5), (30.0, 40.0), 0.2)
    limits = estimate_pose(pixels, BOARD, image_size=SIZE).focal_limits
    assert min(limits.center, limits.lens, limits.others) > 0.0
    assert limits.center + limits.lens + limits.others < 1.0
    centered = estimate_pose(pixels, BOARD, center_px=tuple(MIDDLE), image_size=SIZE)
    assert centered.focal_limits.center == 0.0
    flat = EstimateOptions(aspect_spread=0.0, board_stretch=0.0, board_bow=0.0)
    exact = estimate_pose(pixels, BOARD, image_size=SIZE, options=flat)
    assert exact.focal_limits.others == 0.0
    assert exact.focal_sigma_px < estimate_pose(pixels, BOARD, image_size=SIZE).focal_sigma_px


def test_a_view_without_deviations_is_still_exact():
    rng = np.random.default_rng(3)
    pixels, pose = draw(rng, CAMERA.project, BOARD, (0.4, 0.5), (30.0, 40.0), 0.0)
    known = estimate_pose(pixels, BOARD, camera=CAMERA, options=DEFAULT)
    estimated = known.model.camera_from_board
    np.testing.assert_allclose(estimated.translation, pose.translation, atol=1e-6)
    # Priors pull an unknown camera a little from the truth: by far less than its sigma.
    free = estimate_pose(pixels, BOARD, image_size=SIZE, options=DEFAULT)
    assert abs(free.model.camera.focal_px - 500.0) < free.focal_sigma_px
    assert free.observable.focal
