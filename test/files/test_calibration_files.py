# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""Calibration files: lossless, compatible with ROS, written atomically."""

from pathlib import Path
import signal
import subprocess
import sys
import time

import numpy as np
from p4pfr_ros import BoardShape, DivisionCamera
from p4pfr_ros.core.cameras.camera_info import CameraInfoModel
from p4pfr_ros.core.many_views.results import CameraEstimate
from p4pfr_ros.files.calibration import Calibration, load_calibration, save_calibration
from p4pfr_ros.files.writing import write_atomically
from p4pfr_ros.files.yaml_fields import ConfigError
import pytest
import yaml

SIZE = (1280, 960)
RNG = np.random.default_rng(2)
SIGMAS = [1.0, 0.5, 0.5, 1e-3, 1e-4, 0.0, 1e-5, 1e-3, 1e-4, 1e-4]
FACTOR = np.array(SIGMAS)[:, None] * RNG.normal(size=(10, 10))
SHAPE_FACTOR = 1e-4 * RNG.normal(size=(8, 8))
SHAPES = {
    name: BoardShape(
        np.array([0.0, 0.01]), np.array([0.1, side]), RNG.normal(0.0, 1e-3, 8), covariance
    )
    for name, side, covariance in (
        ('wall', 0.07, SHAPE_FACTOR @ SHAPE_FACTOR.T),
        ('', 0.0, np.zeros((8, 8))),
        ('7', 0.02, 1e-8 * np.eye(8)),
    )
}
ESTIMATE = CameraEstimate(
    DivisionCamera(612.34567890123, (641.25, 478.5), -0.25, 1e-7, 0.0, 1e-9, 1.01, 1e-3, -2e-4),
    FACTOR @ FACTOR.T,
    0.21,
    17,
    scatter=1.75,
    projection_sigma_px=0.123,
    seen_radius_px=512.5,
    board_shapes=SHAPES,
    coverage=RNG.random((12, 16)) < 0.5,
)
CALIBRATION = Calibration.from_estimate(ESTIMATE, SIZE, 'front_left')
# Of version 0.1.0.
OLD_DIVISION = """\
division:
  focal_px: 533.0
  center_px: [342.0, 234.0]
  k: -0.25
  k2: 0.01
  k3: 0.0
  covariance:
    rows: 6
    cols: 6
    data: [4, 0, 0, 0, 0, 0, 0, 1, 0, 0, 0, 0, 0, 0, 1, 0, 0, 0,
           0, 0, 0, 1e-4, 0, 0, 0, 0, 0, 0, 1e-6, 0, 0, 0, 0, 0, 0, 0]
  rms_px: 0.2
  views: 13
  residual_px: 0.01
"""
# In the form of camera_calibration, with small numbers in the form of yaml-cpp.
ROS_FILE = """\
image_width: 640
image_height: 480
camera_name: 00b09d01
camera_matrix:
  rows: 3
  cols: 3
  data: [533.1, 0, 342.3, 0, 533.2, 233.9, 0, 0, 1]
distortion_model: plumb_bob
distortion_coefficients:
  rows: 1
  cols: 5
  data: [-0.28, 0.03, 1e-05, -1.5e-04, 0]
rectification_matrix:
  rows: 3
  cols: 3
  data: [1, 0, 0, 0, 1, 0, 0, 0, 1]
projection_matrix:
  rows: 3
  cols: 4
  data: [500.0, 0, 343, 0, 0, 510.0, 232, 0, 0, 0, 1, 0]
avg_reprojection_error: 0.2
"""


@pytest.fixture
def path(tmp_path):
    return tmp_path / 'camera.yaml'


def test_a_calibration_round_trips(path):
    save_calibration(path, CALIBRATION)
    loaded = load_calibration(path)
    assert (loaded.image_size, loaded.camera_name) == (SIZE, 'front_left')
    assert loaded.model == CALIBRATION.model
    assert loaded.model.residual_outside_px > loaded.model.residual_px > 0.0
    assert loaded.estimate == ESTIMATE
    assert list(loaded.estimate.board_shapes) == list(SHAPES)


def test_what_is_not_known_is_not_in_the_file(path):
    """No NaN, which is no number in YAML files of other programs."""
    estimate = CameraEstimate(ESTIMATE.camera, ESTIMATE.covariance, 0.21, 17)
    save_calibration(path, Calibration.from_estimate(estimate, SIZE, 'left'))
    assert load_calibration(path).estimate == estimate
    assert 'nan' not in path.read_text()
    keys = yaml.safe_load(path.read_text())['division'].keys()
    assert not {'projection_sigma_px', 'seen_radius_px', 'coverage', 'boards'} & keys


def test_the_coverage_is_a_picture(path):
    """One line a row of the image."""
    save_calibration(path, CALIBRATION)
    lines = [line.strip(" -'") for line in path.read_text().splitlines()]
    rows = [line for line in lines if set(line) <= {'.', '#'} and len(line) == 16]
    assert [[mark == '#' for mark in row] for row in rows] == ESTIMATE.coverage.tolist()


def test_a_file_of_the_first_version_is_loaded(path):
    """Square pixels, no decentring, three terms, and a smaller covariance."""
    path.write_text(ROS_FILE + OLD_DIVISION)
    loaded = load_calibration(path)
    variances = [4.0, 1.0, 1.0, 1e-4, 1e-6, 0.0, 0.0, 0.0, 0.0, 0.0]
    camera = DivisionCamera(533.0, (342.0, 234.0), -0.25, 0.01)
    assert loaded.estimate == CameraEstimate(camera, np.diag(variances), 0.2, 13)
    assert (loaded.model.residual_px, loaded.model.residual_outside_px) == (0.01, 0.0)


def test_the_model_is_fitted_where_the_lens_was_seen(path):
    """The outermost rays of a wide lens are not worth the others."""
    camera = DivisionCamera(300.0, (639.5, 479.5), -0.3, -0.02, -0.002)
    residuals = [
        Calibration.from_estimate(
            CameraEstimate(camera, FACTOR @ FACTOR.T, 0.2, 9, seen_radius_px=radius_px), SIZE, 'x'
        ).model.residual_px
        for radius_px in (300.0, None)
    ]
    assert residuals[0] < 0.5 * residuals[1]


@pytest.mark.parametrize(
    ('kind', 'd', 'skew_px'),
    [
        ('plumb_bob', (0.1, 0, 0, 0, 1e-9), 0.0),
        ('equidistant', (1, 2, 3, 4), -0.9),
        ('plumb_bob', (0,) * 4, 2.5),
    ],
)
def test_a_calibration_without_estimate_round_trips(path, kind, d, skew_px):
    model = CameraInfoModel(kind, d, (500.0, 501.0), (3.0, 4.0), 0.0, SIZE, skew_px=skew_px)
    save_calibration(path, Calibration(image_size=SIZE, camera_name='123', model=model))
    loaded = load_calibration(path)
    assert (loaded.model, loaded.camera_name, loaded.estimate) == (model, '123', None)


def test_the_file_has_the_keys_that_ros_reads(path):
    save_calibration(path, CALIBRATION)
    tree = yaml.safe_load(path.read_text())
    shapes = {
        'camera_matrix': (3, 3),
        'distortion_coefficients': (1, 8),
        'rectification_matrix': (3, 3),
        'projection_matrix': (3, 4),
    }
    matrices = {}
    for key, shape in shapes.items():
        assert (tree[key]['rows'], tree[key]['cols']) == shape
        matrices[key] = np.reshape(tree[key]['data'], shape)
    assert (tree['image_width'], tree['image_height']) == SIZE
    assert tree['camera_name'] == 'front_left'
    assert tree['distortion_model'] == 'rational_polynomial'
    np.testing.assert_array_equal(matrices['camera_matrix'], ESTIMATE.camera.matrix)
    np.testing.assert_array_equal(matrices['projection_matrix'][:, :3], matrices['camera_matrix'])
    np.testing.assert_array_equal(matrices['projection_matrix'][:, 3], 0.0)
    np.testing.assert_array_equal(matrices['rectification_matrix'], np.eye(3))


def test_a_file_of_camera_calibration_is_loaded(path):
    path.write_text(ROS_FILE)
    loaded = load_calibration(path)
    assert loaded.camera_name == '00b09d01'
    assert loaded.estimate is None
    assert loaded.model == CameraInfoModel(
        'plumb_bob',
        (-0.28, 0.03, 1e-5, -1.5e-4, 0.0),
        (533.1, 533.2),
        (342.3, 233.9),
        0.0,
        (640, 480),
    )


def test_keys_that_ros_does_not_require_may_be_missing(path):
    lines = [
        line for line in ROS_FILE.splitlines() if not line.startswith(('camera_name', 'dist'))
    ]
    at = next(n for n, line in enumerate(ROS_FILE.splitlines()) if line.startswith('distortion_c'))
    path.write_text('\n'.join([*lines[: at - 2], 'distortion_coefficients:', *lines[at - 2 :]]))
    loaded = load_calibration(path)
    assert (loaded.camera_name, loaded.model.distortion_model) == ('unknown', 'plumb_bob')


def test_a_truncated_file_is_rejected(path):
    """At any length; only the newline at the end may be missing."""
    save_calibration(path, CALIBRATION)
    text = path.read_text()
    for end in (*range(0, len(text) - 1, 29), len(text) - 2):
        path.write_text(text[:end])
        with pytest.raises(ConfigError, match=f'^{path}'):
            load_calibration(path)


@pytest.mark.parametrize(
    ('change', 'message'),
    [
        (('image_width: 640', ''), 'image_width: expected an integer > 0, got none'),
        (('height: 480', 'height: 48.5'), 'image_height: expected an integer > 0, got 48.5'),
        (
            ('533.1', '0'),
            r'camera_matrix\.data: expected a focal length from 0\.001 to 1e\+07 px, got 0',
        ),
        (('533.1', '.nan'), r'camera_matrix\.data: expected a list of 9 finite numbers'),
        (('533.1, 0,', '533.1,'), r'camera_matrix\.data: expected a list of 9 finite numbers'),
        (('533.1', 'wide'), r'camera_matrix\.data: expected a list of 9 finite numbers'),
        (('rows: 3', 'rows: 2'), r'camera_matrix\.rows: expected 3, got 2'),
        (
            ('cols: 5', 'cols: 4'),
            r'distortion_coefficients\.cols: expected 1x5 or 5x1, the length of data, got 4',
        ),
        (('plumb_bob', 'fov'), "distortion_model: expected one of plumb_bob, .*, got 'fov'"),
        (('projection_matrix:\n  rows: 3', 'projection_matrix:\n'), 'projection_matrix.rows: exp'),
        (('avg_reprojection_error: 0.2', 'division: 7'), 'division: expected keys and values'),
        (('image_width: 640', '- 640'), 'expected YAML'),
    ],
)
def test_a_wrong_file_is_reported_with_the_key(path, change, message):
    assert change[0] in ROS_FILE
    path.write_text(ROS_FILE.replace(*change, 1))
    with pytest.raises(ConfigError, match=f'{path}.*{message}'):
        load_calibration(path)


@pytest.mark.parametrize(
    ('change', 'message'),
    [
        (('views: 17', 'views: 0'), r'division\.views: expected an integer > 0, got 0'),
        (('rms_px: 0.21', 'rms_px: -1'), r'division\.rms_px must be finite and ≥ 0, got -1'),
        (
            ('focal_px: 612', 'focal_px: -612'),
            r'division\.focal_px: expected a focal length from 0',
        ),
        (('k2: 1.0e-07', 'k2: yes'), r'division\.k2: expected a finite number, got True'),
        (('k2: 1.0e-07', ''), r'division\.k2: expected a finite number, got none'),
        (('k4: 1.0e-09', ''), r'division\.k4: expected a finite number, got none'),
        (
            ('aspect: 1.01', 'aspect: 0.0'),
            r'division\.aspect: expected a focal length from 0\.001 .*, got 0',
        ),
        (('p2: -0.0002', 'p2: .nan'), r'division\.p2: expected a finite number, got nan'),
        (('cols: 10', 'cols: 5'), r'division\.covariance\.cols: expected 10, got 5'),
        (('rows: 10', 'rows: 7'), r'division\.covariance\.rows: expected 10, got 7'),
        (('scatter: 1.75', ''), r'division\.scatter: expected a finite number, got none'),
        (('scatter: 1.75', 'scatter: 0.5'), r'division\.scatter must be finite and ≥ 1, got 0\.5'),
        (
            ('projection_sigma_px: 0.123', 'projection_sigma_px: .nan'),
            r'division\.projection_sigma_px: expected a finite number ≥ 0, got nan',
        ),
        (
            ('seen_radius_px: 512.5', 'seen_radius_px: 0'),
            r'division\.seen_radius_px must be finite and > 0, got 0',
        ),
        (
            ('coverage:\n  - ', "coverage:\n  - '#'\n  - "),
            r'division\.coverage: expected 12 rows of 16 characters \. or #, got',
        ),
        (('boards:\n', 'boards: 7\n  other:\n'), r'division\.boards: expected keys and values'),
        (('    wall:', '    1:'), r'division\.boards: expected names of boards, got 1'),
        (
            ('center_m: [0.0, 0.01]', 'center_m: [0.0]'),
            r'division\.boards\.wall\.center_m: expected a list of 2 finite numbers',
        ),
        (
            ('half_extent_m: [0.1, 0.07]', 'half_extent_m: [0.1, -1]'),
            r'division\.boards\.wall\.half_extent_m: expected lengths from 0 to 10000 m',
        ),
        (
            ('numbers: [', 'numbers: [7.0, '),
            r'division\.boards\.wall\.numbers: expected a list of 8 finite numbers',
        ),
        (
            ('cols: 8\n        data: [', 'cols: 8\n        data: [-'),
            r'.*covariance: expected a sym',
        ),
        (
            ('residual_px: ', 'residual_px: -'),
            r'division\.residual_px: expected a finite number ≥',
        ),
    ],
)
def test_a_wrong_estimate_is_reported_with_the_key(path, change, message):
    save_calibration(path, CALIBRATION)
    text = path.read_text()
    assert change[0] in text
    path.write_text(text.replace(*change, 1))
    with pytest.raises(ConfigError, match=f'^{path}: {message}'):
        load_calibration(path)


def test_a_missing_file_is_reported(tmp_path):
    with pytest.raises(ConfigError, match='expected a readable file'):
        load_calibration(tmp_path / 'none.yaml')


def test_image_sizes_of_calibration_and_model_must_match():
    with pytest.raises(ValueError, match="image_size must be the model's"):
        Calibration(image_size=(640, 480), camera_name='x', model=CALIBRATION.model)


def test_folders_are_created_and_links_followed(tmp_path):
    target = tmp_path / 'a' / 'b' / 'camera.yaml'
    link = tmp_path / 'link.yaml'
    link.symlink_to(target)
    save_calibration(link, CALIBRATION)
    assert link.is_symlink()
    assert load_calibration(target).camera_name == 'front_left'
    assert [p.name for p in target.parent.iterdir()] == ['camera.yaml']


def test_an_unwritable_path_is_reported(tmp_path):
    (tmp_path / 'file').write_text('not a folder')
    with pytest.raises(ConfigError, match='expected a writable path: Not a directory'):
        save_calibration(tmp_path / 'file' / 'camera.yaml', CALIBRATION)
    with pytest.raises(ConfigError, match='expected a regular file, got a directory'):
        save_calibration(tmp_path, CALIBRATION)
    assert [p.name for p in tmp_path.iterdir()] == ['file']


def test_a_full_disk_leaves_the_old_file(path):
    """Simulated by a limit on the file size, which fails the same system call."""
    path.write_text('old')
    code = f"""
import resource, signal
from p4pfr_ros.files.writing import write_atomically
signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
resource.setrlimit(resource.RLIMIT_FSIZE, (1000, 1000))
write_atomically({str(path)!r}, 'new' * 1000)
"""
    done = subprocess.run([sys.executable, '-c', code], capture_output=True, text=True)
    assert 'ConfigError' in done.stderr
    assert 'File too large' in done.stderr
    assert path.read_text() == 'old'
    assert [p.name for p in path.parent.iterdir()] == ['camera.yaml']


def test_a_kill_while_saving_leaves_a_complete_file(path):
    """SIGKILL, after various delays, a process that saves in a loop."""
    texts = ['a' * 3_000_000, 'b' * 2_000_000]
    write_atomically(path, texts[0])
    code = f"""
from p4pfr_ros.files.writing import write_atomically
print('ready', flush=True)
while True:
    for text in ('a' * 3_000_000, 'b' * 2_000_000):
        write_atomically({str(path)!r}, text)
"""
    for delay_s in (0.013, 0.029, 0.047):
        process = subprocess.Popen([sys.executable, '-c', code], stdout=subprocess.PIPE)
        with process:
            process.stdout.readline()
            time.sleep(delay_s)
            process.send_signal(signal.SIGKILL)
        assert path.read_text() in texts
    assert Path(path).stat().st_size in {len(text) for text in texts}
