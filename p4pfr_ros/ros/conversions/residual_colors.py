# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""Residuals to colours that also those can tell apart who see red and green alike."""

from __future__ import annotations

import numpy as np
from p4pfr_ros.core.geometry import Array
from std_msgs.msg import ColorRGBA

# From fine to bad: sky blue, yellow, orange-red; all of them bright before a dark background.
_STOPS = (0.0, 0.5, 1.0)
_RED, _GREEN, _BLUE = (0.30, 0.95, 0.90), (0.75, 0.88, 0.35), (0.95, 0.25, 0.10)

# Making a message costs more than choosing one of these.
_STEPS = 32


def _ramp() -> tuple[ColorRGBA, ...]:
    shares = np.linspace(0.0, 1.0, _STEPS + 1)
    rgb = np.stack([np.interp(shares, _STOPS, c) for c in (_RED, _GREEN, _BLUE)], axis=1)
    return tuple(ColorRGBA(r=r, g=g, b=b, a=1.0) for r, g, b in rgb.tolist())


_RAMP = _ramp()


def ramp_colors(shares: Array) -> list[ColorRGBA]:
    """Return a colour for each of (N,) shares: 0 is fine, 1 and more (or NaN) bad."""
    steps = np.rint(np.clip(np.nan_to_num(shares, nan=1.0), 0.0, 1.0) * _STEPS)
    return [_RAMP[step] for step in steps.astype(int).tolist()]
