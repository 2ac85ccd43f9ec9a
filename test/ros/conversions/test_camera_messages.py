# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""Cameras to CameraInfo and back."""

import dataclasses
import re

import numpy as np
from p4pfr_ros import DivisionCamera
from p4pfr_ros.core.cameras.camera_info import CameraInfoModel
from p4pfr_ros.ros.conversions import (
    camera_info_division_msg,
    camera_info_from_model_msg,
    division_camera_from_msg,
    image_frame_from_msg,
    ImageFrame,
    model_assumption,
    model_from_msg,
)
import pytest
import scenes

FRAME = ImageFrame((1280, 960))
WINDOW = ImageFrame((1280, 960), offset_px=(100, 40), window=(640, 480), binning=(2, 4))
BARREL = (-0.3, 0.1, 1e-3, 2e-3, 0.0)
MODELS = [
    CameraInfoModel('plumb_bob', BARREL, (900.0, 905.0), (650.0, 470.0), 0.0, FRAME.size),
    DivisionCamera(700.0, (639.5, 479.5), -0.2).to_camera_info_model(FRAME.size),
    DivisionCamera(400.0, (639.5, 479.5), -0.25).to_camera_info_model(FRAME.size),
]
over_models = pytest.mark.parametrize('model', MODELS, ids=lambda m: m.distortion_model)


@over_models
@pytest.mark.parametrize('frame', [FRAME, WINDOW], ids=['all', 'window'])
def test_a_model_survives_its_message(model, frame):
    msg = camera_info_from_model_msg(scenes.header(1), frame, model)
    back = model_from_msg(msg)
    assert back == dataclasses.replace(model, residual_px=0.0)
    assert image_frame_from_msg(msg) == frame
    assert msg.header == scenes.header(1)


@over_models
def test_the_matrices_refer_to_the_full_image(model):
    """image_proc applies window and binning."""
    msg = camera_info_from_model_msg(scenes.header(1), WINDOW, model)
    (fx, fy), (x, y) = model.focal_px, model.center_px
    k = [[fx, 0.0, x], [0.0, fy, y], [0.0, 0.0, 1.0]]
    np.testing.assert_array_equal(msg.k.reshape(3, 3), k)
    np.testing.assert_array_equal(msg.r.reshape(3, 3), np.eye(3))
    np.testing.assert_array_equal(msg.p.reshape(3, 4), np.column_stack([k, np.zeros(3)]))
    assert (msg.width, msg.height) == (1280, 960)


@pytest.mark.parametrize('size', [(0, 480), (640, 0), (65536, 480), (640, 2**32 - 1)])
def test_an_invalid_image_size_is_rejected(size):
    rejected = image_frame_from_msg(scenes.camera_info(size))
    assert rejected.cause == 'camera_info'
    assert f'got {size[0]}x{size[1]}' in rejected.reason


@pytest.mark.parametrize('size', [(1, 1), (65535, 65535)])
def test_the_smallest_and_the_largest_image_are_valid(size):
    assert image_frame_from_msg(scenes.camera_info(size)) == ImageFrame(size)


@pytest.mark.parametrize(
    ('frame', 'expected'),
    [(FRAME, False), (WINDOW, True), (ImageFrame((1280, 960), window=(1280, 960)), False)],
)
def test_a_window_is_rectified_as_a_window(frame, expected):
    msg = camera_info_from_model_msg(scenes.header(1), frame, MODELS[0])
    assert msg.roi.do_rectify is expected


def test_a_skew_survives_its_message_and_is_not_in_the_rectified_image():
    model = dataclasses.replace(MODELS[0], skew_px=4.5)
    msg = camera_info_from_model_msg(scenes.header(1), FRAME, model)
    assert model_from_msg(msg) == model
    assert (msg.k[1], msg.p[1]) == (4.5, 0.0)


def test_coefficients_without_a_model_are_warned_of():
    msg = calibrated()
    assert model_assumption(msg) is None
    msg.distortion_model = ''
    assert model_from_msg(msg) == MODELS[0]
    assert 'taken as plumb_bob' in model_assumption(msg).reason
    msg.d = []
    assert model_from_msg(msg).coefficients == (0.0,) * 5
    assert model_assumption(msg) is None


@pytest.mark.parametrize('d', [BARREL[:4], BARREL], ids=['four', 'five'])
def test_plumb_bob_has_four_or_five_coefficients(d):
    msg = calibrated()
    msg.d = d
    assert model_from_msg(msg) == MODELS[0]


def test_no_coefficients_mean_no_distortion():
    msg = calibrated()
    msg.d = []
    assert model_from_msg(msg).coefficients == (0.0,) * 5


@pytest.mark.parametrize(
    ('change', 'cause', 'reason'),
    [
        ({'k': np.zeros(9)}, 'uncalibrated', 'K = 0'),
        ({'width': 0}, 'camera_info', 'from 1 to 65535, got 0x'),
        ({'height': 65536}, 'camera_info', 'from 1 to 65535, got .*x65536'),
        ({'distortion_model': 'fov'}, 'camera_model', "one of plumb_bob, .*, got 'fov': calib"),
        ({'distortion_model': 'division'}, 'camera_model', "got 'division': use the topic"),
        ({'distortion_model': 'x\n' * 10**6}, 'camera_model', r"got 'x\\nx.*: calibrate again"),
        ({'d': [0.1, 0.2, 0.3]}, 'camera_model', 'D: expected 4, 5, 8, 12, 14 numbers .*, got 3'),
        ({'d': [0.1] * 12}, 'camera_model', 'D: expected no thin prism .*THIN_PRISM_MODEL'),
        ({'d': [np.nan] * 5}, 'camera_model', 'D: expected numbers within 1e.*, got nan: calib'),
        ({'d': [0.0, 0.0, -1e8, 0.0]}, 'camera_model', 'D: expected numbers within 1e'),
        (
            {'k': np.array([9, 0, 1e300, 0, 9, 3, 0, 0, 1.0])},
            'camera_model',
            'K: expected numbers',
        ),
        ({'k': np.array([9, 0, 3, 0, 1e-300, 3, 0, 0, 1.0])}, 'camera_model', 'K: expected a foc'),
        (
            {'distortion_model': 'equidistant', 'd': []},
            'camera_model',
            'D: expected 4 numbers of equidistant .*, got 0: write four zeros',
        ),
        ({'k': np.array([9, 99, 3, 0, 9, 3, 0, 0, 1.0])}, 'camera_model', 'skew of at most fx'),
        ({'k': np.array([9, 0, 3, 0, 9, 3, 0, 0, 0.0])}, 'camera_model', r'\[9 0 3 0 9 3 0 0 0\]'),
        ({'k': np.array([9, 0, 0, 0, 9, 0, 3, 4, 1.0])}, 'camera_model', 'transpose it'),
        ({'k': np.array([-9, 0, 3, 0, 9, 3, 0, 0, 1.0])}, 'camera_model', 'a focal length from'),
        (
            {'k': np.array([9, 0, np.nan, 0, 9, 3, 0, 0, 1])},
            'camera_model',
            'K: expected numbers within',
        ),
    ],
)
def test_an_uncalibrated_or_unknown_camera_is_rejected(change, cause, reason):
    msg = calibrated()
    for field, value in change.items():
        setattr(msg, field, value)
    rejected = model_from_msg(msg)
    assert rejected.cause == cause
    assert re.search(reason, rejected.reason)
    assert len(rejected.reason) <= 200
    assert rejected.reason.isprintable()


@pytest.mark.parametrize(
    ('camera', 'd'),
    [
        (DivisionCamera(512.5, (300.25, 200.5), -0.125), [-0.125]),
        (DivisionCamera(512.5, (300.25, 200.5)), [0.0]),
        (DivisionCamera(512.5, (300.25, 200.5), -0.125, 0.25), [-0.125, 0.25, 0.0]),
        (DivisionCamera(512.5, (300.25, 200.5), 0.0, 0.0, 0.5), [0.0, 0.0, 0.5]),
        (DivisionCamera(512.5, (300.25, 200.5), -0.125, aspect=1.25), [-0.125]),
        (
            DivisionCamera(512.5, (300.25, 200.5), -0.125, 0.5, 0.25, 0.0625, 0.75),
            [-0.125, 0.5, 0.25, 0.0625, 0.0, 0.0],
        ),
        (
            DivisionCamera(512.5, (300.25, 200.5), -0.125, p1=0.5, p2=-0.25),
            [-0.125, 0.0, 0.0, 0.0, 0.5, -0.25],
        ),
    ],
)
def test_a_division_camera_has_as_many_coefficients_as_it_needs(camera, d):
    msg = camera_info_division_msg(scenes.header(1), FRAME, camera)
    assert list(msg.d) == d
    np.testing.assert_array_equal(msg.k.reshape(3, 3), camera.matrix)
    np.testing.assert_array_equal(msg.p.reshape(3, 4)[:, :3], camera.matrix)
    assert division_camera_from_msg(msg) == camera


def test_the_ray_of_a_pixel_can_be_computed_from_the_division_message():
    """By the formula that is documented, from K and D alone."""
    camera = DivisionCamera(512.5, (300.25, 200.5), -0.2, 0.05, 0.01, 2e-3, 1.1, 0.01, -0.02)
    msg = camera_info_division_msg(scenes.header(1), FRAME, camera)
    pixels = np.random.default_rng(0).uniform((0, 0), FRAME.size, (20, 2))
    k, k2, k3, k4, p1, p2 = msg.d
    x, y = ((pixels - msg.k[[2, 5]]) / msg.k[[0, 4]]).T
    q = x**2 + y**2
    e = np.stack(
        [
            x + 2 * p1 * x * y + p2 * (q + 2 * x**2),
            y + p1 * (q + 2 * y**2) + 2 * p2 * x * y,
        ],
        axis=-1,
    )
    q = np.sum(e**2, axis=-1)
    rays = np.column_stack([e, 1 + k * q + k2 * q**2 + k3 * q**3 + k4 * q**4])
    np.testing.assert_allclose(camera.unproject(pixels), rays, rtol=1e-12)


@pytest.mark.parametrize('d', [[], [0.1, 0.2], [0.1] * 4, [0.1] * 7])
def test_another_number_of_coefficients_is_an_error(d):
    msg = camera_info_division_msg(scenes.header(1), FRAME, DivisionCamera(500.0, (3.0, 4.0)))
    msg.d = d
    with pytest.raises(ValueError, match=f'division.* with {len(d)} coefficients'):
        division_camera_from_msg(msg)


@pytest.mark.parametrize('place', [0, 4])
def test_a_division_camera_without_focal_length_is_an_error(place):
    msg = camera_info_division_msg(scenes.header(1), FRAME, DivisionCamera(500.0, (3.0, 4.0)))
    msg.k[place] = 0.0
    with pytest.raises(ValueError, match='expected K with fx and fy > 0'):
        division_camera_from_msg(msg)


def calibrated():
    """Make the CameraInfo of a calibrated camera."""
    return camera_info_from_model_msg(scenes.header(1), FRAME, MODELS[0])
