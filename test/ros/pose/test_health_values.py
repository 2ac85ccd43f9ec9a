# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""The numbers on /diagnostics and the times of publishing, with the clock of the test."""

from builtin_interfaces.msg import Time
from diagnostic_msgs.msg import DiagnosticStatus
from events import AMBIGUOUS, BAD_FIELDS, estimate, GOOD, NO_SIZE, reject, UNDETERMINED
import numpy as np
from p4pfr_ros import BoardShape, CameraEstimate, DivisionCamera
from p4pfr_ros.ros.pose.health import diagnostics_msg, Health, HealthStatus, Level
from p4pfr_ros.ros.runtime.rejections import Rejected
import pytest


def test_numbers_of_one_view():
    """Without self-calibration, the camera of the view; undetermined numbers are unknown."""
    health = Health(0.0)
    estimate(health, 1.0)
    reject(health, 1.0, BAD_FIELDS)
    reject(health, 1.0, BAD_FIELDS)
    values = health.status(1.0).values
    assert float(values['focal_px']) == pytest.approx(GOOD.model.camera.focal_px, abs=0.01)
    sigma_px = GOOD.covariance[6, 6] ** 0.5
    assert float(values['focal_sigma_px']) == pytest.approx(sigma_px, abs=0.01)
    assert float(values['k_sigma']) == pytest.approx(GOOD.covariance[7, 7] ** 0.5, abs=1e-5)
    center_x_px = GOOD.model.camera.center_px[0]
    assert float(values['center_x_px']) == pytest.approx(center_x_px, abs=0.01)
    assert values['center_x_sigma_px'] == 'unknown'
    assert values['distortion_order'] == '3'
    assert float(values['inlier_ratio']) == pytest.approx(29 / 30, abs=1e-3)
    assert float(values['rms_px']) == pytest.approx(GOOD.rms_px, abs=1e-3)
    assert (values['received'], values['answered']) == ('3', '1')
    assert values['rejected.fields'] == '2'
    assert values['stamp_age_ms'] == '20.0'
    assert values['status'] == GOOD.status.value
    estimate(health, 2.0, UNDETERMINED)
    values = health.status(2.0).values
    assert values['focal_px'] == values['focal_sigma_px'] == values['k'] == 'unknown'


CAMERA = DivisionCamera(533.0, (342.3, 233.9), -0.2, 0.01, aspect=1.002, p2=-1e-3)
SHAPE = BoardShape(
    np.zeros(2), np.array([0.1, 0.05]), [0, 0, 0.01, 0, 0, 0, 0, 0], 1e-6 * np.eye(8)
)
SIGMAS = np.array([0.4, 0.5, 0.25, 0.001, 2e-3, 3e-3, 4e-3, 5e-3, 6e-3, 7e-3])
FUSED = CameraEstimate(
    CAMERA,
    np.diag(SIGMAS**2),
    rms_px=0.125,
    views=13,
    scatter=1.5,
    projection_sigma_px=0.1234,
    board_shapes={'wall': SHAPE, '': SHAPE},
)
CALIBRATED_VALUES = {
    'calibration': 'calibrated',
    'views': '13',
    'missing': 'nothing',
    'focal_px': '533.00',
    'focal_sigma_px': '0.40',
    'k': '-0.20000',
    'k_sigma': '0.00100',
    'k2': '0.01000',
    'k2_sigma': '0.00200',
    'k4': '0.00000',
    'k4_sigma': 'unknown',
    'aspect': '1.00200',
    'aspect_sigma': '0.00500',
    'p1_sigma': 'unknown',
    'p2': '-0.00100',
    'p2_sigma': '0.00700',
    'distortion_order': '2',
    'center_x_px': '342.30',
    'center_x_sigma_px': '0.50',
    'center_y_sigma_px': '0.25',
    'calibration_rms_px': '0.125',
    'calibration_scatter': '1.500',
    'projection_sigma_px': '0.123',
    'board.wall': 'bowed by 1.50 ± 0.17 mm',
    'camera_info_model': 'rational_polynomial',
    'camera_info_residual_px': '0.0100',
    'camera_info_residual_outside_px': '2.5000',
}


def test_numbers_of_the_calibrated_camera():
    """They replace those of one view; the names are the same, with those of the boards."""
    health = Health(0.0)
    before = set(health.status(0.5).values)
    estimate(health, 1.0)
    health.calibrated(1.0, 'calibrated', 13, FUSED, restarted=False)
    health.camera_info('rational_polynomial', 0.01, 2.5)
    values = health.status(1.0).values
    assert set(values) == before | {'board.wall', 'board'}
    assert CALIBRATED_VALUES.items() <= values.items()


def test_a_centre_without_uncertainty_is_assumed():
    health = Health(0.0)
    variances = SIGMAS**2
    variances[1:3] = 0.0
    assumed = CameraEstimate(CAMERA, np.diag(variances), rms_px=0.125, views=13)
    health.calibrated(1.0, 'calibrated', 13, assumed, restarted=False)
    values = health.status(1.0).values
    assert (values['center_x_px'], values['center_x_sigma_px']) == ('342.30', 'unknown')


def test_the_message_says_how_well_the_camera_is_known_and_what_is_missing():
    """A change of either is no change of the state: it is published with the next status."""
    health = Health(0.0)
    estimate(health, 1.0)
    health.calibrated(1.0, 'converging', 2, None, restarted=False)
    health.missing = ('tilt the board', 'show the corner')
    status = health.status(1.0)
    assert status.message == 'converging; tilt the board; show the corner'
    assert status.values['missing'] == 'tilt the board; show the corner'
    camera = DivisionCamera(533.0, (342.3, 233.9))
    fused = CameraEstimate(camera, np.eye(10), 0.1, 3, projection_sigma_px=1.234)
    health.calibrated(1.5, 'converging', 3, fused, restarted=False)
    health.missing = ('tilt the board',)
    assert not health.due(1.5)
    estimate(health, 2.0)
    message = health.status(2.0).message
    assert message == 'converging; tilt the board; 1.23 px at most where seen'


def test_it_is_published_every_second_and_after_a_change():
    """At most every 0.1 s; a new number or a new text of a reason is not a change."""
    health = Health(0.0)
    assert health.due(0.0)
    health.status(0.0)
    assert not health.due(0.89)
    assert health.due(0.9999)
    health.status(0.9999)
    estimate(health, 1.05)
    assert not health.due(1.05)
    assert health.due(1.1)
    health.status(1.1)
    estimate(health, 1.3)
    assert not health.due(1.3)
    reject(health, 1.4, BAD_FIELDS)
    assert health.due(1.4)
    health.status(1.4)
    reject(health, 1.6, Rejected('fields', 'expected something else'))
    assert not health.due(1.6)
    reject(health, 1.7, NO_SIZE)
    assert health.due(1.7)


def test_each_call_of_an_inexact_timer_publishes():
    """Early, late, and with changes in between."""
    rng = np.random.default_rng(0)
    health = Health(100.0)
    health.status(100.0)
    # The phase of the timer is arbitrary.
    for second in range(1, 300):
        now_s = 100.4 + second + rng.uniform(-0.01, 0.01)
        assert health.due(now_s), second
        health.status(now_s)
        if rng.integers(3) == 0:
            changed_s = now_s + rng.uniform(0.15, 0.85)
            estimate(health, changed_s, AMBIGUOUS if rng.integers(2) else GOOD)
            if health.due(changed_s):
                health.status(changed_s)


def test_the_message_rate_does_not_change_the_publishing_rate():
    """Any message may publish; one in a second does."""
    health = Health(0.0)
    estimate(health, 0.0)
    health.status(0.0)
    times_s = []
    for i in range(1, 30 * 60):
        estimate(health, i / 30.0)
        if health.due(i / 30.0):
            health.status(i / 30.0)
            times_s.append(i / 30.0)
    assert 59 <= len(times_s) <= 60
    assert np.diff(times_s).max() < 1.2


def test_the_timer_detects_that_points_stop():
    health = Health(0.0)
    estimate(health, 1.0)
    health.status(3.5)
    assert not health.due(3.95)
    assert health.due(4.1)


def test_the_levels_are_those_of_diagnostic_msgs():
    names = {level.name: bytes([level]) for level in Level}
    assert names == {name: getattr(DiagnosticStatus, name) for name in names}
    assert len(names) == 4


def test_a_status_becomes_a_message():
    """One status with all values in order."""
    status = HealthStatus(Level.WARN, 'why', {'b': '1', 'a': '2'})
    msg = diagnostics_msg(Time(sec=7), 'pose_node: camera', 'a_camera', status)
    assert msg.header.stamp.sec == 7
    (only,) = msg.status
    assert (only.level, only.message) == (DiagnosticStatus.WARN, 'why')
    assert (only.name, only.hardware_id) == ('pose_node: camera', 'a_camera')
    assert [(v.key, v.value) for v in only.values] == [('b', '1'), ('a', '2')]
