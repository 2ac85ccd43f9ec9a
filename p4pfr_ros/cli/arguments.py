# SPDX-License-Identifier: Apache-2.0
"""Numbers of the command line; argparse names the option when one of these raises."""

from __future__ import annotations

import math


def finite(text: str) -> float:
    """Read a number that is neither NaN nor infinite."""
    value = float(text)
    if not math.isfinite(value):
        raise ValueError
    return value


def positive(text: str) -> float:
    """Read a finite number above 0."""
    value = finite(text)
    if not value > 0.0:
        raise ValueError
    return value
