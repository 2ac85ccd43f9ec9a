# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""What /diagnostics says of pose_node: how it is, why, and its numbers. No ROS in here."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass
import enum
import math

from p4pfr_ros import PoseEstimate
from p4pfr_ros.core.many_views.results import CameraEstimate

from .health_values import camera_values, number, UNKNOWN, view_values
from .latencies import Latencies
from ..runtime.rejections import Rejected

STALE_AFTER_S = 3.0
PERIOD_S = 1.0

# A change is told at once, but not more often than that.
_SOONEST_S = 0.1

# A timer of the period fires now a little early, now a little late.
_EARLY_S = 0.1

# So long after it was last seen, a condition counts as present: every second view may have it.
_HOLD_S = 2.0
_RESTART_HOLD_S = 10.0

# So long a remark counts that nothing else here tells of; saving is tried again every minute.
_REMARKS_S = {'not_saved': 70.0, 'tf_parents': _HOLD_S}

_NO_IMAGE_SIZE = 'no_image_size'

# What is wrong with a camera_info says nothing of the messages with corners.
_CAMERA_INFO = 'camera_info'


class Level(enum.IntEnum):
    """As diagnostic_msgs/DiagnosticStatus has them."""

    OK = 0
    WARN = 1
    ERROR = 2
    STALE = 3


@dataclass(frozen=True, slots=True)
class HealthStatus:
    """One state of the node: its level, the reasons in a line, and numbers as text by name."""

    level: Level
    message: str
    values: dict[str, str]


@dataclass(frozen=True, slots=True)
class _Reason:
    """Something that is not as it should be, until it is forgotten."""

    level: Level
    text: str
    until_s: float


class Health:
    """
    Collects what happens to messages and judges it.

    Noting an event costs a microsecond or two; numbers are worked out in ``status``. Every
    ``now_s`` is the time in seconds of one steady clock. ``enabled`` is to follow the node's.
    """

    def __init__(self, now_s: float) -> None:
        self.enabled = True
        self.received_count = 0
        self.answered_count = 0
        self.rejections: Counter[str] = Counter()
        self._latencies = Latencies(now_s)
        self._received_s: float | None = None
        # Whether the last message was neither answered nor rejected: nobody wanted it to be.
        self._was_left = False
        # When a message was answered or left, and how many have only been rejected since.
        self._well_s = -math.inf
        self._bad_in_a_row = 0
        self._stamp_age_s: float | None = None
        self._estimate: PoseEstimate | None = None
        self._calibration = ''
        self._views = 0
        self._fused: CameraEstimate | None = None
        self._camera_info = (UNKNOWN, UNKNOWN)
        self._reasons: dict[str, _Reason] = {}
        self._next_s = now_s
        self._published_s = -math.inf
        self._published: tuple[Level, tuple[str, ...]] | None = None

    def received(self, now_s: float) -> None:
        """Note a message with corners, whatever becomes of it."""
        if self._was_left and self._received_s is not None:
            self._well_s, self._bad_in_a_row = self._received_s, 0
        self.received_count += 1
        self._received_s, self._was_left = now_s, True

    def rejected(self, now_s: float, rejected: Rejected) -> None:
        """Note a message that was not answered, and why."""
        self.rejections[rejected.cause] += 1
        if self._was_left and rejected.cause != _CAMERA_INFO:
            self._was_left = False
            self._bad_in_a_row += 1
        # Nothing can be answered without the picture's size.
        level = Level.ERROR if rejected.cause == _NO_IMAGE_SIZE else Level.WARN
        text = f'rejected, {rejected.cause}: {rejected.reason}'
        self._remember(now_s, f'rejected.{rejected.cause}', level, text)

    def answered(
        self, now_s: float, estimate: PoseEstimate, latency_s: float, stamp_age_s: float
    ) -> None:
        """
        Note an estimate with a model, after it was published.

        latency_s: since its message was received; stamp_age_s: since the stamp of its picture.
        """
        self.answered_count += 1
        self._was_left = False
        self._well_s, self._bad_in_a_row = now_s, 0
        self._latencies.add(now_s, latency_s)
        self._stamp_age_s = stamp_age_s
        self._estimate = estimate
        if estimate.alternatives:
            text = 'ambiguous: another pose explains the view as well'
            self._remember(now_s, 'ambiguous', Level.WARN, text)
        unseen = estimate.observable.undetermined
        if unseen:
            text = f'a view does not tell: {", ".join(unseen)}'
            self._remember(now_s, 'unobservable', Level.WARN, text)

    def remarked(self, now_s: float, remark: Rejected) -> None:
        """Note what people should know though the message is answered."""
        hold_s = _REMARKS_S.get(remark.cause)
        if hold_s is not None:
            text = f'{remark.cause}: {remark.reason}'
            self._remember(now_s, remark.cause, Level.WARN, text, hold_s)

    def calibrated(
        self, now_s: float, state: str, views: int, fused: CameraEstimate | None, restarted: bool
    ) -> None:
        """Note the self-calibration's state after a view; restarted: the camera has changed."""
        self._calibration, self._views, self._fused = state, views, fused
        if restarted:
            text = 'the camera has changed: its calibration has started over'
            self._remember(now_s, 'camera_changed', Level.WARN, text, _RESTART_HOLD_S)

    def camera_info(self, distortion_model: str, residual_px: float) -> None:
        """Note in which model the camera is published, and how far that is off at most, px."""
        self._camera_info = (distortion_model, number(residual_px, 4))

    def due(self, now_s: float) -> bool:
        """Return whether to publish: once a second, and at once when something has changed."""
        if self._is_time(now_s):
            return True
        is_soon = now_s - self._published_s < _SOONEST_S
        return not is_soon and self._judge(now_s)[:2] != self._published

    def status(self, now_s: float) -> HealthStatus:
        """Return the state, which counts as published now."""
        level, keys, texts = self._judge(now_s)
        self._published_s, self._published = now_s, (level, keys)
        # The beat is the clock's: neither a change in between nor a call that is a little early
        # or late shifts it. A call that is much too late sets it anew.
        if self._is_time(now_s):
            is_on_time = now_s - self._next_s <= _EARLY_S
            self._next_s = PERIOD_S + (self._next_s if is_on_time else now_s)
        return HealthStatus(level, '; '.join(texts), self._values(now_s))

    def _is_time(self, now_s: float) -> bool:
        return now_s >= self._next_s - _EARLY_S

    def _remember(
        self, now_s: float, key: str, level: Level, text: str, hold_s: float = _HOLD_S
    ) -> None:
        self._reasons[key] = _Reason(level, text, now_s + hold_s)

    def _judge(self, now_s: float) -> tuple[Level, tuple[str, ...], list[str]]:
        """Return the level, the reasons' keys and their texts; the gravest first."""
        self._reasons = {k: r for k, r in self._reasons.items() if r.until_s > now_s}
        if not self.enabled:
            return Level.OK, ('disabled',), ['disabled: messages are not answered']
        if self._received_s is None or now_s - self._received_s > STALE_AFTER_S:
            ever = 'yet' if self._received_s is None else f'for more than {STALE_AFTER_S:g} s'
            return Level.STALE, ('stale',), [f'no corners {ever}']
        if not self._reasons:
            key, text = self._all_is_well()
            return Level.OK, (key,), [text]
        ordered = sorted(self._reasons.items(), key=lambda item: (-item[1].level, item[0]))
        level = ordered[0][1].level
        all_bad = self._bad_in_a_row > 1 and now_s - self._well_s > _HOLD_S
        if all_bad and any(key.startswith('rejected.') for key, _ in ordered):
            level = Level.ERROR  # not one message among others, but all of them
        return level, tuple(key for key, _ in ordered), [reason.text for _, reason in ordered]

    def _all_is_well(self) -> tuple[str, str]:
        if self._was_left:
            return 'idle', 'idle: no board is seen, or nobody listens to the answers'
        return self._calibration, self._calibration or 'messages are answered'

    def _values(self, now_s: float) -> dict[str, str]:
        p50_s, p99_s = self._latencies.quantiles_s(now_s, 0.5, 0.99)
        age_s = self._stamp_age_s
        model, residual_px = self._camera_info
        return {
            'calibration': self._calibration or UNKNOWN,
            'views': str(self._views),
            **camera_values(self._fused, self._estimate),
            'camera_info_model': model,
            'camera_info_residual_px': residual_px,
            **view_values(self._estimate),
            'rate_hz': number(self._latencies.rate_hz(now_s), 1),
            'latency_p50_ms': number(1e3 * p50_s, 2),
            'latency_p99_ms': number(1e3 * p99_s, 2),
            'stamp_age_ms': UNKNOWN if age_s is None else number(1e3 * age_s, 1),
            'received': str(self.received_count),
            'answered': str(self.answered_count),
            **{f'rejected.{cause}': str(n) for cause, n in sorted(self.rejections.items())},
        }
