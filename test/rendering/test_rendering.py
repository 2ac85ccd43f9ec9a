# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

from board_views import BOARDS, CAMERAS, CENTER, distance_m, HEAD_ON, project, seen_from, SIZE
from hypothesis import given, settings
from hypothesis import strategies as st
import numpy as np
from p4pfr_ros.boards import Marker
from p4pfr_ros.core.cameras.division import DivisionCamera
from p4pfr_ros.core.geometry import Pose
from p4pfr_ros.rendering import render, Renderer
from p4pfr_ros.rendering.pattern import black_shapes
from p4pfr_ros.rendering.rasterizer import coverage
import pytest

BOARD = BOARDS['chessboard']
CAMERA = CAMERAS['strong']
POSE = seen_from(0.4, tilt_rad=(0.4, -0.3), roll_rad=0.2)


def edges_of(polygon):
    return np.concatenate([polygon, np.roll(polygon, -1, axis=0)], axis=1)


@given(corners=st.lists(st.tuples(st.floats(-20, 60), st.floats(-20, 60)), min_size=3, max_size=5))
@settings(max_examples=50, deadline=None)
def test_coverage_adds_up_to_the_polygons_area(corners):
    """The sum is the signed area of any polygon inside the image (Green's theorem)."""
    polygon = np.array(corners)
    x, y = polygon.T
    area = 0.5 * np.sum(x * np.roll(y, -1) - y * np.roll(x, -1))
    covered = coverage(edges_of(polygon + 30.0), (130, 130))
    assert covered.sum() == pytest.approx(area, abs=1e-9)


def test_coverage_of_a_square_is_exact_pixel_by_pixel():
    square = np.array([[0.25, 0.0], [2.0, 0.0], [2.0, 1.25], [0.25, 1.25]])
    x = np.array([0.25, 1.0, 0.5, 0.0])  # pixel x spans x - 1/2 to x + 1/2
    y = np.array([0.5, 0.75, 0.0])
    np.testing.assert_allclose(coverage(edges_of(square), (4, 3)), np.outer(y, x), atol=1e-12)


def test_coverage_is_clipped_at_the_image_borders():
    everything = np.array([[-50, -50], [70, -60], [80, 90], [-70, 60]], dtype=float)
    np.testing.assert_allclose(coverage(edges_of(everything), (7, 5)), 1.0, atol=1e-9)


@pytest.mark.parametrize('camera', CAMERAS.values(), ids=CAMERAS)
@pytest.mark.parametrize('name', ['chessboard', 'marker', 'bundle'])
def test_pixels_are_means_of_the_scene(name, camera):
    """Compare with brute force: 16 x 16 rays through each of 300 pixels."""
    board = BOARDS[name]
    pose = seen_from(distance_m(camera), (0.5, -0.3), 0.2, (0.1, -0.05))
    image = render(board, camera, pose, SIZE)
    rng = np.random.default_rng(5)
    corners = project(camera, pose, board.points)
    pixels = rng.integers(corners.min(axis=0), corners.max(axis=0), (300, 2))
    step = (np.arange(16) + 0.5) / 16 - 0.5
    samples = pixels[:, None] + np.stack(np.meshgrid(step, step), axis=-1).reshape(-1, 2)
    mean = grey_levels(board, camera, pose, samples).mean(axis=1)
    actual = image[pixels[:, 1], pixels[:, 0]]
    assert np.ptp(actual) > 150
    # 256 samples of a straight edge have an error of a few per cent of 195 grey levels.
    assert np.abs(actual - mean).max() < 9.0
    assert np.abs(actual - mean).mean() < 1.0


def grey_levels(board, camera, pose, pixels):
    """Return the scene's grey levels on the rays through pixels (..., 2)."""
    rays = camera.unproject(pixels) @ pose.rotation  # in the board's axes
    eye = pose.inverse().translation
    points = (eye - rays * (eye[2] / rays[..., 2:]))[..., :2]
    levels = np.where((2 * np.abs(points) < board.sheet_size_m).all(axis=-1), 220.0, 110.0)
    for corners in black_shapes(board):
        along, down = corners[1] - corners[0], corners[3] - corners[0]
        u, v = (
            np.sum((points - corners[0]) * side, axis=-1) / (side @ side) for side in (along, down)
        )
        levels[(u > 0.0) & (u < 1.0) & (v > 0.0) & (v < 1.0)] = 25.0
    return levels


def test_a_board_behind_the_camera_is_not_visible():
    behind = Pose(POSE.rotation, -POSE.translation)
    for camera in CAMERAS.values():
        assert (render(BOARD, camera, behind, SIZE) == 110).all()


def test_the_back_of_a_board_is_blank():
    from_behind = POSE @ Pose.from_rotation_vector((0.0, np.pi, 0.0), np.zeros(3))
    image = render(BOARD, CAMERA, from_behind, SIZE)
    assert image.max() == 220
    assert image.min() == 110


def test_a_board_that_extends_behind_the_camera_is_clipped():
    """A floor below the camera fills the lower half of the image only."""
    floor = Marker(id=0, size_m=50.0, dictionary='DICT_4X4_50')
    # The board's y axis points ahead, its z axis up.
    pose = Pose(np.array([[1.0, 0, 0], [0, 0, -1.0], [0, 1.0, 0]]), np.array([0.0, 1.0, 0.0]))
    for camera in CAMERAS.values():
        image = render(floor, camera, pose, SIZE)
        rays = camera.unproject(np.stack(np.meshgrid(range(640), range(480)), axis=-1))
        is_sky = (rays[..., 1] < -0.05) | (rays[..., 2] < 0.0)
        assert (image[is_sky] == 110).all()
        assert (image[470, 200:440] != 110).all()


def test_a_pincushion_lens_is_clipped_at_its_edge_of_view():
    camera = DivisionCamera(150.0, CENTER, 0.3)  # rays stop turning outwards at 274 px
    wall = Marker(id=0, size_m=500.0, dictionary='DICT_4X4_50')
    image = render(wall, camera, seen_from(1.0, (0.4, 0.0)), SIZE)
    y, x = np.indices(image.shape)
    radius = np.hypot(x - CENTER[0], y - CENTER[1])
    assert (image[radius > 276] == 110).all()
    assert (image[radius < 271] != 110).all()


def test_grey_levels_light_and_background():
    slope = np.broadcast_to(np.linspace(50.0, 150.0, 640), (480, 640))
    image = render(BOARD, CAMERA, POSE, SIZE, background=slope, black=10.0, white=250.0)
    assert (image.min(), image.max()) == (10, 250)
    np.testing.assert_array_equal(image[0], np.rint(slope[0]))
    dark = render(BOARD, CAMERA, POSE, SIZE, background=100.0, falloff=0.5)
    assert dark[0, 0] == pytest.approx(50, abs=1)


def test_noise_has_its_sigma_and_repeats_with_its_seed():
    flat = {'background': 100.0, 'noise_sigma': 5.0}
    away = Pose(HEAD_ON.rotation, np.array([0.0, 0.0, -1.0]))
    first = render(BOARD, CAMERA, away, SIZE, seed=1, **flat)
    assert first.std() == pytest.approx(5.0, rel=0.02)
    assert first.mean() == pytest.approx(100.0, abs=0.05)
    np.testing.assert_array_equal(first, render(BOARD, CAMERA, away, SIZE, seed=1, **flat))
    assert (first != render(BOARD, CAMERA, away, SIZE, seed=2, **flat)).mean() > 0.8


def test_blur_smooths_and_keeps_the_mean():
    sharp = render(BOARD, CAMERA, POSE, SIZE).astype(float)
    soft = render(BOARD, CAMERA, POSE, SIZE, blur_sigma_px=2.0).astype(float)
    assert np.abs(np.diff(soft, axis=1)).max() < 0.4 * np.abs(np.diff(sharp, axis=1)).max()
    assert soft.mean() == pytest.approx(sharp.mean(), abs=0.02)


def test_a_renderer_gives_the_same_images_as_render():
    renderer = Renderer(CAMERA, SIZE)
    for pose in (POSE, seen_from(0.6)):
        np.testing.assert_array_equal(
            renderer.render(BOARD, pose), render(BOARD, CAMERA, pose, SIZE)
        )


@pytest.mark.parametrize(
    ('options', 'message'),
    [
        ({'image_size': (0, 480)}, 'image_size must be positive'),
        ({'background': np.zeros((3, 3))}, r'background must be a number or \(480, 640\)'),
        ({'white': 300.0}, 'white must be within 0 to 255'),
        ({'falloff': 2.0}, 'falloff must be within 0 to 1'),
        ({'noise_sigma': -1.0}, 'noise_sigma must be ≥ 0'),
        ({'blur_sigma_px': float('nan')}, 'blur_sigma_px must be ≥ 0'),
    ],
)
def test_invalid_options_are_rejected(options, message):
    arguments = {'image_size': SIZE, **options}
    with pytest.raises(ValueError, match=message):
        render(BOARD, CAMERA, POSE, **arguments)
