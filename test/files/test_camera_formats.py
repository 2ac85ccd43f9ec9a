# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""Calibration files of other programs: ROS, OpenCV, Kalibr, camodocal."""

import cv2
import numpy as np
from p4pfr_ros import load_calibration
from p4pfr_ros.core.cameras.camera_info import CameraInfoModel
from p4pfr_ros.files.yaml_fields import ConfigError
import pytest
import yaml

SIZE = (640, 480)
K = [[500.0, 0.0, 320.0], [0.0, 505.0, 240.0], [0.0, 0.0, 1.0]]
FIVE = [-0.3, 0.1, 0.001, -0.002, 0.05]
EIGHT = [*FIVE, 0.02, -0.01, 0.005]
FOUR = [0.17, -0.03, 0.0004, -0.0007]
KALIBR = {
    'camera_model': 'pinhole',
    'distortion_coeffs': FOUR,
    'distortion_model': 'radtan',
    'intrinsics': [500.0, 505.0, 320.0, 240.0],
    'resolution': list(SIZE),
    'rostopic': '/left/image_raw',
}


def model(kind, d, skew_px=0.0):
    return CameraInfoModel(
        kind, tuple(d), (500.0, 505.0), (320.0, 240.0), 0.0, SIZE, skew_px=skew_px
    )


def ros(**changes):
    """Return the tree of a file of camera_info_manager; None removes a key."""
    tree = {
        'image_width': 640,
        'image_height': 480,
        'camera_name': 'front',
        'camera_matrix': matrix(3, 3, np.ravel(K).tolist()),
        'distortion_model': 'plumb_bob',
        'distortion_coefficients': matrix(1, 5, FIVE),
        'rectification_matrix': matrix(3, 3, np.eye(3).ravel().tolist()),
        'projection_matrix': matrix(3, 4, np.column_stack([K, [0] * 3]).ravel().tolist()),
    } | changes
    return {key: value for key, value in tree.items() if value is not None}


def matrix(rows, cols, data):
    return {'rows': rows, 'cols': cols, 'data': list(data)}


@pytest.fixture
def load(tmp_path):
    """Load a tree as a file, or text."""

    def load(tree, camera_name=''):
        path = tmp_path / 'camera.yaml'
        path.write_text(tree if isinstance(tree, str) else yaml.safe_dump(tree))
        return load_calibration(path, camera_name)

    return load


@pytest.mark.parametrize(
    ('tree', 'expected'),
    [
        (ros(), model('plumb_bob', FIVE)),
        (ros(rectification_matrix=None, projection_matrix=None), model('plumb_bob', FIVE)),
        (ros(distortion_coefficients=matrix(5, 1, FIVE)), model('plumb_bob', FIVE)),
        (ros(distortion_coefficients=matrix(1, 0, [])), model('plumb_bob', [0.0] * 5)),
        (ros(distortion_coefficients=matrix(0, 0, [])), model('plumb_bob', [0.0] * 5)),
        (
            ros(distortion_model='', distortion_coefficients=matrix(0, 0, [])),
            model('plumb_bob', [0.0] * 5),
        ),
        (
            ros(distortion_model='none', distortion_coefficients=None),
            model('plumb_bob', [0.0] * 5),
        ),
        (
            ros(distortion_coefficients=matrix(1, 8, EIGHT)),
            model('rational_polynomial', EIGHT),
        ),
        (
            ros(distortion_coefficients=matrix(1, 14, [*EIGHT, *[0.0] * 6])),
            model('rational_polynomial', EIGHT),
        ),
        (
            ros(distortion_model='fisheye', distortion_coefficients=matrix(4, 1, FOUR)),
            model('equidistant', FOUR),
        ),
        (
            ros(
                distortion_model=None,
                camera_model='fisheye',
                distortion_coefficients=matrix(1, 4, FOUR),
            ),
            model('equidistant', FOUR),
        ),
        (ros(distortion_model=None, camera_model='pinhole'), model('plumb_bob', FIVE)),
        (
            ros(camera_matrix=matrix(3, 3, [500, 4, 320, 0, 505, 240, 0, 0, 1])),
            model('plumb_bob', FIVE, skew_px=4.0),
        ),
    ],
)
def test_files_of_ros(load, tree, expected):
    loaded = load(tree)
    assert loaded.model == expected
    assert (loaded.camera_name, loaded.estimate, loaded.assumed) == ('front', None, '')


def test_a_file_without_a_model_is_warned_of(load):
    loaded = load(ros(distortion_model=None))
    assert loaded.model == model('plumb_bob', FIVE)
    assert 'no distortion_model: taken as plumb_bob' in loaded.assumed
    loaded = load(ros(distortion_model=None, distortion_coefficients=None))
    assert loaded.model == model('plumb_bob', [0.0] * 5)
    assert 'no distortion_coefficients: taken as a pinhole' in loaded.assumed


@pytest.mark.parametrize('name', [None, '', 7, 1.5])
def test_any_camera_name_is_read(load, name):
    tree = ros() | {'camera_name': name}
    assert load(tree).camera_name == (str(name) if name else 'unknown')


def test_a_printed_camera_info_is_read(load):
    """As ``ros2 topic echo --once`` prints it, with the end of its document."""
    tree = {
        'header': {'stamp': {'sec': 1, 'nanosec': 2}, 'frame_id': 'camera'},
        'height': 480,
        'width': 640,
        'distortion_model': 'rational_polynomial',
        'd': EIGHT,
        'k': np.ravel(K).tolist(),
        'r': np.eye(3).ravel().tolist(),
        'p': [0.0] * 12,
        'binning_x': 0,
    }
    assert load(yaml.safe_dump(tree) + '---\n').model == model('rational_polynomial', EIGHT)


@pytest.mark.parametrize(
    ('keys', 'd', 'extra', 'expected'),
    [
        # The samples calibration.cpp and camera_calibration.cpp.
        (('camera_matrix', 'distortion_coefficients'), FIVE, {}, model('plumb_bob', FIVE)),
        (('Camera_Matrix', 'Distortion_Coefficients'), FIVE, {}, model('plumb_bob', FIVE)),
        (
            ('camera_matrix', 'distortion_coefficients'),
            FOUR,
            {'fisheye_model': 1},
            model('equidistant', FOUR),
        ),
        (
            ('camera_matrix', 'distortion_coefficients'),
            EIGHT,
            {'fisheye_model': 0},
            model('rational_polynomial', EIGHT),
        ),
        # The interactive calibration, and what people write.
        (('cameraMatrix', 'dist_coeffs'), FIVE, {}, model('plumb_bob', FIVE)),
        (('K', 'D'), FIVE, {}, model('plumb_bob', FIVE)),
        (('camera_matrix', 'dist_coeff'), FIVE, {}, model('plumb_bob', FIVE)),
    ],
)
@pytest.mark.parametrize('column', [False, True])
def test_files_that_opencv_writes(tmp_path, keys, d, extra, expected, column):
    """By cv2.FileStorage itself, with sizes in either of its forms, and big data beside them."""
    path = tmp_path / 'camera.yml'
    storage = cv2.FileStorage(str(path), cv2.FILE_STORAGE_WRITE)
    storage.write('calibration_time', 'Mon Nov 30 17:20:00 2026')
    if column:
        storage.write('image_Width', 640)
        storage.write('image_Height', 480)
    else:
        storage.write('cameraResolution', np.array(SIZE))
    for key, value in extra.items():
        storage.write(key, value)
    storage.write(keys[0], np.array(K))
    storage.write(keys[1], np.reshape(d, (-1, 1) if column else -1))
    storage.write('image_points', np.random.default_rng(0).random((20, 54, 2)))
    storage.release()
    if not column:  # OpenCV 4 begins its files like this, and writes C++'s cv::Size as a list
        _, _, text = path.read_text().partition('\n')
        path.write_text(f'%YAML:1.0\n{text}\nimageSize: [ 640, 480 ]\n')
    loaded = load_calibration(path)
    assert loaded.model == expected
    assert bool(loaded.assumed) is (not extra)


@pytest.mark.parametrize(
    ('changes', 'expected'),
    [
        ({}, model('plumb_bob', [*FOUR, 0.0])),
        ({'distortion_model': 'equidistant'}, model('equidistant', FOUR)),
        ({'distortion_model': 'equi', 'camera_model': 'PINHOLE'}, model('equidistant', FOUR)),
        (
            {'distortion_model': 'none', 'distortion_coeffs': []},
            model('plumb_bob', [0.0] * 5),
        ),
    ],
)
@pytest.mark.parametrize('head', ['', '%YAML:1.0 # of OpenVINS\n'])
def test_chains_of_kalibr(load, changes, expected, head):
    loaded = load(head + yaml.safe_dump({'cam0': KALIBR | changes}))
    assert (loaded.model, loaded.camera_name, loaded.assumed) == (expected, 'cam0', '')


def test_a_camera_of_euroc_is_read(load):
    """One camera without a chain."""
    tree = {key: value for key, value in KALIBR.items() if key != 'distortion_coeffs'} | {
        'distortion_coefficients': FOUR,
        'distortion_model': 'radial-tangential',
        'T_BS': {'cols': 4, 'rows': 4, 'data': [0.0] * 16},
    }
    assert load(tree).model == model('plumb_bob', [*FOUR, 0.0])


@pytest.mark.parametrize('name', ['cam1', 'right'])
def test_one_of_several_cameras_is_selected_by_key_or_topic(load, name):
    right = KALIBR | {'intrinsics': [7.0, 7.0, 8.0, 9.0], 'rostopic': '/right/image_raw'}
    chain = {'cam0': KALIBR, 'cam1': right}
    loaded = load(chain, name)
    assert (loaded.camera_name, loaded.model.center_px) == ('cam1', (8.0, 9.0))
    with pytest.raises(ConfigError, match='got cam0, cam1: set camera_name'):
        load(chain)


@pytest.mark.parametrize(
    ('kind', 'distortion', 'projection', 'expected'),
    [
        (
            'PINHOLE',
            dict(zip(('k1', 'k2', 'p1', 'p2'), FOUR, strict=True)),
            {'fx': 500.0, 'fy': 505.0, 'cx': 320.0, 'cy': 240.0},
            model('plumb_bob', [*FOUR, 0.0]),
        ),
        (
            'KANNALA_BRANDT',
            None,
            dict(zip(('k2', 'k3', 'k4', 'k5'), FOUR, strict=True))
            | {'mu': 500.0, 'mv': 505.0, 'u0': 320.0, 'v0': 240.0},
            model('equidistant', FOUR),
        ),
    ],
)
def test_files_of_camodocal(load, kind, distortion, projection, expected):
    tree = {
        'model_type': kind,
        'camera_name': 'camera',
        'image_width': 640,
        'image_height': 480,
        'distortion_parameters': distortion,
        'projection_parameters': projection,
    }
    assert load('%YAML:1.0\n---\n' + yaml.safe_dump(tree)).model == expected


@pytest.mark.parametrize(
    ('tree', 'message'),
    [
        (
            {'cam0': KALIBR | {'camera_model': 'omni', 'intrinsics': [1.0, 5, 5, 3, 2]}},
            "cam0.camera_model: expected pinhole, got 'omni': calibrate again with Kalibr's pinh",
        ),
        ({'cam0': KALIBR | {'camera_model': 'ds'}}, "got 'ds': calibrate again"),
        ({'cam0': KALIBR | {'camera_model': 'eucm'}}, "got 'eucm': calibrate again"),
        (
            {'cam0': KALIBR | {'distortion_model': 'fov', 'distortion_coeffs': [0.9]}},
            "cam0.distortion_model: expected one of plumb_bob, .*, got 'fov': calibrate again",
        ),
        ({'cam0': KALIBR | {'resolution': [640]}}, 'cam0.resolution: expected width and height'),
        (ros(xi=1.2), 'xi: expected no omnidirectional camera, got 1.2: calibrate again'),
        (ros(camera_model='omni'), "camera_model: expected pinhole or fisheye, got 'omni': corr"),
        (
            ros(camera_model='fisheye', distortion_coefficients=matrix(1, 4, FOUR)),
            'distortion_model: expected equidistant, as camera_model is fisheye, .*: correct one',
        ),
        (
            ros(distortion_coefficients=matrix(1, 14, [*EIGHT, 0, 0, 0, 0.1, 0, 0])),
            'distortion_coefficients.data: expected no thin prism .*without OpenCV',
        ),
        (ros(distortion_coefficients=None), 'distortion_coefficients: expected the coefficients'),
        (
            ros(image_width=None),
            'image_width: expected an integer > 0, got none: add image_width and image_height',
        ),
        (
            ros(camera_matrix=None),
            'camera_matrix: expected a 3x3 matrix, got none: save K under this key',
        ),
        ('<?xml version="1.0"?>\n<opencv_storage/>', 'expected YAML, got XML: save it as .yaml'),
        ('# oST version 5.0\n\n[image]\n\nwidth\n640\n', 'got .ini: use ost.yaml'),
    ],
)
def test_other_files_are_rejected_with_a_way_out(load, tree, message):
    with pytest.raises(ConfigError, match=message) as caught:
        load(tree)
    assert str(caught.value).isprintable()
