# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""Formats numbers with their standard deviations."""

from __future__ import annotations

import math

_MAX_DIGITS = 9


def plus_minus(value: float, sigma: float) -> str:
    """
    Format a number and its standard deviation, rounded to two digits of the latter.

    A standard deviation of 0 marks a parameter that was held fixed.
    """
    if not sigma > 0.0:
        return f'{value:g} (held)'
    digits = min(max(0, 1 - math.floor(math.log10(sigma))), _MAX_DIGITS)
    return f'{value:.{digits}f} ± {sigma:.{digits}f}'
