# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""The lens in the kernels is the division camera."""

from hypothesis import strategies as st
from laws import law
import numpy as np
from p4pfr_ros import DivisionCamera
from p4pfr_ros.core.model.lens import (
    camera_from_lens,
    CX,
    CY,
    LENS_END,
    lens_from_camera,
    linearise_rotated,
    offset_px,
)
import pytest

MIDDLE_PX = (639.5, 479.5)
CAMERAS = {
    'one term': DivisionCamera(700.0, (650.0, 470.0), -0.2),
    'pincushion': DivisionCamera(900.0, (650.0, 470.0), 0.1, aspect=0.98),
    'decentred': DivisionCamera(700.0, (650.0, 470.0), -0.2, aspect=1.03, p1=0.002, p2=-0.003),
    'four terms': DivisionCamera(
        430.0, (630.0, 490.0), -0.33, -0.022, -0.002, -0.0003, 1.01, 0.001, 0.002
    ),
}


def near(pixels):
    """Return where the points are observed: some pixels off, as in an iteration."""
    return pixels + np.random.default_rng(1).normal(0.0, 4.0, pixels.shape)


@pytest.mark.parametrize('name', CAMERAS)
def test_kernels_project_as_the_camera_does(name):
    camera = CAMERAS[name]
    lens = lens_from_camera(camera, MIDDLE_PX)
    rng = np.random.default_rng(2)
    pixels = rng.uniform((0, 0), (1280, 960), (60, 2))
    points = rng.uniform(0.2, 5.0, (60, 1)) * camera.unproject(pixels)
    pose, rows = np.append(np.eye(3).ravel(), np.zeros(3)), np.empty((2, LENS_END))
    for point, (u, v), pixel in zip(points, near(pixels) - MIDDLE_PX, pixels, strict=True):
        offset = offset_px(*point, lens, u, v)
        again = linearise_rotated(*point, pose, lens, u, v, rows)
        np.testing.assert_allclose(offset, again, atol=1e-9)
        projected = np.add(offset, (lens[CX], lens[CY])) + MIDDLE_PX
        np.testing.assert_allclose(projected, pixel, atol=1e-7)
        np.testing.assert_allclose(projected, camera.project(point), atol=1e-7)


@pytest.mark.parametrize('name', CAMERAS)
def test_a_point_that_the_lens_does_not_see_is_nan(name):
    lens = lens_from_camera(CAMERAS[name], MIDDLE_PX)
    assert np.isnan(offset_px(0.0, 0.0, -1.0, lens, 3.0, 4.0)).all()


@law(
    focal_px=st.floats(100.0, 3000.0),
    k=st.floats(-0.5, 0.2),
    k4=st.floats(-1e-3, 1e-3),
    aspect=st.floats(0.5, 2.0),
    p1=st.floats(-0.01, 0.01),
)
def test_a_lens_has_all_numbers_of_its_camera(focal_px, k, k4, aspect, p1):
    camera = DivisionCamera(focal_px, (600.0, 500.0), k, 0.01, -0.002, k4, aspect, p1, 0.003)
    back = camera_from_lens(lens_from_camera(camera, MIDDLE_PX), MIDDLE_PX)
    assert back.center_px == pytest.approx(camera.center_px)
    assert back.terms == camera.terms
    assert (back.focal_px, back.p1, back.p2) == (camera.focal_px, camera.p1, camera.p2)
    assert back.aspect == pytest.approx(camera.aspect, abs=1e-15)
