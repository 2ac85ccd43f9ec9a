# Copyright 2026 p4pfr_ros maintainers
#
# Licensed under the Apache License, Version 2.0 (the "License");
# you may not use this file except in compliance with the License.
# You may obtain a copy of the License at
#
#     http://www.apache.org/licenses/LICENSE-2.0
#
# Unless required by applicable law or agreed to in writing, software
# distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied.
# See the License for the specific language governing permissions and
# limitations under the License.

"""What /diagnostics says: levels with their reasons, and numbers; the clock is the test's."""

from dataclasses import replace

from builtin_interfaces.msg import Time
from diagnostic_msgs.msg import DiagnosticStatus
import numpy as np
from p4pfr_ros import DivisionCamera, estimate_pose, Observability
from p4pfr_ros.core.camera_estimate import CameraEstimate
from p4pfr_ros.ros.conversions.diagnostics import diagnostics_msg
from p4pfr_ros.ros.health import Health, Level, STALE_AFTER_S, Status
from p4pfr_ros.ros.rejections import Rejected
import pytest
import scenes

SEEN = scenes.seen(scenes.GRID) + np.random.default_rng(3).normal(0.0, 0.2, scenes.GRID.shape)
SEEN[7] += 30.0
GOOD = estimate_pose(SEEN, scenes.GRID, image_size=scenes.SIZE)
AMBIGUOUS = replace(GOOD, alternatives=(GOOD.model,))
UNSEEN = replace(GOOD, observable=Observability(direction=True))
NO_SIZE = Rejected('no_image_size', 'the size of the picture is not known')
BROKEN = Rejected('fields', 'expected other fields')


def answer(health, now_s, estimate=GOOD, latency_s=0.001):
    """Let a message come and be answered."""
    health.received(now_s)
    health.answered(now_s, estimate, latency_s, 0.02)


def reject(health, now_s, rejected):
    """Let a message come and be rejected."""
    health.received(now_s)
    health.rejected(now_s, rejected)


def head(health, now_s):
    """Return level and message."""
    status = health.status(now_s)
    return status.level, status.message


def test_without_corners_it_is_stale():
    """From the start, and again when they stop; each time it says which."""
    health = Health(0.0)
    assert head(health, 0.0) == (Level.STALE, 'no corners yet')
    answer(health, 1.0)
    assert head(health, 1.0 + STALE_AFTER_S) == (Level.OK, 'idle: nobody listens to the answers')
    level, message = head(health, 1.1 + STALE_AFTER_S)
    assert (level, message) == (Level.STALE, 'no corners for more than 3 s')


def test_answers_are_well():
    """Then the message is the calibration's state, where there is one."""
    health = Health(0.0)
    answer(health, 1.0)
    assert head(health, 1.0) == (Level.OK, 'messages are answered')
    health.calibrated(1.0, 'converging', 3, None, restarted=False)
    assert head(health, 1.0) == (Level.OK, 'converging')


def test_messages_that_nobody_wants_answered_are_no_fault():
    health = Health(0.0)
    health.received(1.0)
    assert head(health, 1.0) == (Level.OK, 'idle: nobody listens to the answers')


def test_disabled_is_what_somebody_wanted():
    """It is neither stale nor wrong."""
    health = Health(0.0)
    health.enabled = False
    assert head(health, 9.0) == (Level.OK, 'disabled: messages are not answered')


@pytest.mark.parametrize(
    ('estimate', 'word'), [(AMBIGUOUS, 'ambiguous'), (UNSEEN, 'distance, focal, distortion')]
)
def test_a_doubtful_view_is_a_warning_for_a_while(estimate, word):
    """Every second view may be such a one: the level does not flicker with them."""
    health = Health(0.0)
    answer(health, 1.0, estimate)
    answer(health, 1.5)
    level, message = head(health, 1.6)
    assert level is Level.WARN
    assert word in message
    answer(health, 3.5)
    assert head(health, 3.5)[0] is Level.OK


def test_a_camera_that_has_changed_is_said_for_some_seconds():
    health = Health(0.0)
    answer(health, 1.0)
    health.calibrated(1.0, 'uncalibrated', 0, None, restarted=True)
    answer(health, 9.0)
    level, message = head(health, 9.0)
    assert level is Level.WARN
    assert 'the camera has changed' in message
    answer(health, 12.0)
    assert head(health, 12.0) == (Level.OK, 'uncalibrated')


def test_some_rejected_is_a_warning_and_all_rejected_an_error():
    health = Health(0.0)
    answer(health, 1.0)
    reject(health, 2.0, BROKEN)
    assert head(health, 2.0) == (Level.WARN, 'rejected, fields: expected other fields')
    reject(health, 3.5, BROKEN)
    assert head(health, 3.5)[0] is Level.ERROR
    answer(health, 4.0)
    assert head(health, 4.0)[0] is Level.WARN
    answer(health, 5.6)
    assert head(health, 5.6)[0] is Level.OK


def test_the_gravest_reason_comes_first():
    """All are told."""
    health = Health(0.0)
    answer(health, 1.0, AMBIGUOUS)
    reject(health, 1.1, NO_SIZE)
    level, message = head(health, 1.2)
    assert level is Level.ERROR
    first, second = message.split('; ')
    assert 'no_image_size' in first
    assert 'ambiguous' in second


def test_numbers_of_one_view():
    """Without self-calibration, what the view tells of the camera; what it does not is unknown."""
    health = Health(0.0)
    answer(health, 1.0)
    reject(health, 1.0, BROKEN)
    reject(health, 1.0, BROKEN)
    values = health.status(1.0).values
    assert float(values['focal_px']) == pytest.approx(GOOD.model.camera.focal_px, abs=0.01)
    sigma_px = GOOD.covariance[6, 6] ** 0.5
    assert float(values['focal_sigma_px']) == pytest.approx(sigma_px, abs=0.01)
    assert float(values['k_sigma']) == pytest.approx(GOOD.covariance[7, 7] ** 0.5, abs=1e-5)
    assert values['center_x_px'] == '319.50'
    assert values['center_x_sigma_px'] == 'unknown'
    assert values['distortion_order'] == '1'
    assert float(values['inlier_ratio']) == pytest.approx(29 / 30, abs=1e-3)
    assert float(values['rms_px']) == pytest.approx(GOOD.rms_px, abs=1e-3)
    assert (values['received'], values['answered']) == ('3', '1')
    assert values['rejected.fields'] == '2'
    assert values['stamp_age_ms'] == '20.0'
    answer(health, 2.0, UNSEEN)
    values = health.status(2.0).values
    assert values['focal_px'] == values['focal_sigma_px'] == values['k'] == 'unknown'


def test_numbers_of_the_calibrated_camera():
    """They stand above those of one view, and their names are the same."""
    health = Health(0.0)
    before = set(health.status(0.5).values)
    answer(health, 1.0)
    camera = DivisionCamera(533.0, (342.3, 233.9), -0.2, 0.01)
    variances = np.square([0.4, 0.5, 0.25, 0.001, 0.0, 0.0])
    fused = CameraEstimate(camera, np.diag(variances), rms_px=0.125, views=13)
    health.calibrated(1.0, 'calibrated', 13, fused, restarted=False)
    health.camera_info('rational_polynomial', 0.01)
    values = health.status(1.0).values
    assert set(values) == before
    expected = {
        'calibration': 'calibrated',
        'views': '13',
        'focal_px': '533.00',
        'focal_sigma_px': '0.40',
        'k': '-0.20000',
        'k_sigma': '0.00100',
        'k2': '0.01000',
        'distortion_order': '2',
        'center_x_px': '342.30',
        'center_x_sigma_px': '0.50',
        'center_y_sigma_px': '0.25',
        'calibration_rms_px': '0.125',
        'camera_info_model': 'rational_polynomial',
        'camera_info_residual_px': '0.0100',
    }
    assert expected.items() <= values.items()
    variances[1:3] = 0.0
    assumed = CameraEstimate(camera, np.diag(variances), rms_px=0.125, views=13)
    health.calibrated(1.0, 'calibrated', 13, assumed, restarted=False)
    values = health.status(1.0).values
    assert (values['center_x_px'], values['center_x_sigma_px']) == ('342.30', 'unknown')


def test_it_is_published_every_second_and_at_once_on_change():
    """A change of a number, or of a reason's wording, is none; and changes wait a tenth."""
    health = Health(0.0)
    assert health.due(0.0)
    health.status(0.0)
    assert not health.due(0.99)
    assert health.due(1.0)
    health.status(1.0)
    answer(health, 1.05)
    assert not health.due(1.05)
    assert health.due(1.1)
    health.status(1.1)
    answer(health, 1.3)
    assert not health.due(1.3)
    reject(health, 1.4, BROKEN)
    assert health.due(1.4)
    health.status(1.4)
    reject(health, 1.6, Rejected('fields', 'expected something else'))
    assert not health.due(1.6)
    reject(health, 1.7, NO_SIZE)
    assert health.due(1.7)


def test_corners_that_stop_are_noticed_by_the_clock_alone():
    health = Health(0.0)
    answer(health, 1.0)
    health.status(3.5)
    assert not health.due(3.9)
    assert health.due(4.1)


def test_the_levels_are_those_of_the_message():
    names = {level.name: bytes([level]) for level in Level}
    assert names == {name: getattr(DiagnosticStatus, name) for name in names}
    assert len(names) == 4


def test_a_status_becomes_a_message():
    """One status, with all its values in order."""
    status = Status(Level.WARN, 'why', {'b': '1', 'a': '2'})
    msg = diagnostics_msg(Time(sec=7), 'pose_node: camera', 'a_camera', status)
    assert msg.header.stamp.sec == 7
    (only,) = msg.status
    assert (only.level, only.message) == (DiagnosticStatus.WARN, 'why')
    assert (only.name, only.hardware_id) == ('pose_node: camera', 'a_camera')
    assert [(v.key, v.value) for v in only.values] == [('b', '1'), ('a', '2')]
