# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""Level and message on /diagnostics, with the clock of the test."""

from dataclasses import replace

from events import (
    AMBIGUOUS,
    BAD_FIELDS,
    estimate,
    GOOD,
    level_and_message,
    NO_SIZE,
    reject,
    UNDETERMINED,
)
import numpy as np
from p4pfr_ros import Status
from p4pfr_ros.ros.pose.health import Health, Level, STALE_AFTER_S
from p4pfr_ros.ros.runtime.rejections import Notice, Rejected
import pytest

IDLE = (Level.OK, 'idle: no board detected, or no subscribers')
ESTIMATING = (Level.OK, 'estimating poses')


def test_without_points_it_is_stale():
    """From the start, and when they stop."""
    health = Health(0.0)
    assert level_and_message(health, 0.0) == (Level.STALE, 'no points received yet')
    estimate(health, 1.0)
    assert level_and_message(health, 1.0 + STALE_AFTER_S) == ESTIMATING
    level, message = level_and_message(health, 1.1 + STALE_AFTER_S)
    assert (level, message) == (Level.STALE, 'no points received for 3 s')


def test_estimates_are_ok():
    """The message is the state of the calibration, if there is one."""
    health = Health(0.0)
    estimate(health, 1.0)
    assert level_and_message(health, 1.0) == ESTIMATING
    health.calibrated(1.0, 'converging', 3, None, restarted=False)
    assert level_and_message(health, 1.0) == (Level.OK, 'converging')


def test_messages_without_subscribers_are_ok():
    health = Health(0.0)
    health.received(1.0)
    assert level_and_message(health, 1.0) == IDLE


def test_it_is_idle_only_if_the_last_message_was_neither_estimated_nor_rejected():
    """Not because of a pause: a camera may be slow."""
    health = Health(0.0)
    estimate(health, 1.0)
    assert level_and_message(health, 3.9) == ESTIMATING
    health.received(4.0)
    assert level_and_message(health, 4.0) == IDLE
    reject(health, 4.1, BAD_FIELDS)
    assert level_and_message(health, 6.5) == ESTIMATING


def test_one_rejected_message_among_skipped_ones_is_a_warning():
    """Also at a low rate; only rejected messages in a row are an error."""
    health = Health(0.0)
    for now_s in (1.0, 1.1, 1.2):
        health.received(now_s)
    reject(health, 1.3, BAD_FIELDS)
    assert level_and_message(health, 1.3) == (
        Level.WARN,
        'rejected (fields): expected other fields',
    )
    reject(health, 1.4, BAD_FIELDS)
    assert level_and_message(health, 1.4)[0] is Level.WARN
    health.received(3.9)
    assert level_and_message(health, 3.9) == IDLE
    health.received(8.0)
    reject(health, 11.0, BAD_FIELDS)
    assert level_and_message(health, 11.0)[0] is Level.WARN
    reject(health, 12.0, BAD_FIELDS)
    assert level_and_message(health, 12.0)[0] is Level.ERROR
    health.received(12.1)
    health.received(12.2)
    assert level_and_message(health, 12.2)[0] is Level.WARN


def test_an_error_ends_with_the_rejections():
    """Other reasons have their own level."""
    health = Health(0.0)
    health.calibrated(1.0, 'uncalibrated', 0, None, restarted=True)
    for now_s in (1.0, 2.0):
        reject(health, now_s, BAD_FIELDS)
    assert level_and_message(health, 3.9)[0] is Level.ERROR
    assert level_and_message(health, 4.1)[0] is Level.WARN


def test_a_message_with_one_estimated_board_is_good():
    """In any order of its boards."""
    health = Health(0.0)
    for now_s in (1.0, 3.5, 6.0):
        reject(health, now_s, BAD_FIELDS)
        health.estimated(now_s, GOOD, 0.001, 0.02)
        estimate(health, now_s + 0.1)
        health.rejected(now_s + 0.1, BAD_FIELDS)
        assert level_and_message(health, now_s + 0.1)[0] is Level.WARN


def test_a_camera_info_is_not_a_message_with_points():
    """Its rejection is reported, but is not a rejection of points."""
    health = Health(0.0)
    wrong = Rejected('camera_info', 'width is 0')
    for now_s in (1.0, 2.0, 3.0, 4.0):
        health.received(now_s)
        health.rejected(now_s, wrong)
    assert level_and_message(health, 4.0) == (Level.WARN, 'rejected (camera_info): width is 0')
    assert health.status(4.0).values['rejected.camera_info'] == '4'


def test_failed_saving_is_a_warning_until_it_is_retried():
    """Other notices have their own reasons, or are only logged."""
    health = Health(0.0)
    health.warned(1.0, Notice('not_saved', 'the disk is full'))
    health.warned(1.0, Notice('frame_id', 'another camera?'))
    estimate(health, 60.0)
    assert level_and_message(health, 60.0) == (Level.WARN, 'not_saved: the disk is full')
    estimate(health, 72.0)
    assert level_and_message(health, 72.0)[0] is Level.OK


def test_disabled_is_ok():
    """It is neither stale nor an error."""
    health = Health(0.0)
    health.enabled = False
    assert level_and_message(health, 9.0) == (Level.OK, 'disabled: messages are ignored')


@pytest.mark.parametrize(
    ('result', 'word'), [(AMBIGUOUS, 'ambiguous'), (UNDETERMINED, 'distance, focal, distortion')]
)
def test_a_view_with_little_information_is_a_warning_for_some_seconds(result, word):
    """The level does not flicker if every second view is one."""
    health = Health(0.0)
    estimate(health, 1.0, result)
    estimate(health, 1.5)
    level, message = level_and_message(health, 1.6)
    assert level is Level.WARN
    assert word in message
    estimate(health, 3.5)
    assert level_and_message(health, 3.5)[0] is Level.OK


def test_a_changed_camera_is_reported_for_some_seconds():
    health = Health(0.0)
    estimate(health, 1.0)
    health.calibrated(1.0, 'uncalibrated', 0, None, restarted=True)
    estimate(health, 9.0)
    level, message = level_and_message(health, 9.0)
    assert level is Level.WARN
    assert 'the camera has changed' in message
    estimate(health, 12.0)
    assert level_and_message(health, 12.0) == (Level.OK, 'uncalibrated')


def test_some_rejected_is_a_warning_and_all_rejected_an_error():
    health = Health(0.0)
    estimate(health, 1.0)
    reject(health, 2.0, BAD_FIELDS)
    assert level_and_message(health, 2.0) == (
        Level.WARN,
        'rejected (fields): expected other fields',
    )
    reject(health, 3.5, BAD_FIELDS)
    assert level_and_message(health, 3.5)[0] is Level.ERROR
    estimate(health, 4.0)
    assert level_and_message(health, 4.0)[0] is Level.WARN
    estimate(health, 5.6)
    assert level_and_message(health, 5.6)[0] is Level.OK


def test_the_most_severe_reason_comes_first():
    """All are listed."""
    health = Health(0.0)
    estimate(health, 1.0, AMBIGUOUS)
    reject(health, 1.1, NO_SIZE)
    level, message = level_and_message(health, 1.2)
    assert level is Level.ERROR
    first, second = message.split('; ')
    assert 'no_image_size' in first
    assert 'ambiguous' in second


def test_few_inliers_are_a_warning_below_four_fifths():
    """Points that are wrong, or have moved on the board."""
    health = Health(0.0)
    inliers = np.ones(30, dtype=bool)
    inliers[:6] = False
    estimate(health, 1.0, replace(GOOD, inliers=inliers.copy()))
    assert level_and_message(health, 1.0) == ESTIMATING
    inliers[:11] = False
    estimate(health, 1.5, replace(GOOD, inliers=inliers))
    level, message = level_and_message(health, 1.5)
    assert level is Level.WARN
    assert message.startswith('inlier ratio 0.63: ')
    assert level_and_message(health, 4.0) == ESTIMATING


def test_a_search_that_was_cut_short_is_a_warning():
    health = Health(0.0)
    estimate(health, 1.0, replace(GOOD, status=Status.SPENT))
    level, message = level_and_message(health, 1.0)
    assert level is Level.WARN
    assert message.startswith('search ended by robust.max_iterations')


def test_a_calibration_that_does_not_fit_is_an_error():
    """At once: each pose would be wrong."""
    health = Health(0.0)
    estimate(health, 1.0)
    reject(health, 1.1, Rejected('misfit', Status.MISFIT.value))
    level, message = level_and_message(health, 1.1)
    assert level is Level.ERROR
    assert message == 'rejected (misfit): the calibration does not fit this image'
