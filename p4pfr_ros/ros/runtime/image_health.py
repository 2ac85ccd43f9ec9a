# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""
The health of a node that receives images: what is on /diagnostics.

This module stands alone: it derives the status; the node records the events and publishes.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Mapping

from diagnostic_msgs.msg import DiagnosticStatus, KeyValue

from .stream_rate import StreamRate

# A share of missing images that is reported.
_MISSED_SHARE = 0.05
_STALE_AFTER_S = 3.0
_DURATIONS = 30


class ImageHealth:
    """
    Records received and processed images.

    All ``now_s`` are seconds of one steady clock.
    """

    def __init__(self, now_s: float) -> None:
        self._rate = StreamRate()
        self._received_s, self._has_received = now_s, False
        self._durations_s: deque[float] = deque(maxlen=_DURATIONS)
        self._detected: deque[bool] = deque(maxlen=_DURATIONS)

    def received(self, now_s: float, stamp_s: float) -> None:
        """Record an image, by the stamp of its header."""
        self._rate.add(stamp_s)
        self._received_s, self._has_received = now_s, True

    def processed(self, duration_s: float, *, detected: bool) -> None:
        """Record that an image was searched for boards, and whether it shows one."""
        self._durations_s.append(duration_s)
        self._detected.append(detected)

    def status(
        self,
        now_s: float,
        *,
        qos: str,
        publishers: int,
        incompatible: int,
        rejections: Mapping[str, int],
    ) -> DiagnosticStatus:
        """
        Return the status, without the name.

        qos is the reliability of the subscription; incompatible publishers do not offer its QoS.
        """
        level, message = self._verdict(now_s, qos, publishers, incompatible)
        received, missed = self._rate.recent
        period_s = self._rate.period_s
        values = {
            'images': str(self._rate.received_count),
            'rate, 1/s': 'not known' if period_s is None else f'{1.0 / period_s:.1f}',
            'missed in 10 s': f'{missed} of {received + missed}',
            'missed': str(self._rate.missed_count),
            'publishers': str(publishers),
            'reliability': qos,
            'processing, ms': 'not known' if not self._durations_s else f'{self._mean_ms:.1f}',
            'images with a board': f'{sum(self._detected)} of the last {len(self._detected)}',
            **{f'rejected.{cause}': str(count) for cause, count in rejections.items()},
        }
        return DiagnosticStatus(
            level=level,
            message=message,
            values=[KeyValue(key=key, value=value) for key, value in values.items()],
        )

    @property
    def _mean_ms(self) -> float:
        return 1e3 * sum(self._durations_s) / len(self._durations_s)

    def _verdict(
        self, now_s: float, qos: str, publishers: int, incompatible: int
    ) -> tuple[bytes, str]:
        silent_s = now_s - self._received_s
        if silent_s > _STALE_AFTER_S or not self._has_received:
            since = f' for {silent_s:.0f} s' if self._has_received else ''
            text = f'no image received{since}, {publishers} publishers'
            if incompatible:
                text += f', {incompatible} of them with an incompatible QoS'
            return DiagnosticStatus.WARN, text
        received, missed = self._rate.recent
        period_s = self._rate.period_s
        if period_s is None or missed <= _MISSED_SHARE * (received + missed):
            return DiagnosticStatus.OK, 'receiving images'
        text = f'{missed} of {received + missed} images are missing in the last 10 s'
        if self._durations_s and self._mean_ms > 900.0 * period_s:
            return DiagnosticStatus.WARN, (
                f'{text}: an image takes {self._mean_ms:.0f} ms, they come every '
                f'{1e3 * period_s:.0f} ms'
            )
        lost = 'lost on the way' if qos == 'best effort' else 'not published, or dropped'
        return DiagnosticStatus.WARN, f'{text}: {lost} (reliability: {qos})'
