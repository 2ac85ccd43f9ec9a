# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""Two cameras differ by what no turn between them explains."""

from dataclasses import replace

import numpy as np
from p4pfr_ros import CameraEstimate, DivisionCamera
from p4pfr_ros.report.comparison import compare_cameras
import pytest

SIZE, SHAPE = (640, 480), (12, 16)
CAMERA = DivisionCamera(500.0, (322.0, 236.0), -0.2)
ESTIMATE = CameraEstimate(CAMERA, np.eye(10) * 1e-9, 0.1, 9)
SEEN = np.zeros((12, 16), dtype=bool)
SEEN[2:10, 2:14] = True


def test_a_camera_does_not_differ_from_itself():
    difference = compare_cameras(ESTIMATE, CAMERA, SIZE, SHAPE)
    assert difference.largest_px < 1e-9
    assert difference.turn_deg < 1e-9
    np.testing.assert_allclose(difference.vectors_px, 0.0, atol=1e-9)


def test_the_exported_camera_info_is_within_its_stated_residual():
    model = CAMERA.to_camera_info_model(SIZE)
    difference = compare_cameras(ESTIMATE, model, SIZE, SHAPE)
    assert difference.largest_px < 2.0 * model.residual_px + 1e-3


def test_a_shifted_centre_is_mostly_a_turn():
    """Of a long lens, a small shift of 3 px looks like a turn of 3 / f."""
    camera = DivisionCamera(2000.0, (320.0, 240.0))
    estimate = replace(ESTIMATE, camera=camera)
    shifted = replace(camera, center_px=(323.0, 240.0))
    difference = compare_cameras(estimate, shifted, SIZE, SHAPE)
    assert difference.turn_deg == pytest.approx(np.degrees(3.0 / 2000.0), rel=0.02)
    assert difference.largest_px < 0.1


def test_another_focal_length_differs_radially():
    other = replace(CAMERA, focal_px=505.0)
    difference = compare_cameras(ESTIMATE, other, SIZE, SHAPE)
    x, y = difference.vectors_px[6, 15]
    assert x > 2.0
    assert abs(y) < 0.2
    assert difference.vectors_px[6, 0, 0] < -2.0
    assert difference.lengths_px[6, 8] < 0.3
    assert difference.rms_px < difference.largest_px


def test_the_turn_is_judged_where_points_were_seen():
    """Lenses that are equal there do not differ there, whatever they do in the corners."""
    estimate = replace(ESTIMATE, coverage=SEEN, seen_radius_px=250.0)
    other = replace(CAMERA, k=CAMERA.k * 1.0, k2=0.01)
    difference = compare_cameras(estimate, other, SIZE, SHAPE)
    assert difference.largest_px < 0.5 * difference.lengths_px[0, 0]
