# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""
The rate of a stream of stamped messages, and the messages that are missing in it.

This module stands alone: it does not use ROS.
"""

from __future__ import annotations

from collections import deque

# The rate is known from this many intervals, and learned from the last ones.
_MIN_INTERVALS, _INTERVALS = 8, 30
# Lost messages make intervals longer, never shorter: a low quantile is the period as long as a
# quarter of the intervals are whole.
_QUANTILE = 0.25
# A stream is regular if this share of its intervals are this close to multiples of the period.
_REGULAR_SHARE, _NEAR = 0.7, 0.25
# A longer gap is a pause of the sender, not a loss.
_PAUSE_S = 3.0
_WINDOW_S = 10.0


class StreamRate:
    """Learns the period of a stream and counts the messages that are missing between others."""

    def __init__(self) -> None:
        self.received_count = 0
        self.missed_count = 0
        self._last_s: float | None = None
        self._intervals_s: deque[float] = deque(maxlen=_INTERVALS)
        self._recent: deque[tuple[float, int]] = deque()

    def add(self, stamp_s: float) -> int:
        """Record a message by its stamp; return how many are missing before it."""
        self.received_count += 1
        last_s, self._last_s = self._last_s, stamp_s
        if last_s is None:
            return 0
        interval_s = stamp_s - last_s
        if not 0.0 < interval_s < _PAUSE_S:  # stopped, played again, or without stamps
            self._intervals_s.clear()
            self._recent.clear()
            return 0
        self._intervals_s.append(interval_s)
        period_s = self.period_s
        missed = 0 if period_s is None else max(0, round(interval_s / period_s) - 1)
        self.missed_count += missed
        self._recent.append((stamp_s, missed))
        while self._recent[0][0] < stamp_s - _WINDOW_S:
            self._recent.popleft()
        return missed

    @property
    def period_s(self) -> float | None:
        """The period of the stream, seconds; None if it is not known or not regular."""
        if len(self._intervals_s) < _MIN_INTERVALS:
            return None
        # Called for each message before it is processed: NumPy takes longer for so few numbers.
        count = len(self._intervals_s)
        period_s = sorted(self._intervals_s)[round(_QUANTILE * (count - 1))]
        multiples = [interval_s / period_s for interval_s in self._intervals_s]
        near = sum(abs(multiple - max(round(multiple), 1)) < _NEAR for multiple in multiples)
        return period_s if near >= _REGULAR_SHARE * count else None

    @property
    def recent(self) -> tuple[int, int]:
        """The messages received and missed in the last ten seconds of the stream."""
        return len(self._recent), sum(missed for _, missed in self._recent)
