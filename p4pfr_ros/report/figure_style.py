# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""
Colours and matplotlib settings of all figures.

The module stands alone because benchmarks and docs use it as well.
"""

from __future__ import annotations

from typing import Any

BLUE, ORANGE, GREEN, GREY = '#1f5fa8', '#d9722b', '#3a8f5c', '#555555'

STYLE: Any = {
    'font.size': 9,
    'axes.spines.top': False,
    'axes.spines.right': False,
    'axes.titlesize': 10,
    'axes.titlelocation': 'left',
    'legend.frameon': False,
    'legend.fontsize': 8,
}
