# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""A number and its standard deviation for people."""

from __future__ import annotations

import math

_MOST_DIGITS = 9


def plus_minus(value: float, sigma: float) -> str:
    """
    Write two digits of σ, and as many of the number behind the point as they allow.

    Where σ is 0 nothing was estimated: the number was held where it is.
    """
    if not sigma > 0.0:
        return f'{value:g} (held)'
    digits = min(max(0, 1 - math.floor(math.log10(sigma))), _MOST_DIGITS)
    return f'{value:.{digits}f} ± {sigma:.{digits}f}'
