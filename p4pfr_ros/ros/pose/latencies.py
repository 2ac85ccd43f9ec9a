# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""How often and how fast the node has answered lately."""

from __future__ import annotations

from collections import deque
from itertools import takewhile
import math

import numpy as np

WINDOW_S = 5.0

# At more answers than that in a window, it is a shorter one.
_MOST = 8192


class Latencies:
    """
    Answers over a sliding window of some seconds.

    Noting one costs a few tenths of a microsecond; sorting waits until somebody asks. Times are
    seconds of any steady clock.
    """

    def __init__(self, start_s: float) -> None:
        self._start_s = start_s
        self._answers: deque[tuple[float, float]] = deque(maxlen=_MOST)

    def add(self, now_s: float, latency_s: float) -> None:
        """Note an answer, and how long after its message it came."""
        self._answers.append((now_s, latency_s))

    def rate_hz(self, now_s: float) -> float:
        """Return the answers per second."""
        count = len(self._within(now_s))
        begin_s = max(self._start_s, now_s - WINDOW_S)
        if count == _MOST:
            begin_s = max(begin_s, self._answers[0][0])
        # In the first moments a single answer is no rate of a thousand.
        return count / max(now_s - begin_s, 1.0)

    def quantiles_s(self, now_s: float, *shares: float) -> list[float]:
        """Return the latencies that these shares (0 to 1) of the answers were within, or NaN."""
        latencies = self._within(now_s)
        if not latencies:
            return [math.nan for _ in shares]
        # One that was measured, not one in between two.
        found: list[float] = np.quantile(latencies, shares, method='inverted_cdf').tolist()
        return found

    def _within(self, now_s: float) -> list[float]:
        recent = takewhile(lambda answer: answer[0] > now_s - WINDOW_S, reversed(self._answers))
        return [latency_s for _, latency_s in recent]
