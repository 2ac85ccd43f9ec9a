# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""Rejected messages and warnings: counted by cause, and logged without flooding the log."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass
import time
from typing import Any

from p4pfr_ros.files.printable import printable
from rclpy.logging import LoggingSeverity

_PERIOD_S = 5.0
_MAX_REASON = 500


@dataclass(frozen=True, slots=True)
class Rejected:
    """
    Why a message, or a part of it, is not processed.

    Parameters
    ----------
    cause
        A short name to count by, such as 'point_count'.
    reason
        A sentence for people: what was expected, and what came; one line, which is cut.

    """

    cause: str
    reason: str

    def __post_init__(self) -> None:
        object.__setattr__(self, 'reason', printable(self.reason, _MAX_REASON))


@dataclass(frozen=True, slots=True)
class Notice:
    """
    A warning about a message that is processed.

    Parameters
    ----------
    cause
        A short name to count by, such as 'frame_id'.
    reason
        A sentence for people; one line, which is cut.

    """

    cause: str
    reason: str

    def __post_init__(self) -> None:
        object.__setattr__(self, 'reason', printable(self.reason, _MAX_REASON))


class CauseLog:
    """
    Counts events by cause and logs each cause at once, then at most every 5 s.

    Parameters
    ----------
    logger
        The node's logger.
    severity
        WARN or INFO.

    """

    def __init__(self, logger: Any, severity: LoggingSeverity = LoggingSeverity.WARN) -> None:
        self.counts: Counter[str] = Counter()
        self._logger, self._severity = logger, severity
        self._logged_s: dict[str, float] = {}

    def add(self, event: Rejected | Notice) -> None:
        """Count an event, and log it unless its cause was logged less than 5 s ago."""
        self.counts[event.cause] += 1
        now_s = time.monotonic()
        if now_s - self._logged_s.get(event.cause, -_PERIOD_S) < _PERIOD_S:
            return
        self._logged_s[event.cause] = now_s
        text = f'{event.reason} [{event.cause}: {self.counts[event.cause]} so far]'
        # rclpy binds a severity to the source line of the call: one line for each severity.
        if self._severity is LoggingSeverity.INFO:
            self._logger.info(text)
        else:
            self._logger.warning(text)
