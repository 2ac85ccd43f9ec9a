# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""Laws of the minimal solver, over drawn inputs."""

import json
import os
import subprocess
import sys

from hypothesis import assume, example
from hypothesis import strategies as st
from laws import law
import numpy as np
from p4pfr_ros import DivisionCamera, Pose, solve_p4pfr, solve_p4pfr_batch
from p4pfr_ros.core.geometry import rotation_angle_rad
from p4pfr_ros.scenes.instances import draw_instances, KINDS
import pytest

seeds = st.integers(0, 2**20)
angles = st.floats(0.0, 2.0 * np.pi)
scales = st.floats(-8.0, 8.0).map(lambda power: 10.0**power)

# Instances are well conditioned if noise changes no solution by more than this share.
_WELL_CONDITIONED = 1e-7


def instance(seed, kind='patch'):
    drawn = draw_instances(kind, 1, seed)
    return drawn.image_points[0], drawn.board_points[0]


def by_focal(solutions):
    return sorted(solutions, key=lambda s: s.camera.focal_px)


def stable(image, board):
    """Return whether an instance has solutions, and noise of 1e-10 px hardly changes them."""
    noise = np.random.default_rng(0).normal(0.0, 1e-10, (4, 2))
    solutions = solve_p4pfr(image, board)
    return bool(solutions) and same(
        solutions, solve_p4pfr(image + noise, board), _WELL_CONDITIONED
    )


def same(one, other, tolerance=1e-5):
    """Return whether two lists of solutions agree in f, k, rotation and translation."""
    if len(one) != len(other):
        return False
    return all(close(a, b, tolerance) for a, b in zip(by_focal(one), by_focal(other), strict=True))


def close(a, b, tolerance):
    ta, tb = a.camera_from_board.translation, b.camera_from_board.translation
    focal_px = a.camera.focal_px
    return (
        abs(focal_px - b.camera.focal_px) <= tolerance * focal_px
        and abs(a.camera.k - b.camera.k) <= tolerance * (1.0 + abs(a.camera.k))
        and rotation_angle_rad(a.camera_from_board.rotation, b.camera_from_board.rotation)
        <= tolerance
        and np.linalg.norm(ta - tb) <= tolerance * np.linalg.norm(ta)
    )


def transformed(solutions, scale_px=1.0, camera_from_camera=None, board_from_board=None, unit=1.0):
    """Transform solutions as the image or the board is transformed and scaled."""
    rotation = camera_from_camera if camera_from_camera is not None else Pose.identity()
    move = board_from_board if board_from_board is not None else Pose.identity()
    result = []
    for s in solutions:
        pose = (
            rotation
            @ Pose(s.camera_from_board.rotation, unit * s.camera_from_board.translation)
            @ move
        )
        camera = DivisionCamera(scale_px * s.camera.focal_px, (0.0, 0.0), s.camera.k)
        result.append(type(s)(camera, pose))
    return result


def rotation_about_z(angle, translation=(0.0, 0.0, 0.0)):
    return Pose.from_rotation_vector([0.0, 0.0, angle], translation)


@law(seed=seeds, angle=angles, unit=scales, shift=st.tuples(*[st.floats(-3.0, 3.0)] * 2))
def test_solutions_transform_with_the_boards_frame_and_unit(seed, angle, unit, shift):
    image, board = instance(seed)
    assume(stable(image, board))
    new_from_old = rotation_about_z(angle, [*shift, 0.0])
    old = np.column_stack([board, np.zeros(4)])
    moved = unit * new_from_old.transform(old)[:, :2]
    old_from_new = new_from_old.inverse()
    scaled = Pose(old_from_new.rotation, unit * old_from_new.translation)
    expected = transformed(solve_p4pfr(image, board), unit=unit, board_from_board=scaled)
    assert same(solve_p4pfr(image, moved), expected)


@law(seed=seeds, angle=angles)
def test_rotating_the_image_rotates_the_camera(seed, angle):
    image, board = instance(seed)
    assume(stable(image, board))
    rotation = rotation_about_z(angle)
    expected = transformed(solve_p4pfr(image, board), camera_from_camera=rotation)
    assert same(solve_p4pfr(image @ rotation.rotation[:2, :2].T, board), expected)


@law(seed=seeds, scale=scales)
def test_the_focal_length_scales_with_the_image(seed, scale):
    image, board = instance(seed)
    assume(stable(image, board))
    assert same(solve_p4pfr(scale * image, board), transformed(solve_p4pfr(image, board), scale))


@law(seed=seeds, order=st.permutations(range(4)))
def test_the_order_of_the_points_does_not_matter(seed, order):
    image, board = instance(seed)
    assume(stable(image, board))
    assert same(solve_p4pfr(image[order], board[order]), solve_p4pfr(image, board))


@pytest.mark.parametrize('kind', ['patch', 'square about its side', 'three collinear points'])
@law(examples=40, seed=seeds)
def test_an_undistorted_image_has_a_solution_with_k_of_zero(kind, seed):
    drawn = draw_instances(kind, 1, seed)
    points = np.einsum('ij,pj->pi', drawn.rotation[0][:, :2], drawn.board_points[0])
    points += drawn.translation[0]
    assume((points[:, 2] > 0.1).all())
    focal_px = drawn.focal_px[0]
    image = focal_px * points[:, :2] / points[:, 2:]
    solutions = solve_p4pfr(image, drawn.board_points[0])
    error = [abs(s.camera.k) + abs(s.camera.focal_px / focal_px - 1.0) for s in solutions]
    assume(stable(image, drawn.board_points[0]))
    assert min(error, default=np.inf) < 1e-5


@law(seed=seeds, kind=st.sampled_from(sorted(KINDS)))
def test_every_solution_projects_its_points_to_their_pixels(seed, kind):
    image, board = instance(seed, kind)
    solutions = solve_p4pfr(image, board)
    assert solutions
    for s in solutions:
        reprojected = s.camera.project(
            s.camera_from_board.transform(np.column_stack([board, np.zeros(4)]))
        )
        np.testing.assert_allclose(reprojected, image, atol=1e-9 * 1280.0)


# Few different numbers, so that points coincide and align, and extreme ones.
coordinates = st.sampled_from([0.0, 1.0, -1.0, 0.5, 2.0, 1.0 + 1e-15, 1e-15, -1e-9, 3.0, 7.0])
magnitudes = st.sampled_from([1e-150, 1e-100, 1e-20, 1.0, 1e20, 1e100, 1e150])
quadruples = st.lists(st.tuples(coordinates, coordinates), min_size=4, max_size=4).map(np.array)
SQUARE = np.array([[-1.0, 1.0], [1.0, 1.0], [1.0, -1.0], [-1.0, -1.0]])


@law(examples=500, image=quadruples, board=quadruples, px=magnitudes, unit=magnitudes)
@example(image=np.zeros((4, 2)), board=np.zeros((4, 2)), px=1.0, unit=1.0)
@example(image=SQUARE, board=SQUARE, px=1e150, unit=1e-150)
@example(image=3.0 * SQUARE + [0.5, 0.0], board=SQUARE, px=1e-150, unit=1e150)
def test_solutions_of_degenerate_points_are_valid(image, board, px, unit):
    for s in solve_p4pfr(px * image, unit * board):
        camera, pose = s.camera, s.camera_from_board
        assert np.isfinite([camera.focal_px, camera.k, *pose.translation]).all()
        assert camera.focal_px > 0.0
        np.testing.assert_allclose(pose.rotation.T @ pose.rotation, np.eye(3), atol=1e-12)
        # The distance of each ray from its point, in units without overflow: a share of the
        # image's size.
        points = board @ pose.rotation[:, :2].T + pose.translation / unit
        rays = camera.unproject(px * image) * (camera.focal_px / (px * np.abs(image).max()))
        distances = np.linalg.norm(np.cross(points, rays), axis=1) / np.linalg.norm(points, axis=1)
        # The translation's rounding error is large relative to a point close to the camera.
        length = np.linalg.norm(points, axis=1)
        rounding = 1e-14 * length.max() / length * np.linalg.norm(rays, axis=1)
        assert (distances < 1e-8 + rounding).all()
        assert (np.sum(points * rays, axis=1) > 0.0).all()


TWIN = """
import json, sys
from p4pfr_ros import solve_p4pfr_batch
from p4pfr_ros.scenes.instances import draw_instances
drawn = draw_instances(sys.argv[1], int(sys.argv[2]), 5)
batch = solve_p4pfr_batch(drawn.image_points, drawn.board_points)
numbers = [a.ravel().view('u8').tolist() for a in (batch.focal_px, batch.k, batch.rotation)]
print(json.dumps([batch.count.tolist(), *numbers]))
"""


@pytest.mark.parametrize('kind', ['patch', 'square, tilt < 3°'])
def test_compiled_and_interpreted_give_the_same_bits(kind):
    n = 40
    drawn = draw_instances(kind, n, 5)
    batch = solve_p4pfr_batch(drawn.image_points, drawn.board_points)
    twin = subprocess.run(
        [sys.executable, '-c', TWIN, kind, str(n)],
        env=os.environ | {'NUMBA_DISABLE_JIT': '1'},
        capture_output=True,
        check=True,
        text=True,
    )
    count, focal_px, k, rotation = json.loads(twin.stdout)
    assert count == batch.count.tolist()
    solved = ~np.isnan(batch.focal_px)
    for compiled, interpreted in (
        (batch.focal_px, focal_px),
        (batch.k, k),
        (batch.rotation, rotation),
    ):
        other = np.array(interpreted, dtype=np.uint64).view(np.float64).reshape(compiled.shape)
        np.testing.assert_array_equal(compiled[solved], other[solved])
