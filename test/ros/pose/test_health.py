# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""What /diagnostics says: levels with their reasons; the clock is the test's."""

from events import AMBIGUOUS, answer, BROKEN, GOOD, head, NO_SIZE, reject, UNSEEN
from p4pfr_ros.ros.pose.health import Health, Level, STALE_AFTER_S
from p4pfr_ros.ros.runtime.rejections import Rejected
import pytest

IDLE = (Level.OK, 'idle: no board is seen, or nobody listens to the answers')


def test_without_corners_it_is_stale():
    """From the start, and again when they stop; each time it says which."""
    health = Health(0.0)
    assert head(health, 0.0) == (Level.STALE, 'no corners yet')
    answer(health, 1.0)
    assert head(health, 1.0 + STALE_AFTER_S) == (Level.OK, 'messages are answered')
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
    assert head(health, 1.0) == IDLE


def test_it_is_idle_only_if_the_last_message_was_neither_answered_nor_rejected():
    """Not because that was a while ago: a camera may be slow."""
    health = Health(0.0)
    answer(health, 1.0)
    assert head(health, 3.9) == (Level.OK, 'messages are answered')
    health.received(4.0)
    assert head(health, 4.0) == IDLE
    reject(health, 4.1, BROKEN)
    assert head(health, 6.5) == (Level.OK, 'messages are answered')


def test_one_bad_message_among_those_that_nobody_wants_is_a_warning():
    """Also where they come slowly; only bad ones, one after the other, are an error."""
    health = Health(0.0)
    for now_s in (1.0, 1.1, 1.2):
        health.received(now_s)
    reject(health, 1.3, BROKEN)
    assert head(health, 1.3) == (Level.WARN, 'rejected, fields: expected other fields')
    reject(health, 1.4, BROKEN)
    assert head(health, 1.4)[0] is Level.WARN
    health.received(3.9)
    assert head(health, 3.9) == IDLE
    health.received(8.0)
    reject(health, 11.0, BROKEN)
    assert head(health, 11.0)[0] is Level.WARN
    reject(health, 12.0, BROKEN)
    assert head(health, 12.0)[0] is Level.ERROR
    health.received(12.1)
    health.received(12.2)
    assert head(health, 12.2)[0] is Level.WARN


def test_an_error_is_forgotten_with_the_bad_messages():
    """What else there is to say has its own level."""
    health = Health(0.0)
    health.calibrated(1.0, 'uncalibrated', 0, None, restarted=True)
    for now_s in (1.0, 2.0):
        reject(health, now_s, BROKEN)
    assert head(health, 3.9)[0] is Level.ERROR
    assert head(health, 4.1)[0] is Level.WARN


def test_a_board_of_several_that_is_answered_makes_the_message_a_good_one():
    """In whatever order they come."""
    health = Health(0.0)
    for now_s in (1.0, 3.5, 6.0):
        reject(health, now_s, BROKEN)
        health.answered(now_s, GOOD, 0.001, 0.02)
        answer(health, now_s + 0.1)
        health.rejected(now_s + 0.1, BROKEN)
        assert head(health, now_s + 0.1)[0] is Level.WARN


def test_a_camera_info_is_no_message_with_corners():
    """What is wrong with it is said, but it does not answer for the corners."""
    health = Health(0.0)
    wrong = Rejected('camera_info', 'width is 0')
    for now_s in (1.0, 2.0, 3.0, 4.0):
        health.received(now_s)
        health.rejected(now_s, wrong)
    assert head(health, 4.0) == (Level.WARN, 'rejected, camera_info: width is 0')
    assert health.status(4.0).values['rejected.camera_info'] == '4'


def test_a_calibration_that_could_not_be_saved_is_a_warning_until_it_is_tried_again():
    """Other remarks are told of by what they are about, or in the log alone."""
    health = Health(0.0)
    health.remarked(1.0, Rejected('not_saved', 'the disk is full'))
    health.remarked(1.0, Rejected('frame_id', 'another camera?'))
    answer(health, 60.0)
    assert head(health, 60.0) == (Level.WARN, 'not_saved: the disk is full')
    answer(health, 72.0)
    assert head(health, 72.0)[0] is Level.OK


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
