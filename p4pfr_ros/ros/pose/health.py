# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""The health of pose_node: rejections and warnings in the log, and /diagnostics."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass
import enum
import math
import time

from builtin_interfaces.msg import Time
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
import numpy as np
from p4pfr_ros import CameraEstimate, CameraInfoModel, PoseEstimate, Status
from rclpy.node import Node
from std_msgs.msg import Header

from .camera_source import CalibrationBySize
from .health_values import (
    board_values,
    camera_values,
    Latencies,
    number,
    UNKNOWN,
    view_values,
)
from ..runtime.endpoints import Endpoints
from ..runtime.rejections import CauseLog, Notice, Rejected

STALE_AFTER_S = 3.0
PERIOD_S = 1.0

# A change is published at once, but not more often than this.
_MIN_PERIOD_S = 0.1

# A periodic timer may fire this much early.
_EARLY_S = 0.1

# Time that a condition stays active after it last occurred: it may occur in every second view.
_HOLD_S = 2.0
_RESTART_HOLD_S = 10.0

# The same for notices that are on /diagnostics; saving is retried every minute.
_NOTICE_HOLD_S = {'not_saved': 70.0, 'tf_parents': _HOLD_S}

_NO_IMAGE_SIZE = 'no_image_size'

# A calibration of another camera gives no pose, or wrong ones.
_MISFIT = Status.MISFIT.name.lower()

# An estimate with a smaller share of inliers is reported.
_FEW_INLIERS = 0.8

# An invalid camera_info is not an invalid message with points.
_CAMERA_INFO = 'camera_info'


class HealthReporter:
    """
    Logs rejections and warnings, and publishes /diagnostics.

    Parameters
    ----------
    node
        The node to report on.
    endpoints
        Creates the publisher.
    camera_name
        The hardware_id on /diagnostics.

    """

    def __init__(self, node: Node, endpoints: Endpoints, camera_name: str) -> None:
        self._node, self._camera_name = node, camera_name
        self._rejections = CauseLog(node.get_logger())
        self._notices = CauseLog(node.get_logger())
        self._health = Health(time.monotonic())
        self._calibrations: CalibrationBySize | None = None
        self._publisher = endpoints.advertise(DiagnosticArray, '/diagnostics')
        self.pending = ''

    def received(self, received_s: float) -> None:
        """Record a message with points; the time is of ``time.monotonic``."""
        self._health.received(received_s)

    def reject(self, rejected: Rejected) -> None:
        """Record and log a rejected message, or a rejected part of a message."""
        self._rejections.add(rejected)
        self._health.rejected(time.monotonic(), rejected)

    def warn(self, notice: Notice) -> None:
        """Record and log a warning about a message that is processed."""
        self._notices.add(notice)
        self._health.warned(time.monotonic(), notice)

    def estimated(
        self, stamp_ns: int, estimate: PoseEstimate, received_s: float, reason: str = ''
    ) -> None:
        """Record an estimate; one without a model is a rejection, by its status or ``reason``."""
        if estimate.model is None:
            self.reject(Rejected(estimate.status.name.lower(), reason or estimate.status.value))
            return
        now_s = time.monotonic()
        age_s = 1e-9 * (self._node.get_clock().now().nanoseconds - stamp_ns)
        undetermined = self._health.estimated(now_s, estimate, now_s - received_s, age_s)
        if undetermined:
            text = f'not observable: {undetermined} (tilt the board, or bring it closer)'
            self.warn(Notice('not_observable', text))

    def calibrated(self, calibrations: CalibrationBySize | None) -> None:
        """Record the calibration after a view; None in the modes without self-calibration."""
        now_s, self._calibrations = time.monotonic(), calibrations
        if calibrations is None:
            self._health.calibrated(now_s, '', 0, None, restarted=False)
            return
        fused = calibrations.fused
        state, views = calibrations.state.value, 0 if fused is None else fused.views
        self._health.calibrated(now_s, state, views, fused, calibrations.restarted)

    def camera_published(self, model: CameraInfoModel | None) -> None:
        """Record the model on ``~/camera_info``; None: none was published."""
        if model is not None:
            self._health.camera_info(
                model.distortion_model, model.residual_px, model.residual_outside_px
            )

    def publish(self, *, enabled: bool) -> None:
        """Publish /diagnostics if a second has passed, or the status has changed."""
        self._health.enabled, self._health.pending = enabled, self.pending
        now_s = time.monotonic()
        if self._health.due(now_s):
            # What is missing takes longer than a message has time for.
            calibrations = self._calibrations
            self._health.missing = () if calibrations is None else calibrations.missing
            status = self._health.status(now_s)
            name = f'{self._node.get_fully_qualified_name()[1:]}: pose'
            stamp = self._node.get_clock().now().to_msg()
            self._publisher.publish(diagnostics_msg(stamp, name, self._camera_name, status))


class Level(enum.IntEnum):
    """The levels of diagnostic_msgs/DiagnosticStatus."""

    OK = 0
    WARN = 1
    ERROR = 2
    STALE = 3


@dataclass(frozen=True, slots=True)
class HealthStatus:
    """A status of the node: its level, the reasons in one line, and numbers as text by name."""

    level: Level
    message: str
    values: dict[str, str]


@dataclass(frozen=True, slots=True)
class _Reason:
    """A condition that is reported until a time."""

    level: Level
    text: str
    until_s: float


class Health:
    """
    Records the events of a node and derives its status; it does not use ROS.

    Recording an event takes a microsecond or two; numbers are formatted in ``status``. All
    ``now_s`` are seconds of one steady clock. Before ``status``, set ``enabled`` to the value of
    the parameter, ``pending`` to what the node waits for, ``missing`` to the calibration's advice.
    """

    def __init__(self, now_s: float) -> None:
        self.enabled = True
        self.pending = ''
        self.missing: tuple[str, ...] = ()
        self.received_count = 0
        self.answered_count = 0
        self.rejections: Counter[str] = Counter()
        self._latencies = Latencies(now_s)
        self._received_s: float | None = None
        # Whether the last message was neither estimated nor rejected, as nothing needed it.
        self._was_skipped = False
        # Time of the last message that was estimated or skipped, and the number of messages
        # since then that were only rejected.
        self._good_s = -math.inf
        self._bad_in_a_row = 0
        self._stamp_age_s: float | None = None
        self._estimate: PoseEstimate | None = None
        self._calibration = ''
        self._views = 0
        self._fused: CameraEstimate | None = None
        self._camera_info = (UNKNOWN, UNKNOWN, UNKNOWN)
        self._reasons: dict[str, _Reason] = {}
        self._next_s = now_s
        self._published_s = -math.inf
        self._published: tuple[Level, tuple[str, ...]] | None = None

    def received(self, now_s: float) -> None:
        """Record a message with points, before it is processed."""
        if self._was_skipped and self._received_s is not None:
            self._good_s, self._bad_in_a_row = self._received_s, 0
        self.received_count += 1
        self._received_s, self._was_skipped = now_s, True

    def rejected(self, now_s: float, rejected: Rejected) -> None:
        """Record a rejected message, or a rejected part of a message."""
        self.rejections[rejected.cause] += 1
        if self._was_skipped and rejected.cause != _CAMERA_INFO:
            self._was_skipped = False
            self._bad_in_a_row += 1
        # Without the image size no message can be processed.
        is_error = rejected.cause in (_NO_IMAGE_SIZE, _MISFIT)
        level = Level.ERROR if is_error else Level.WARN
        text = f'rejected ({rejected.cause}): {rejected.reason}'
        self._hold(now_s, f'rejected.{rejected.cause}', level, text)

    def estimated(
        self, now_s: float, estimate: PoseEstimate, latency_s: float, stamp_age_s: float
    ) -> str:
        """
        Record a published estimate with a model; return the quantities it leaves undetermined.

        latency_s: since its message was received; stamp_age_s: since the stamp of its image.
        """
        self.answered_count += 1
        self._was_skipped = False
        self._good_s, self._bad_in_a_row = now_s, 0
        self._latencies.add(now_s, latency_s)
        self._stamp_age_s = stamp_age_s
        self._estimate = estimate
        if estimate.alternatives:
            text = 'ambiguous: another pose fits the view equally well'
            self._hold(now_s, 'ambiguous', Level.WARN, text)
        ratio = float(np.mean(estimate.inliers))
        if ratio < _FEW_INLIERS:
            text = f'inlier ratio {ratio:.2f}: wrong or moved points, or a bent board'
            self._hold(now_s, 'few_inliers', Level.WARN, text)
        if estimate.status is Status.SPENT:
            text = 'search ended by robust.max_iterations: the pose may not be the best'
            self._hold(now_s, 'search_ended', Level.WARN, text)
        undetermined = ', '.join(estimate.observable.undetermined)
        if undetermined:
            text = f'not observable: {undetermined}'
            self._hold(now_s, 'unobservable', Level.WARN, text)
        return undetermined

    def warned(self, now_s: float, notice: Notice) -> None:
        """Record a warning; only some causes are on /diagnostics."""
        hold_s = _NOTICE_HOLD_S.get(notice.cause)
        if hold_s is not None:
            text = f'{notice.cause}: {notice.reason}'
            self._hold(now_s, notice.cause, Level.WARN, text, hold_s)

    def calibrated(
        self, now_s: float, state: str, views: int, fused: CameraEstimate | None, restarted: bool
    ) -> None:
        """Record the calibration after a view; restarted: the camera has changed."""
        self._calibration, self._views, self._fused = state, views, fused
        if restarted:
            text = 'the camera has changed: calibration restarted'
            self._hold(now_s, 'camera_changed', Level.WARN, text, _RESTART_HOLD_S)

    def camera_info(
        self, distortion_model: str, residual_px: float, residual_outside_px: float
    ) -> None:
        """Record the model on ``~/camera_info``, and its largest deviations from ours, px."""
        self._camera_info = (
            distortion_model,
            number(residual_px, 4),
            number(residual_outside_px, 4),
        )

    def due(self, now_s: float) -> bool:
        """Return whether to publish: once a second, and after a change of level or reasons."""
        if self._is_time(now_s):
            return True
        is_soon = now_s - self._published_s < _MIN_PERIOD_S
        return not is_soon and self._judge(now_s)[:2] != self._published

    def status(self, now_s: float) -> HealthStatus:
        """Return the status, and regard it as published."""
        level, keys, texts = self._judge(now_s)
        self._published_s, self._published = now_s, (level, keys)
        # The period follows the clock: neither a change in between nor a call that is slightly
        # early or late shifts it. A call that is much too late restarts it.
        if self._is_time(now_s):
            is_on_time = now_s - self._next_s <= _EARLY_S
            self._next_s = PERIOD_S + (self._next_s if is_on_time else now_s)
        return HealthStatus(level, '; '.join(texts), self._values(now_s))

    def _is_time(self, now_s: float) -> bool:
        return now_s >= self._next_s - _EARLY_S

    def _hold(
        self, now_s: float, key: str, level: Level, text: str, hold_s: float = _HOLD_S
    ) -> None:
        self._reasons[key] = _Reason(level, text, now_s + hold_s)

    def _judge(self, now_s: float) -> tuple[Level, tuple[str, ...], list[str]]:
        """Return the level, the keys of the reasons and their texts, the most severe first."""
        self._reasons = {k: r for k, r in self._reasons.items() if r.until_s > now_s}
        if not self.enabled:
            return Level.OK, ('disabled',), ['disabled: messages are ignored']
        if self.pending:
            return Level.WARN, (self.pending,), [self.pending]
        if self._received_s is None or now_s - self._received_s > STALE_AFTER_S:
            since = 'yet' if self._received_s is None else f'for {STALE_AFTER_S:g} s'
            return Level.STALE, ('stale',), [f'no points received {since}']
        if not self._reasons:
            key, text = self._without_reasons()
            return Level.OK, (key,), [text]
        ordered = sorted(self._reasons.items(), key=lambda item: (-item[1].level, item[0]))
        level = ordered[0][1].level
        all_bad = self._bad_in_a_row > 1 and now_s - self._good_s > _HOLD_S
        if all_bad and any(key.startswith('rejected.') for key, _ in ordered):
            level = Level.ERROR  # all messages are rejected, not some of them
        return level, tuple(key for key, _ in ordered), [reason.text for _, reason in ordered]

    def _without_reasons(self) -> tuple[str, str]:
        if self._was_skipped:
            return 'idle', 'idle: no board detected, or no subscribers'
        if not self._calibration:
            return '', 'estimating poses'
        details = [self._calibration, *self.missing]
        if self._fused is not None and not math.isnan(self._fused.projection_sigma_px):
            details.append(f'{self._fused.projection_sigma_px:.2f} px at most where seen')
        return self._calibration, '; '.join(details)

    def _values(self, now_s: float) -> dict[str, str]:
        p50_s, p99_s = self._latencies.quantiles_s(now_s, 0.5, 0.99)
        age_s = self._stamp_age_s
        model, residual_px, residual_outside_px = self._camera_info
        return {
            'calibration': self._calibration or UNKNOWN,
            'missing': '; '.join(self.missing) or ('nothing' if self._calibration else UNKNOWN),
            'views': str(self._views),
            **camera_values(self._fused, self._estimate),
            'camera_info_model': model,
            'camera_info_residual_px': residual_px,
            'camera_info_residual_outside_px': residual_outside_px,
            **board_values(self._fused),
            **view_values(self._estimate),
            'rate_hz': number(self._latencies.rate_hz(now_s), 1),
            'latency_p50_ms': number(1e3 * p50_s, 2),
            'latency_p99_ms': number(1e3 * p99_s, 2),
            'stamp_age_ms': UNKNOWN if age_s is None else number(1e3 * age_s, 1),
            'received': str(self.received_count),
            'answered': str(self.answered_count),
            **{f'rejected.{cause}': str(n) for cause, n in sorted(self.rejections.items())},
        }


def diagnostics_msg(
    stamp: Time, name: str, hardware_id: str, status: HealthStatus
) -> DiagnosticArray:
    """Make a DiagnosticArray with one status."""
    values = [KeyValue(key=key, value=value) for key, value in status.values.items()]
    return DiagnosticArray(
        header=Header(stamp=stamp),
        status=[
            DiagnosticStatus(
                level=bytes([status.level]),
                name=name,
                message=status.message,
                hardware_id=hardware_id,
                values=values,
            )
        ],
    )
