# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""The rate of a stream, and what is missing in it."""

import numpy as np
from p4pfr_ros.ros.runtime.stream_rate import StreamRate
import pytest


def fed(stamps_s):
    """Return a StreamRate that received messages with these stamps."""
    rate = StreamRate()
    for stamp_s in stamps_s:
        rate.add(stamp_s)
    return rate


def jittered(count, period_s, seed=0):
    """Return stamps with a tenth of the period as jitter."""
    rng = np.random.default_rng(seed)
    return 1.7e9 + period_s * (np.arange(count) + rng.uniform(-0.05, 0.05, count))


@pytest.mark.parametrize('period_s', [0.005, 1 / 30, 0.5])
def test_the_period_is_learned_and_nothing_is_missing(period_s):
    rate = fed(jittered(60, period_s))
    assert rate.period_s == pytest.approx(period_s, rel=0.1)
    assert rate.missed_count == 0


@pytest.mark.parametrize('share', [0.1, 0.4])
def test_missing_messages_are_counted(share):
    """Once the rate is known; before, a long interval may be the period."""
    stamps_s = jittered(200, 1 / 30)
    lost = np.random.default_rng(1).random(200) < share
    lost[:12] = lost[-1] = False
    assert fed(stamps_s[~lost]).missed_count == lost.sum()


def test_only_the_last_ten_seconds_are_recent():
    stamps_s = jittered(900, 1 / 30)
    lost = np.isin(np.arange(900), [100, 101, 800])
    received, missed = fed(stamps_s[~lost]).recent
    assert missed == 1
    assert received == pytest.approx(300, abs=3)


def test_a_pause_or_a_jump_back_is_no_loss():
    stamps_s = jittered(60, 1 / 30)
    assert fed([*stamps_s, *(stamps_s + 60.0)]).missed_count == 0
    assert fed([*stamps_s, *stamps_s]).missed_count == 0
    assert fed(np.zeros(60)).period_s is None


def test_an_irregular_stream_has_no_rate():
    stamps_s = np.cumsum(np.random.default_rng(2).exponential(0.3, 200).clip(0.01, 2.5))
    rate = fed(stamps_s)
    assert rate.period_s is None
