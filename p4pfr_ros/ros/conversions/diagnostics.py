# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""``HealthStatus`` to DiagnosticArray."""

from __future__ import annotations

from builtin_interfaces.msg import Time
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from std_msgs.msg import Header

from ..pose.health import HealthStatus


def diagnostics_msg(
    stamp: Time, name: str, hardware_id: str, status: HealthStatus
) -> DiagnosticArray:
    """Make the message for /diagnostics: the state of one component, by its unique name."""
    diagnostic = DiagnosticStatus(
        level=bytes([status.level]),
        name=name,
        message=status.message,
        hardware_id=hardware_id,
        values=[KeyValue(key=key, value=value) for key, value in status.values.items()],
    )
    return DiagnosticArray(header=Header(stamp=stamp), status=[diagnostic])
