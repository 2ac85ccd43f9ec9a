# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""Rate and latency over the last seconds, with the clock of the test."""

import numpy as np
from p4pfr_ros.ros.pose.health_values import Latencies, WINDOW_S
import pytest


def test_quantiles_are_measured_latencies_of_the_window():
    """Latencies before the window do not count."""
    latencies = Latencies(0.0)
    latencies.add(1.0, 9.0)
    for i in range(100):
        latencies.add(2.0 + 0.01 * i, 0.001 * (i + 1))
    assert latencies.quantiles_s(1.5 + WINDOW_S, 0.5, 0.99, 1.0) == [0.050, 0.099, 0.100]
    assert latencies.quantiles_s(0.9 + WINDOW_S, 1.0) == [9.0]
    assert latencies.rate_hz(1.5 + WINDOW_S) == pytest.approx(100 / WINDOW_S)
    assert np.isnan(latencies.quantiles_s(99.0, 0.5)).all()
    assert latencies.rate_hz(99.0) == 0.0


@pytest.mark.parametrize('rate_hz', [30.0, 1000.0, 4000.0])
def test_the_rate_is_right_from_the_first_second_on(rate_hz):
    """Also with more estimates than are stored."""
    latencies = Latencies(100.0)
    for i in range(1, int(7 * rate_hz) + 1):
        now_s = 100.0 + i / rate_hz
        latencies.add(now_s, 0.001)
        if i in (int(2 * rate_hz), int(7 * rate_hz)):
            assert latencies.rate_hz(now_s) == pytest.approx(rate_hz, rel=0.01)
