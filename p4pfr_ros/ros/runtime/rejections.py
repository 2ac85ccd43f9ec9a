# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""Messages without an answer: counted by cause, and said without flooding the log."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass
import time

_PERIOD_S = 5.0


@dataclass(frozen=True, slots=True)
class Rejected:
    """
    Why a message has no answer.

    Parameters
    ----------
    cause
        A short name to count under, such as 'point_count'.
    reason
        A sentence for humans that says what was expected and what came.

    """

    cause: str
    reason: str


class Rejections:
    """
    Counts rejected messages by cause and says each cause at once, then at most every 5 s.

    Parameters
    ----------
    say
        What takes a line for humans: a function that calls the node's logger. (Not the logger's
        own method: to rclpy, the place that a message comes from has one severity for good, and
        it would take the place for the one in here.)

    """

    def __init__(self, say: Callable[[str], object]) -> None:
        self.counts: Counter[str] = Counter()
        self._say = say
        self._said_s: dict[str, float] = {}

    def add(self, rejected: Rejected) -> None:
        """Count one message, and say why it was rejected when it is time to."""
        self.counts[rejected.cause] += 1
        now_s = time.monotonic()
        if now_s - self._said_s.get(rejected.cause, -_PERIOD_S) >= _PERIOD_S:
            self._said_s[rejected.cause] = now_s
            count = self.counts[rejected.cause]
            self._say(f'{rejected.reason} [{rejected.cause}: {count} so far]')
